//! Object poses on the command line: scenes are generated, poses refined, tables and results written.

mod support;

use glam::{Affine3A, Vec3};
use host_train::bop::evaluate::Refinements;
use host_train::dataset::bop::{MaskKind, Models, Scenes};
use host_train::dataset::depth::image::{read_depth, write_depth};
use host_train::dataset::mesh::Mesh;
use host_train::dataset::pairs::{PairSet, Sample};
use host_train::measure::eval::{EvalSettings, evaluate};
use host_train::measure::method::{Contestant, Finish, Start};
use host_train::random::{Purpose, stream};
use reagent_core::Pose;
use reagent_core::pipeline::Mode;
use serde_json::Value;
use support::{fail, folder, read_json, run, succeed};

const SYNTH: &str =
    "bop-synth --models procedural --scenes 2 --train-scenes 1 --images 1 --size 160x120 --seed 3";

#[test]
fn poses_are_refined_from_estimates_to_results() {
    let folder = folder();
    let at = folder.path();
    let said = succeed(at, &format!("{SYNTH} --out set"));
    assert!(said.contains("3 images of 8 objects in set"), "{said}");

    let eval = "eval --data set --protocol bop --methods icp,init --json";
    let said = succeed(
        at,
        &format!("{eval} one.json --estimates set/estimates.csv --results refined.csv"),
    );
    assert!(said.contains("<0.10d") && said.contains("mean"), "{said}");
    let tables = read_json(&at.join("one.json"));
    let pairs = tables["pairs"].as_u64().expect("a number");
    for method in ["icp", "init"] {
        assert!(tables["methods"][method]["r_iso_deg"].is_number());
        let rows = tables["objects"][method].as_array().expect("rows");
        let sum: u64 = rows.iter().filter_map(|row| row["pairs"].as_u64()).sum();
        assert_eq!(sum, pairs);
        assert!(tables["average_recall"][method]["ar"].as_f64() > Some(5.0));
        for row in rows {
            let percent = |name: &str| row[name].as_f64().expect("a number");
            assert!(percent("ad_02") <= percent("ad_05") && percent("ad_05") <= percent("ad_10"));
            assert!(percent("ad_10") <= 100.0);
            let parts = ["ar_vsd", "ar_mssd", "ar_mspd"].map(percent);
            assert!(parts.iter().all(|ar| (0.0..=100.0).contains(ar)));
            assert!((percent("ar") - parts.iter().sum::<f64>() / 3.0).abs() < 1e-9);
            let symmetric = [4, 8].contains(&row["object"].as_u64().expect("an id"));
            assert_eq!(row["symmetric"], Value::Bool(symmetric), "{row}");
            assert!(row["name"].is_string());
        }
    }

    // Refining the refined poses with no method leaves the tables unchanged.
    succeed(
        at,
        &format!("{eval} two.json --estimates refined-icp.csv --threads 2"),
    );
    let again = read_json(&at.join("two.json"));
    assert_eq!(again["objects"]["init"], tables["objects"]["icp"]);

    let half = format!("{eval} half.json --estimates set/estimates.csv --count 3");
    succeed(at, &half);
    assert_eq!(read_json(&at.join("half.json"))["pairs"], 3);
}

#[test]
fn meshes_of_a_folder_become_objects() {
    let folder = folder();
    let at = folder.path();
    std::fs::create_dir(at.join("meshes")).expect("created");
    let wedge = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n";
    std::fs::write(at.join("meshes/wedge.obj"), wedge).expect("written");
    std::fs::write(at.join("meshes/notes.txt"), "not a mesh").expect("written");
    let synth = "bop-synth --models meshes --scenes 1 --images 1 --size 80x60 --mm-per-unit 150 --train-scenes 0";
    let said = succeed(at, &format!("{synth} --out set"));
    assert!(said.contains("1 image of 1 object in set"), "{said}");
    assert!(at.join("set/test").is_dir() && !at.join("set/train").exists());
    let info = read_json(&at.join("set/models_eval/models_info.json"));
    let diameter = info["1"]["diameter"].as_f64().expect("a number");
    assert!((diameter - 150.0 * 2f64.sqrt()).abs() < 1e-3, "{diameter}");
    assert_eq!(info["1"]["name"], "wedge");

    fail(at, &format!("{synth} --out set"), &["set", "not empty"]);
    std::fs::write(at.join("meshes/flat.obj"), "v 0 0 0\nv 1 0 0\n").expect("written");
    fail(at, &format!("{synth} --out other"), &["flat.obj"]);
    fail(
        at,
        "bop-synth --models none --out other --scenes 1",
        &["none"],
    );
}

#[test]
fn usage_and_missing_data_are_explained() {
    let folder = folder();
    let at = folder.path();
    for usage in [
        "eval --methods icp --pairs p.h5 --results r.csv",
        "eval --data set --protocol bop",
        "eval --data procedural --protocol bop --estimates e.csv",
        "eval --data procedural --protocol scan --estimates e.csv",
        "eval --data set --protocol bop --results r.csv",
        "bop-synth --models procedural --out set",
        "bop-synth --models procedural --out set --scenes 1 --size 320",
        "bop-synth --models procedural --out set --scenes 1 --noise -1",
    ] {
        assert_eq!(run(at, usage).status.code(), Some(2), "{usage}");
    }
    fail(
        at,
        "eval --data none --protocol bop --estimates e.csv",
        &["none", "models_eval", "bop-synth"],
    );
}

/// The largest number of 16 bits marks missing depth, as 0 does.
#[test]
fn pixels_that_are_marked_have_no_depth() {
    let folder = folder();
    let root = folder.path().join("set");
    succeed(folder.path(), &format!("{SYNTH} --out set"));
    let models = Models::open(&root, 1).expect("models");
    let scenes = Scenes::open(&root.join("test"), &models).expect("scenes");
    let first = &scenes.instances[0];
    let pixels = |scenes: &Scenes| {
        let seen = scenes.observe(first, MaskKind::Visible).expect("images");
        [true, false].map(|inside| seen.pixels(inside).len())
    };
    let before = pixels(&scenes);
    let path = root.join("test/000000/depth/000000.png");
    let mut image = read_depth(&path).expect("depths");
    for depth in &mut image.values {
        *depth = if *depth == 0 { u16::MAX } else { *depth };
    }
    assert!(image.values.contains(&u16::MAX));
    write_depth(&path, &image).expect("written");
    assert_eq!(pixels(&scenes), before);
}

/// Free space is seen from the camera, in front of what it saw behind the object.
#[test]
fn pairs_know_from_where_and_before_what_they_were_seen() {
    let folder = folder();
    let root = folder.path().join("set");
    succeed(folder.path(), &format!("{SYNTH} --out set"));
    let estimates = root.join("estimates.csv");
    let found = Refinements::open(&root, &estimates, None, 1).expect("a data set");
    let PairSet { source, seen, .. } = &found.set;
    assert_eq!(seen.len(), source.len());
    for (source, seen) in source.iter().zip(seen) {
        let seen = seen.as_ref().expect("a camera");
        let eye = Vec3::from(seen.view_point);
        let centre = reagent_core::pose::centroid(source);
        let distance = centre.distance(eye);
        assert!(distance > 2.0, "{distance} radii");
        assert!(!seen.background.is_empty() && seen.background.len() < 20_000);
        let ahead = |&p: &[f32; 3]| {
            (Vec3::from(p) - eye)
                .normalize()
                .dot((centre - eye) / distance)
        };
        assert!(seen.background.iter().all(|p| ahead(p) > 0.5));
    }
}

/// A face of a plate, half-way between both of its large faces. Seen from above it is the upper one, since the plate
/// cannot stand in front of what was seen.
#[test]
fn a_refinement_knows_from_where_the_source_was_seen() {
    let mut plate = Mesh::default();
    plate.add_box(Affine3A::IDENTITY, Vec3::new(1.4, 0.8, 0.3));
    let target = plate.sample(1500, &mut stream(1, Purpose::Surface, 0));
    let face = |i: usize| {
        let [x, y] = [i % 30, i / 30].map(|k| k as f32);
        [(x / 29.0 - 0.5) * 1.4, (y / 19.0 - 0.5) * 0.8, 0.0]
    };
    let source: Vec<[f32; 3]> = (0..600).map(face).collect();
    let mut set = PairSet::default();
    for side in [1.0, -1.0] {
        let truth = Pose {
            translation: Vec3::Z * (0.15 * side),
            ..Pose::IDENTITY
        };
        let sample = Sample {
            source: source.clone(),
            target: target.clone(),
            target_from_source: truth,
        };
        set.push_view(sample, target.clone(), [0.3, 0.2, 4.0 * side], 0);
    }
    // A file keeps the view points.
    let folder = folder();
    let path = folder.path().join("views.h5");
    set.save(&path).expect("written");
    let set = PairSet::load(&path).expect("read");
    let contestant = Contestant {
        name: "verify".into(),
        method: Start::Identity.then(Finish::Core(Mode::Verify)),
    };
    let settings = EvalSettings {
        steps: 0,
        threads: 1,
        per_step: false,
    };
    let found = evaluate(&set, &[contestant], &settings, &|| {}).expect("two pairs");
    let poses = found[0].target_from_source.iter();
    let heights: Vec<f32> = poses.map(|pose| pose.translation.z).collect();
    assert!(heights[0] > 0.12 && heights[1] < -0.12, "{heights:?}");
}

/// Views drawn as pairs have their view points, so that the policy for views registers them.
#[test]
fn view_points_are_written_with_the_pairs() {
    let folder = folder();
    let at = folder.path();
    succeed(
        at,
        "pairs --data views:procedural:24 --count 24 --out views.h5",
    );
    let set = PairSet::load(&at.join("views.h5")).expect("pairs");
    let mut nearer = 0;
    for (i, sample) in set.samples().enumerate() {
        let eye = Vec3::from(set.seen(i).expect("a camera").view_point);
        let model = sample.target_from_source.inverse();
        let target = sample.target.iter().map(|&p| model.apply(p.into()));
        let median = |points: &mut dyn Iterator<Item = Vec3>| {
            let mut distances: Vec<f32> = points.map(|p| p.distance(eye)).collect();
            distances.sort_by(f32::total_cmp);
            distances[distances.len() / 2]
        };
        let seen = median(&mut sample.source.iter().map(|&p| Vec3::from(p)));
        assert!(seen > 2.0, "{seen} radii");
        // The side towards the camera is seen.
        nearer += u32::from(seen < median(&mut target.into_iter()));
    }
    assert!(nearer >= 19, "{nearer} of 24");

    let eval = "eval --pairs views.h5 --methods policy+verify --json eval.json";
    succeed(at, eval);
    let found = read_json(&at.join("eval.json"));
    assert!(found["methods"]["views+verify"]["ad02_pct"].as_f64() > Some(50.0));

    for usage in [
        "pairs --data procedural --out p.h5",
        "pairs --data views:procedural --protocol scan --out p.h5",
        "eval --data procedural --methods icp",
    ] {
        assert_eq!(run(at, usage).status.code(), Some(2), "{usage}");
    }
}
