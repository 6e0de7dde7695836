//! The paper's metrics compared with the authors' own code (`metrics.*` of the golden file).

use glam::Vec3;
use host_train::measure::metrics::{Errors, GroundTruth, PairMetrics, Summary, auc};
use reagent_core::Pose;
use reagent_tests::Golden;

/// Poses of an array `[B, 3 or 4, 4]`.
fn poses(golden: &Golden, name: &str) -> Vec<Pose> {
    let (shape, values) = golden.f32(name);
    let (rows, _) = values.as_chunks::<4>();
    rows.chunks(shape[1])
        .map(|m| Pose::from_rows([m[0], m[1], m[2]]))
        .collect()
}

fn measure(golden: &Golden, with_raw: bool) -> Vec<PairMetrics> {
    let source = golden.clouds("metrics.points_src");
    let target = golden.clouds("metrics.points_ref");
    let raw = golden.clouds("metrics.points_raw");
    let truth = poses(golden, "metrics.transform_gt");
    poses(golden, "metrics.pred")
        .into_iter()
        .enumerate()
        .map(|(i, estimate)| {
            let raw = with_raw.then_some(raw[i].as_slice());
            GroundTruth::new(&source[i], &target[i], raw, truth[i])
                .expect("golden pairs are valid")
                .measure(estimate)
        })
        .collect()
}

fn check(golden: &Golden, name: &str, ours: impl IntoIterator<Item = f64>, tolerance: f64) {
    let (_, theirs) = golden.f32(name);
    let ours: Vec<f64> = ours.into_iter().collect();
    assert_eq!(ours.len(), theirs.len(), "{name}");
    for (i, (&a, &b)) in ours.iter().zip(&theirs).enumerate() {
        assert!(
            (a - f64::from(b)).abs() < tolerance,
            "{name}[{i}]: {a}, reference {b}"
        );
    }
}

#[test]
fn errors_of_each_pair_equal_the_reference() {
    for golden in Golden::available("metrics.safetensors") {
        let m = measure(&golden, true);
        check(
            &golden,
            "metrics.r_mae",
            m.iter().map(|m| m.r_mae_deg),
            1e-4,
        );
        check(&golden, "metrics.t_mae", m.iter().map(|m| m.t_mae), 1e-6);
        // The reference computes the arc cosine in f32: 1e-2 degrees near 0.
        check(
            &golden,
            "metrics.r_iso",
            m.iter().map(|m| m.r_iso_deg),
            1e-2,
        );
        check(&golden, "metrics.t_iso", m.iter().map(|m| m.t_iso), 1e-6);
        check(
            &golden,
            "metrics.chamfer_dist",
            m.iter().map(|m| m.chamfer_mod),
            1e-6,
        );
        check(&golden, "metrics.add", m.iter().map(|m| m.add), 1e-6);
        check(&golden, "metrics.adi", m.iter().map(|m| m.adi), 1e-6);
    }
}

#[test]
fn without_a_clean_cloud_the_target_stands_in() {
    for golden in Golden::available("metrics.safetensors") {
        let m = measure(&golden, false);
        check(
            &golden,
            "metrics.no_raw.chamfer_dist",
            m.iter().map(|m| m.chamfer_mod),
            1e-6,
        );
        check(&golden, "metrics.no_raw.add", m.iter().map(|m| m.add), 1e-6);
        check(&golden, "metrics.no_raw.adi", m.iter().map(|m| m.adi), 1e-6);
    }
}

#[test]
fn area_under_the_curve_equals_the_reference() {
    for golden in Golden::available("metrics.safetensors") {
        let (_, adi) = golden.f32("metrics.auc_example.adi");
        let adi: Vec<f64> = adi.into_iter().map(f64::from).collect();
        check(&golden, "metrics.auc_example.auc", [auc(&adi)], 1e-6);
    }
}

#[test]
fn summaries_equal_the_reference() {
    for golden in Golden::available("metrics.safetensors") {
        let s = Summary::of(&measure(&golden, true));
        check(&golden, "metrics.summary.r_mae", [s.r_mae_deg], 1e-4);
        check(&golden, "metrics.summary.t_mae", [s.t_mae], 1e-6);
        check(&golden, "metrics.summary.r_iso", [s.r_iso_deg], 2e-3);
        check(&golden, "metrics.summary.t_iso", [s.t_iso], 1e-6);
        check(
            &golden,
            "metrics.summary.chamfer_dist",
            [s.chamfer_mod],
            1e-6,
        );
        check(
            &golden,
            "metrics.summary.add_auc10",
            [s.add_auc_pct / 100.0],
            1e-6,
        );
        check(
            &golden,
            "metrics.summary.adi_auc10",
            [s.adi_auc_pct / 100.0],
            1e-6,
        );
    }
}

/// The reference has no quartiles, so those of its errors, pair by pair, are compared. Of eight values they lie a quarter,
/// a half and three quarters of the way between the second and third, the fourth and fifth, the sixth and seventh.
#[test]
fn quartiles_are_those_of_the_reference_s_errors() {
    for golden in Golden::available("metrics.safetensors") {
        let near = |name: &str, ours: [f64; 3], tolerance: f64| {
            let mut theirs = golden.f32(name).1;
            theirs.sort_by(f32::total_cmp);
            assert_eq!(theirs.len(), 8);
            let between = |i: usize, share: f64| {
                let [a, b] = [theirs[i], theirs[i + 1]].map(f64::from);
                a + share * (b - a)
            };
            let theirs = [between(1, 0.75), between(3, 0.5), between(5, 0.25)];
            for (a, b) in ours.iter().zip(theirs) {
                assert!((a - b).abs() < tolerance, "{name}: {ours:?}, {theirs:?}");
            }
        };
        let s = Summary::of(&measure(&golden, true));
        near("metrics.r_mae", s.quartiles.r_mae_deg, 1e-4);
        near("metrics.t_mae", s.quartiles.t_mae, 1e-6);
        near("metrics.r_iso", s.quartiles.r_iso_deg, 1e-2);
        near("metrics.t_iso", s.quartiles.t_iso, 1e-6);
        near("metrics.chamfer_dist", s.quartiles.chamfer_mod, 1e-6);
        near("metrics.add", s.quartiles.add, 1e-6);
        near("metrics.adi", s.quartiles.adi, 1e-6);
        let medians = [s.r_iso_median_deg, s.t_iso_median, s.chamfer_mod_median];
        let q = s.quartiles;
        assert_eq!(medians, [q.r_iso_deg[1], q.t_iso[1], q.chamfer_mod[1]]);

        let pairs = measure(&golden, false);
        let s = Summary::of(&pairs);
        near("metrics.no_raw.chamfer_dist", s.quartiles.chamfer_mod, 1e-6);
        near("metrics.no_raw.add", s.quartiles.add, 1e-6);
        near("metrics.no_raw.adi", s.quartiles.adi, 1e-6);
        let theirs =
            |name: &str| -> Vec<f64> { golden.f32(name).1.into_iter().map(f64::from).collect() };
        let area = |name: &str| 100.0 * auc(&theirs(name));
        assert!((s.add_auc_pct - area("metrics.no_raw.add")).abs() < 1e-9);
        assert!((s.adi_auc_pct - area("metrics.no_raw.adi")).abs() < 1e-9);

        // The lists for plots are the errors of each pair, in the order of the pairs.
        let errors = Errors::of(&pairs);
        check(
            &golden,
            "metrics.no_raw.chamfer_dist",
            errors.chamfer_mod,
            1e-6,
        );
        check(&golden, "metrics.no_raw.add", errors.add, 1e-6);
        check(&golden, "metrics.no_raw.adi", errors.adi, 1e-6);
        check(&golden, "metrics.r_iso", errors.r_iso_deg, 1e-2);
        check(&golden, "metrics.t_iso", errors.t_iso, 1e-6);
    }
}

/// Moving both clouds, and the true pose with them, changes no error but that of the Euler angles.
#[test]
fn errors_do_not_depend_on_the_frame_of_the_source() {
    let golden = Golden::extract("metrics.safetensors");
    let (source, target) = (
        golden.clouds("metrics.points_src"),
        golden.clouds("metrics.points_ref"),
    );
    let truth = poses(&golden, "metrics.transform_gt");
    let shift = Pose {
        translation: Vec3::new(0.5, -2.0, 1.0),
        ..Pose::IDENTITY
    };
    let estimates = poses(&golden, "metrics.pred");
    for (i, estimate) in estimates.into_iter().enumerate() {
        let here = GroundTruth::new(&source[i], &target[i], None, truth[i]).expect("valid");
        let shifted: Vec<[f32; 3]> = source[i]
            .iter()
            .map(|&p| shift.inverse().apply(Vec3::from(p)).to_array())
            .collect();
        let there =
            GroundTruth::new(&shifted, &target[i], None, truth[i].after(shift)).expect("valid");
        let (a, b) = (here.measure(estimate), there.measure(estimate.after(shift)));
        assert!((a.adi - b.adi).abs() < 1e-5 && (a.chamfer_mod - b.chamfer_mod).abs() < 1e-5);
        assert!((a.r_iso_deg - b.r_iso_deg).abs() < 1e-3);
    }
}
