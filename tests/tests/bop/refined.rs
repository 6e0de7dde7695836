//! Reported poses, from registrations in normalised units.

use super::*;
use host_train::bop::synth::ESTIMATES_FILE;
use host_train::dataset::bop::{Estimate, Models, read_results, write_results};
use std::collections::BTreeMap;

/// A pose in f64, as a homogeneous matrix.
type Matrix = nalgebra::Matrix4<f64>;

fn matrix(pose: &Pose) -> Matrix {
    let rows = pose.to_rows();
    Matrix::from_fn(|r, c| match (r, c) {
        (3, 3) => 1.0,
        (3, _) => 0.0,
        _ => f64::from(rows[r][c]),
    })
}

/// Estimates that are true need no registration. A registration in normalised units gives the reported pose if it is
/// carried through the chain of homogeneous matrices.
#[test]
fn refined_poses_are_the_product_of_the_matrices() {
    let dir = generated(0.0, 9);
    let root = dir.path();
    let estimates = root.join(ESTIMATES_FILE);
    // Each gets its own score, since an object may be in an image twice.
    let mut given = read_results(&estimates).expect("estimates");
    for (i, estimate) in given.iter_mut().enumerate() {
        estimate.score = i as f32;
    }
    write_results(&estimates, &given).expect("written");
    let found = Refinements::open(root, &estimates, None, 3).expect("opened");
    let pairs = found.set.source.len();
    assert!(pairs >= 8, "{pairs}");

    // True registrations give true poses, and every row is perfect.
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
        // The change of pose, back in normalised units: N (E^-1 R)^-1 N^-1 has the step's rotation, and its shift is
        // the step's, scaled, about the target's mean. Mean and scale are those of the model's surface.
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
        // The target is a random quarter of the surface's points, so its mean is not exactly theirs.
        assert!((back - expected).norm() < 0.08, "{back} {expected}");
    }
    assert_eq!(moved + unrefined, results.len());
}
