//! Object pose refinement on data in BOP layout: golden vectors, a generated data set that is read back, and messages
//! about broken ones.

#[path = "bop/broken.rs"]
mod broken;
#[path = "bop/generated.rs"]
mod generated;
#[path = "bop/refined.rs"]
mod refined;
#[path = "bop/training.rs"]
mod training;

use glam::{Mat3, Vec3};
use host_train::bop::evaluate::Refinements;
use host_train::bop::normalise::Normalisation;
use host_train::bop::sample::placed_from;
use host_train::bop::synth::objects::{self, Object};
use host_train::bop::synth::{SynthSettings, generate};
use host_train::bop::table::{self, ObjectRow};
use reagent_core::Pose;
use reagent_tests::Golden;
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
        // From the camera's frame to the model's, by the true pose and by the estimate.
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

/// Rows of the tables for these registrations.
fn rows(found: &Refinements, target_from_source: &[Pose]) -> Vec<ObjectRow> {
    let estimated = found.estimated(target_from_source).expect("images");
    table::objects(&found.models, &estimated).expect("rows")
}
