//! Point-to-point ICP, the baseline beside the policy (Besl and McKay 1992), in f64.
//!
//! Same rules as Open3D's `registration_icp`, so that numbers compare: correspondences are the nearest
//! target points within a fixed distance; each iteration solves for the rigid transform in closed form
//! (Kabsch); it stops when fitness and RMSE both change by less than 1e-6, or after 30 iterations.

use crate::dataset::Point;
use crate::metrics::widen;
use crate::neighbours::{Neighbours, check_finite, wide};
use nalgebra::{Matrix3, Vector3};
use reagent_core::{Error, Pose};

/// When to stop, and what counts as a correspondence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IcpSettings {
    /// Farthest a source point may be from its nearest target point, in the clouds' units.
    pub max_correspondence: f64,
    /// Most iterations.
    pub max_iterations: usize,
    /// Change of the fraction of source points that have a correspondence, below which it may stop.
    pub fitness_change: f64,
    /// Change of the RMSE over the correspondences, in the clouds' units, below which it may stop.
    pub rmse_change: f64,
}

impl Default for IcpSettings {
    fn default() -> IcpSettings {
        IcpSettings {
            max_correspondence: 0.5,
            max_iterations: 30,
            fitness_change: 1e-6,
            rmse_change: 1e-6,
        }
    }
}

/// Where ICP ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IcpResult {
    /// The estimate.
    pub target_from_source: Pose,
    /// Iterations made.
    pub iterations: usize,
    /// Fraction of source points with a correspondence at the end.
    pub fitness: f64,
    /// Root mean square distance over those, in the clouds' units; 0 without any.
    pub rmse: f64,
    /// Whether the changes fell below the settings' before the iterations ran out.
    pub converged: bool,
}

/// Registers `source [N, 3]` to `target [M, 3]`, from the plain transform `initial`.
///
/// Refuses empty clouds, coordinates that are not finite and an initial pose that is not rigid.
pub fn point_to_point(
    source: &[Point],
    target: &[Point],
    initial: Pose,
    settings: &IcpSettings,
) -> Result<IcpResult, Error> {
    if source.is_empty() {
        return Err(Error::EmptyCloud);
    }
    check_finite(source)?;
    let tree = Neighbours::new(target)?;
    let (mut rotation, mut translation) = widen(initial.checked()?);

    let mut matches = Matches::find(source, target, &tree, &rotation, &translation, settings);
    let (mut iterations, mut converged) = (0, false);
    while iterations < settings.max_iterations && !converged && matches.pairs.len() >= 3 {
        (rotation, translation) = kabsch(&matches.pairs);
        iterations += 1;
        let next = Matches::find(source, target, &tree, &rotation, &translation, settings);
        converged = (next.fitness - matches.fitness).abs() < settings.fitness_change
            && (next.rmse - matches.rmse).abs() < settings.rmse_change;
        matches = next;
    }
    Ok(IcpResult {
        target_from_source: narrow(&rotation, &translation),
        iterations,
        fitness: matches.fitness,
        rmse: matches.rmse,
        converged,
    })
}

/// Correspondences under one pose: each source point, untransformed, with its target point.
struct Matches {
    pairs: Vec<(Vector3<f64>, Vector3<f64>)>,
    fitness: f64,
    rmse: f64,
}

impl Matches {
    fn find(
        source: &[Point],
        target: &[Point],
        tree: &Neighbours,
        rotation: &Matrix3<f64>,
        translation: &Vector3<f64>,
        settings: &IcpSettings,
    ) -> Matches {
        let limit = settings.max_correspondence * settings.max_correspondence;
        let mut pairs = Vec::with_capacity(source.len());
        let mut sum = 0.0;
        for &point in source {
            let point = wide(point);
            let (index, squared) = tree.nearest(rotation * point + translation);
            if squared < limit {
                pairs.push((point, wide(target[index])));
                sum += squared;
            }
        }
        Matches {
            fitness: pairs.len() as f64 / source.len() as f64,
            rmse: (sum / pairs.len().max(1) as f64).sqrt(),
            pairs,
        }
    }
}

/// The rotation and translation that take the first points to the second with the least squared error
/// (Kabsch 1976, with Umeyama's sign so that the result is never a mirror image).
fn kabsch(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> (Matrix3<f64>, Vector3<f64>) {
    let n = pairs.len() as f64;
    let (sum_a, sum_b) = pairs.iter().fold(
        (Vector3::zeros(), Vector3::zeros()),
        |(a, b): (Vector3<f64>, Vector3<f64>), &(p, q)| (a + p, b + q),
    );
    let (mean_a, mean_b) = (sum_a / n, sum_b / n);
    let covariance = pairs
        .iter()
        .fold(Matrix3::zeros(), |sum: Matrix3<f64>, &(p, q)| {
            sum + (q - mean_b) * (p - mean_a).transpose()
        });
    // Singular values come in descending order: the smallest direction is the one to flip.
    let svd = covariance.svd(true, true);
    let u = svd.u.expect("U was asked for");
    let v_t = svd.v_t.expect("V was asked for");
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    (rotation, mean_b - rotation * mean_a)
}

fn narrow(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Pose {
    Pose::from_rows(std::array::from_fn(|i| {
        let r = rotation.row(i);
        [r[0], r[1], r[2], translation[i]].map(|x| x as f32)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};
    use glam::Vec3;
    use rand::RngExt;
    use reagent_core::pose::rotation_from_euler;

    fn moved(cloud: &[Point], pose: Pose) -> Vec<Point> {
        cloud
            .iter()
            .map(|&p| pose.apply(Vec3::from(p)).to_array())
            .collect()
    }

    #[test]
    fn finds_a_small_offset_exactly() {
        let mut rng = stream(3, Purpose::Pairs, 0);
        let source: Vec<Point> = (0..500)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect();
        let pose = Pose {
            rotation: rotation_from_euler(Vec3::new(0.02, -0.03, 0.01)),
            translation: Vec3::new(0.02, 0.01, -0.03),
        };
        let target = moved(&source, pose);
        let found = point_to_point(&source, &target, Pose::IDENTITY, &IcpSettings::default())
            .expect("valid clouds");
        assert!(
            found.converged && found.rmse < 1e-6 && found.fitness == 1.0,
            "{found:?}"
        );
        assert!((found.target_from_source.translation - pose.translation).length() < 1e-5);
        assert!(
            found
                .target_from_source
                .rotation
                .abs_diff_eq(pose.rotation, 1e-5)
        );
    }

    #[test]
    fn a_planar_cloud_is_turned_not_mirrored() {
        let pairs: Vec<_> = (0..40)
            .map(|i| Vector3::new((i % 8) as f64, (i / 8) as f64, 0.0))
            .map(|p| (p, Vector3::new(-p.y, p.x, 2.0)))
            .collect();
        let (r, t) = kabsch(&pairs);
        assert!((r.determinant() - 1.0).abs() < 1e-12 && (t.z - 2.0).abs() < 1e-12);
        assert!(pairs.iter().all(|(p, q)| (r * p + t - q).norm() < 1e-9));
    }

    #[test]
    fn clouds_out_of_reach_leave_the_initial_pose() {
        let near = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
        let far = near.map(|p| p.map(|x| x + 10.0));
        let found = point_to_point(&near, &far, Pose::IDENTITY, &IcpSettings::default())
            .expect("valid clouds");
        assert_eq!(found.target_from_source, Pose::IDENTITY);
        assert!(!found.converged && found.fitness == 0.0);
    }

    #[test]
    fn bad_clouds_are_refused() {
        let run = |s: &[Point], t: &[Point]| {
            point_to_point(s, t, Pose::IDENTITY, &IcpSettings::default()).err()
        };
        assert_eq!(run(&[], &[[0.0; 3]]), Some(Error::EmptyCloud));
        assert_eq!(run(&[[0.0; 3]], &[]), Some(Error::EmptyCloud));
        assert_eq!(
            run(&[[f32::INFINITY; 3]], &[[0.0; 3]]),
            Some(Error::NotFinite { index: 0 })
        );
    }
}
