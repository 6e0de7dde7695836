//! Object pose refinement on data in BOP layout: golden vectors, a generated data set read back, and what
//! is said of broken ones.

use glam::{Mat3, Vec3};
use host_train::bop::evaluate::Refinements;
use host_train::bop::normalise::Normalisation;
use host_train::bop::sample::{BopSampling, BopTraining, placed_from};
use host_train::bop::synth::objects::{self, Object};
use host_train::bop::synth::{ESTIMATES_FILE, SynthSettings, generate};
use host_train::bop::table::{self, ObjectRow};
use host_train::dataset::bop::{
    BopError, Estimate, MaskKind, Models, Scenes, TARGETS_FILE, read_results, write_results,
};
use host_train::dataset::cloud_file::read_file;
use host_train::dataset::depth::DepthError;
use host_train::dataset::pairs::PairSet;
use host_train::random::{Purpose, stream};
use proptest::prelude::*;
use reagent_core::Pose;
use reagent_tests::Golden;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

/// A pose of an array `[3 or 4, 4]`.
fn pose(golden: &Golden, name: &str) -> Pose {
    let (_, values) = golden.f32(name);
    let (rows, _) = values.as_chunks::<4>();
    Pose::from_rows([rows[0], rows[1], rows[2]])
}

fn cloud(golden: &Golden, name: &str) -> Vec<[f32; 3]> {
    golden.clouds(name).remove(0)
}

fn moved(pose: &Pose, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let apply = |p: &[f32; 3]| pose.apply(Vec3::from_array(*p)).to_array();
    points.iter().map(apply).collect()
}

#[track_caller]
fn close(ours: &[[f32; 3]], theirs: &[[f32; 3]], tolerance: f32) {
    assert_eq!(ours.len(), theirs.len());
    for (a, b) in ours.iter().flatten().zip(theirs.iter().flatten()) {
        assert!((a - b).abs() < tolerance, "{a}, reference {b}");
    }
}

#[test]
fn alignment_and_normalisation_equal_the_reference() {
    for golden in Golden::available("linemod.safetensors") {
        // Camera to model by the true pose, and by the estimate.
        let seen = cloud(&golden, "linemod.cam_points");
        let (_, t) = golden.f32("linemod.gt_translation");
        let (_, r) = golden.f32("linemod.gt_rotation");
        let truth = Pose {
            rotation: Mat3::from_cols_slice(&r).transpose(),
            translation: Vec3::from_slice(&t),
        };
        let estimate = pose(&golden, "linemod.estimate");
        let aligned = moved(&truth.inverse(), &seen);
        close(
            &aligned,
            &cloud(&golden, "linemod.gt_transform.src_out"),
            1e-3,
        );
        let placed = moved(&estimate.inverse(), &seen);
        close(
            &placed,
            &cloud(&golden, "linemod.est_transform.src_out"),
            1e-3,
        );
        let theirs = pose(&golden, "linemod.est_transform.transform_gt");
        let ours = placed_from(&estimate, &truth);
        assert!(ours.rotation.abs_diff_eq(theirs.rotation, 1e-6));
        assert!(ours.translation.abs_diff_eq(theirs.translation, 2e-3));

        let mut source = cloud(&golden, "linemod.normalize.src_in");
        let mut target = cloud(&golden, "linemod.normalize.ref_in");
        let frame = Normalisation::of(&mut source, &mut target).expect("an extent");
        close(&source, &cloud(&golden, "linemod.normalize.src_out"), 1e-5);
        close(&target, &cloud(&golden, "linemod.normalize.ref_out"), 1e-5);
        let (_, matrix) = golden.f32("linemod.normalize.matrix");
        assert!((frame.scale - matrix[0]).abs() < 1e-4);
        assert!((frame.centre.x - matrix[3]).abs() < 1e-5);
        let normalised = pose(&golden, "linemod.normalize.transform_gt_out");
        let restored = Pose {
            rotation: normalised.rotation,
            translation: normalised.translation * matrix[0],
        };
        let ours = frame.normalised(&restored);
        assert!(ours.translation.abs_diff_eq(normalised.translation, 1e-6));
    }
}

/// A small generated set without noise, shared by tests that only read it.
static EXACT: LazyLock<TempDir> = LazyLock::new(|| generated(0.0, 7));

fn settings(noise: f32, seed: u64) -> SynthSettings {
    SynthSettings {
        test_scenes: 2,
        train_scenes: 1,
        images: 2,
        per_scene: 4,
        size: [160, 120],
        noise,
        seed,
    }
}

fn built_in(seed: u64) -> Vec<Object> {
    objects::procedural(8, seed)
}

fn generated(noise: f32, seed: u64) -> TempDir {
    let dir = tempfile::tempdir().expect("temporary directory");
    generate(&built_in(seed), &settings(noise, seed), dir.path(), &|| ()).expect("generated");
    dir
}

/// All files below a folder, by path.
fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(root).expect("below").to_path_buf();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

/// Distance of a point to a triangle.
fn distance(p: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|&(from, to)| (to - from).cross(p - from).dot(normal) >= 0.0);
    if inside && normal != Vec3::ZERO {
        return (p - a).dot(normal).abs();
    }
    [(a, b), (b, c), (c, a)]
        .map(|(from, to)| {
            let edge = to - from;
            let along = (p - from).dot(edge) / edge.length_squared().max(1e-12);
            p.distance(from + along.clamp(0.0, 1.0) * edge)
        })
        .into_iter()
        .fold(f32::MAX, f32::min)
}

#[test]
fn the_true_pose_takes_what_is_seen_onto_the_model() {
    let root = EXACT.path();
    let models = Models::open(root, 1).expect("models");
    let mut pixels = 0;
    for split in ["test", "train"] {
        let scenes = Scenes::open(&root.join(split), &models).expect("scenes");
        for instance in &scenes.instances {
            let seen = scenes.observe(instance, MaskKind::Visible).expect("images");
            let inside = seen.pixels(true);
            if instance.visible == 0.0 {
                assert!(inside.is_empty());
                continue;
            }
            let path = root.join(format!("models_eval/obj_{:06}.ply", instance.object));
            let mesh = read_file(&path).expect("a mesh").mesh();
            let vertex = |i: u32| mesh.vertices[i as usize];
            let faces: Vec<[Vec3; 3]> = mesh.faces.iter().map(|face| face.map(vertex)).collect();
            let model_from_camera = instance.camera_from_model.inverse();
            for &pixel in inside.iter().step_by(1 + inside.len() / 20) {
                let p = model_from_camera.apply(Vec3::from_array(seen.point(pixel)));
                let nearest = faces
                    .iter()
                    .map(|&face| distance(p, face))
                    .fold(f32::MAX, f32::min);
                // Depths are rounded to a tenth of a millimetre.
                assert!(nearest < 0.2, "object {}: {nearest} mm", instance.object);
                pixels += 1;
            }
        }
    }
    assert!(pixels > 100, "{pixels}");
}

#[test]
fn noise_is_that_of_the_sensor() {
    let noisy = generated(1.0, 7);
    let depths = |root: &Path| {
        let path = root.join("test/000000/depth/000000.png");
        host_train::dataset::depth::image::read_depth(&path)
            .expect("a depth image")
            .values
    };
    let pairs: Vec<(f64, f64)> = depths(EXACT.path())
        .into_iter()
        .zip(depths(noisy.path()))
        .filter(|&(exact, seen)| exact > 0 && seen > 0)
        .map(|(exact, seen)| (f64::from(exact), f64::from(seen)))
        .collect();
    let mut errors: Vec<f64> = pairs.iter().map(|(a, b)| (a - b).abs() / 10.0).collect();
    errors.sort_by(f64::total_cmp);
    // Most pixels lie on smooth surfaces .6 to 1.5 m away: 1.3 to 3.5 mm, of which the median is two thirds.
    let median = errors[errors.len() / 2];
    assert!((0.7..3.0).contains(&median), "{median}");
    assert!(pairs.len() > 160 * 120 / 2);
    // The scenes are the same ones.
    let truth = "test/000000/scene_gt.json";
    let text = |root: &Path| std::fs::read_to_string(root.join(truth)).expect("text");
    assert_eq!(text(EXACT.path()), text(noisy.path()));
}

#[test]
fn the_same_seed_writes_the_same_bytes() {
    let again = files(generated(0.0, 7).path());
    let first = files(EXACT.path());
    assert_eq!(first.len(), again.len());
    for (name, bytes) in &first {
        assert!(bytes == &again[name], "{}", name.display());
    }
    let other = files(generated(0.0, 8).path());
    let truth = Path::new("test/000000/scene_gt.json");
    assert_ne!(first[truth], other[truth]);
}

/// The tables' rows of registrations.
fn rows(found: &Refinements, target_from_source: &[Pose]) -> Vec<ObjectRow> {
    let estimated = found.estimated(target_from_source).expect("images");
    table::objects(&found.models, &estimated).expect("rows")
}

#[test]
fn annotations_agree_with_the_images() {
    let root = EXACT.path();
    let models = Models::open(root, 1).expect("models");
    assert_eq!(models.iter().count(), 8);
    let symmetric: Vec<u32> = models
        .iter()
        .filter(|m| m.is_symmetric())
        .map(|m| m.object)
        .collect();
    assert_eq!(symmetric, [4, 8], "the solid of revolution and the box");
    for model in models.iter() {
        assert!((100.0..250.0).contains(&model.diameter_mm));
        assert_eq!(model.surface.len(), 4096);
    }
    let scenes = Scenes::open(&root.join("test"), &models).expect("scenes");
    assert_eq!(scenes.instances.len(), 2 * 2 * 4);
    let mut occluded = 0;
    for instance in &scenes.instances {
        let exact = scenes.observe(instance, MaskKind::Visible).expect("images");
        let rough = scenes
            .observe(instance, MaskKind::Estimated)
            .expect("images");
        let (exact, rough) = (exact.pixels(true), rough.pixels(true));
        let both = rough
            .iter()
            .filter(|p| exact.binary_search(p).is_ok())
            .count();
        assert!(both * 3 >= exact.len(), "{both} of {}", exact.len());
        occluded += usize::from(instance.visible < 0.95);
    }
    assert!(occluded >= 3, "{occluded} of 16 are occluded");
}

#[test]
fn training_samples_are_the_papers() {
    let sampling = BopSampling::default();
    let set = BopTraining::open(EXACT.path(), 1, sampling).expect("opened");
    let draw = |i: usize, k: u64| {
        set.sample(i, &mut stream(1, Purpose::Augment, k))
            .expect("a sample")
    };
    assert_eq!(draw(0, 0), draw(0, 0));
    assert_ne!(draw(0, 0).source, draw(0, 1).source);
    for i in 0..set.instances().len() {
        let sample = draw(i, i as u64);
        assert_eq!((sample.source.len(), sample.target.len()), (1024, 1024));
        let target: Vec<Vec3> = sample.target.iter().copied().map(Vec3::from).collect();
        let mean = target.iter().sum::<Vec3>() / 1024.0;
        let farthest = target.iter().map(|p| p.length()).fold(0.0, f32::max);
        assert!(mean.length() < 1e-4 && (farthest - 1.0).abs() < 1e-4);
        // At least half of the source lies on the object, which the true pose brings onto the target.
        let on_model = sample
            .source
            .iter()
            .filter(|p| {
                let p = sample.target_from_source.apply(Vec3::from_array(**p));
                target.iter().any(|q| q.distance(p) < 0.12)
            })
            .count();
        assert!(on_model >= 500, "{on_model} of sample {i}");
    }
}

#[test]
fn validation_images_are_held_back() {
    let open = || BopTraining::open(EXACT.path(), 1, BopSampling::default()).expect("opened");
    let all = open().instances().len();
    let (training, validation) = open().split(5, 0.5);
    let image = |set: &BopTraining| set.instances().iter().map(|i| i.image).collect::<Vec<_>>();
    assert_eq!(image(&training).len() + image(&validation).len(), all);
    assert!(
        image(&training)
            .iter()
            .all(|i| !image(&validation).contains(i))
    );
    let draw = || {
        let mut set = PairSet::default();
        validation.draw(3, 5, &mut set).expect("pairs");
        set
    };
    assert_eq!((draw().source.len(), draw().label.len()), (3, 3));
    assert_eq!(draw(), draw());
}

#[test]
fn on_listed_targets_the_others_are_trained_on() {
    let dir = generated(0.0, 7);
    let root = dir.path();
    let all = BopTraining::open(root, 1, BopSampling::default()).expect("opened");
    assert_eq!(
        all.instances().len(),
        4 * 2,
        "one scene of the folder train"
    );
    // Image 1 of scene 0 is left for training.
    let line = |scene: u32, image: u32, object: u32| {
        format!("{{\"scene_id\":{scene},\"im_id\":{image},\"obj_id\":{object},\"inst_count\":1}}")
    };
    let mut lines = Vec::new();
    for (scene, image) in [(0, 0), (1, 0), (1, 1)] {
        lines.extend((1..=8).map(|object| line(scene, image, object)));
    }
    std::fs::write(root.join(TARGETS_FILE), format!("[{}]", lines.join(","))).expect("written");
    let left = BopTraining::open(root, 1, BopSampling::default()).expect("opened");
    assert!(
        left.instances()
            .iter()
            .all(|i| (i.scene, i.image) == (0, 1))
    );

    // A listed object without an estimate is a failure; objects in images that are not listed do not count.
    let estimates = root.join(ESTIMATES_FILE);
    let mut kept = read_results(&estimates).expect("estimates");
    kept.retain(|e| (e.scene, e.image) == (0, 0));
    write_results(&estimates, &kept).expect("written");
    let found = Refinements::open(root, &estimates, None, 3).expect("opened");
    let rows = rows(&found, &vec![Pose::IDENTITY; found.set.source.len()]);
    assert_eq!(rows.iter().map(|r| r.pairs).sum::<usize>(), 12);
    assert_eq!(found.unrefined().1, 12 - kept.len());
}

/// Poses of one csv in f64, as rows of `[R | t]`.
type Matrix = nalgebra::Matrix4<f64>;

fn matrix(pose: &Pose) -> Matrix {
    let rows = pose.to_rows();
    Matrix::from_fn(|r, c| match (r, c) {
        (3, 3) => 1.0,
        (3, _) => 0.0,
        _ => f64::from(rows[r][c]),
    })
}

/// Estimates that are the truth need nothing; a registration in normalised units, carried through the chain of
/// homogeneous matrices, gives the pose that is reported.
#[test]
fn refined_poses_are_the_product_of_the_matrices() {
    let dir = generated(0.0, 9);
    let root = dir.path();
    let estimates = root.join(ESTIMATES_FILE);
    // A score of its own for each: an object may be in an image twice.
    let mut given = read_results(&estimates).expect("estimates");
    for (i, estimate) in given.iter_mut().enumerate() {
        estimate.score = i as f32;
    }
    write_results(&estimates, &given).expect("written");
    let found = Refinements::open(root, &estimates, None, 3).expect("opened");
    let pairs = found.set.source.len();
    assert!(pairs >= 8, "{pairs}");

    // The true registration gives the true poses: every row is perfect.
    let perfect = rows(&found, &found.set.target_from_source);
    let is_right = |r: &ObjectRow| r.ad_02 == 100.0 && r.recall.ar > 99.9;
    assert!(perfect.iter().all(is_right), "{perfect:?}");
    let rough = rows(&found, &vec![Pose::IDENTITY; pairs]);
    let mean = |of: fn(&ObjectRow) -> f64| rough.iter().map(of).sum::<f64>() / rough.len() as f64;
    let (ad, ar) = (mean(|r| r.ad_02), mean(|r| r.recall.ar));
    assert!(
        ad < 50.0 && (20.0..90.0).contains(&ar),
        "the estimates are rough: {rough:?}"
    );

    let step = Pose {
        rotation: Mat3::from_rotation_y(0.3) * Mat3::from_rotation_x(-0.2),
        translation: Vec3::new(0.1, -0.05, 0.2),
    };
    let results = found.results(&vec![step; pairs]);
    let key = |e: &Estimate| e.score as usize;
    let by_key: BTreeMap<_, _> = given.iter().map(|e| (key(e), *e)).collect();
    let unrefined = found.unrefined().0;
    let model = Models::open(root, 3).expect("models");
    let mut moved = 0;
    for result in &results {
        let estimate = matrix(&by_key[&key(result)].camera_from_model);
        let refined = matrix(&result.camera_from_model);
        // What was done, back in normalised units: N (E^-1 R)^-1 N^-1 has the step's rotation, and its shift is that
        // of the step, scaled, about the target's mean. Mean and scale are those of the model's surface.
        let done = (estimate.try_inverse().expect("rigid") * refined)
            .try_inverse()
            .expect("rigid");
        let rotation = done.fixed_view::<3, 3>(0, 0).into_owned();
        if (rotation - nalgebra::Matrix3::identity()).norm() < 1e-6 {
            continue;
        }
        moved += 1;
        let expected = matrix(&step);
        assert!((rotation - expected.fixed_view::<3, 3>(0, 0)).norm() < 1e-5);
        let surface = &model.get(result.object).expect("a model").surface;
        let sum = surface.iter().fold(nalgebra::Vector3::zeros(), |s, p| {
            s + nalgebra::Vector3::from(p.map(f64::from))
        });
        let mean = sum / surface.len() as f64;
        let reach = |p: &[f32; 3]| (nalgebra::Vector3::from(p.map(f64::from)) - mean).norm();
        let scale = surface.iter().map(reach).fold(0.0, f64::max);
        let mut normalise = Matrix::identity() / scale;
        normalise
            .fixed_view_mut::<3, 1>(0, 3)
            .copy_from(&(-mean / scale));
        normalise[(3, 3)] = 1.0;
        let back = normalise * done * normalise.try_inverse().expect("a scale");
        // The target is a quarter of the surface's points, drawn at random: its mean is not quite theirs.
        assert!((back - expected).norm() < 0.08, "{back} {expected}");
    }
    assert_eq!(moved + unrefined, results.len());
}

#[test]
fn the_first_thing_that_is_missing_is_named() {
    let open = |root: &Path| {
        Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1)
            .map(|_| ())
            .expect_err("refused")
            .to_string()
    };
    let empty = tempfile::tempdir().expect("temporary directory");
    let said = open(empty.path());
    assert!(
        said.contains("models_eval") && said.contains("bop.felk.cvut.cz"),
        "{said}"
    );
    for (missing, words) in [
        ("test/000001/scene_gt.json", "cam_R_m2c"),
        ("test/000001/scene_camera.json", "cam_K"),
        ("models_eval/models_info.json", "diameter"),
        ("models_eval/obj_000003.ply", "obj_000003.ply"),
        ("test/000000/depth/000001.png", "16 bits"),
        ("estimates.csv", "scene_id,im_id,obj_id,score,R,t,time"),
    ] {
        let dir = generated(0.0, 7);
        std::fs::remove_file(dir.path().join(missing)).expect("removed");
        let said = open(dir.path());
        assert!(said.contains(missing) && said.contains(words), "{said}");
    }
    let dir = generated(0.0, 7);
    let root = dir.path();
    std::fs::remove_dir_all(root.join("test/000000/mask_estimate")).expect("removed");
    assert!(Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1).is_ok());
    std::fs::remove_dir_all(root.join("test/000000/mask_visib")).expect("removed");
    assert!(open(root).contains("mask_visib"));
}

#[test]
fn contents_that_cannot_be_are_named() {
    let dir = generated(0.0, 7);
    let root = dir.path();
    let refuse = |file: &str, from: &str, to: &str, words: &[&str]| {
        let path = root.join(file);
        let text = std::fs::read_to_string(&path).expect("text");
        let changed = text.replacen(from, to, 1);
        assert_ne!(text, changed, "{file} holds {from}");
        std::fs::write(&path, changed).expect("written");
        let said = Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1)
            .map(|_| ())
            .expect_err("refused")
            .to_string();
        std::fs::write(&path, text).expect("written");
        assert!(said.contains(file), "{said}");
        for word in words {
            assert!(said.contains(word), "no {word} in {said}");
        }
    };
    let truth = "test/000000/scene_gt.json";
    refuse(truth, "cam_t_m2c", "cam_T_m2c", &["cam_t_m2c", "line"]);
    refuse(
        truth,
        "\"obj_id\": ",
        "\"obj_id\": 99",
        &["names object 99", "models_eval"],
    );
    refuse(
        truth,
        "\"1\": [",
        "\"7\": [",
        &["image 7", "scene_camera.json"],
    );
    let camera = "test/000001/scene_camera.json";
    refuse(
        camera,
        "\"depth_scale\": 0.1",
        "\"depth_scale\": -0.1",
        &["depth_scale"],
    );
    let info = "models_eval/models_info.json";
    refuse(info, "\"diameter\": ", "\"diameter\": -", &["diameter -"]);
    refuse("estimates.csv", " ", " x ", &["row 2"]);

    // A mask of another size, and a depth image that is a mask.
    let masks = root.join("test/000000/mask_estimate");
    for entry in std::fs::read_dir(&masks).expect("masks") {
        let path = entry.expect("an entry").path();
        host_train::dataset::depth::image::write_mask(&path, [3, 2], &[true; 6]).expect("written");
    }
    let said = Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1)
        .map(|_| ())
        .expect_err("refused");
    assert!(
        matches!(
            said,
            BopError::Depth(DepthError::Size { found: [3, 2], .. })
        ),
        "{said}"
    );
}

/// What is broken: the end of a file cut off, or some bytes changed.
#[derive(Clone, Debug)]
enum Damage {
    Cut(f64),
    Bytes(Vec<(f64, u8)>),
}

fn damage() -> impl Strategy<Value = Damage> {
    let cut = (0.0..1.0).prop_map(Damage::Cut);
    let bytes = prop::collection::vec((0.0..1.0, any::<u8>()), 1..12).prop_map(Damage::Bytes);
    prop_oneof![cut, bytes]
}

const FRAGILE: [&str; 8] = [
    "models_eval/models_info.json",
    "models_eval/obj_000004.ply",
    "test/000000/scene_gt.json",
    "test/000000/scene_camera.json",
    "test/000000/scene_gt_info.json",
    "test/000000/depth/000000.png",
    "test/000000/mask_estimate/000000_000000.png",
    "estimates.csv",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Whatever is broken, the set is read or refused: no panic, no memory beyond what the images take, and a file
    /// that was cut is named unless what is left is complete.
    #[test]
    fn damaged_files_are_read_or_refused(file in 0..FRAGILE.len(), damage in damage()) {
        static DIR: LazyLock<TempDir> = LazyLock::new(|| generated(0.0, 11));
        let root = DIR.path();
        let path = root.join(FRAGILE[file]);
        let whole = std::fs::read(&path).expect("a file");
        let mut bytes = whole.clone();
        match &damage {
            Damage::Cut(share) => bytes.truncate((bytes.len() as f64 * share) as usize),
            Damage::Bytes(changes) => for (place, byte) in changes {
                let place = (bytes.len() as f64 * place) as usize;
                bytes[place] = *byte;
            },
        }
        std::fs::write(&path, &bytes).expect("written");
        let opened = Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1);
        std::fs::write(&path, &whole).expect("written");
        match opened {
            Ok(found) => {
                let pairs = found.set.source.len();
                prop_assert!(found.estimated(&vec![Pose::IDENTITY; pairs]).is_ok());
            }
            Err(error) => {
                let said = error.to_string();
                prop_assert!(said.contains(root.to_str().expect("text")), "{}", said);
            }
        }
    }
}
