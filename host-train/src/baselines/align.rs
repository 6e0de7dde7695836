//! Least-squares rigid alignment of matched points.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};

/// Directions along which the points constrain the motion by less than this share of the best constrained one
/// are left alone.
const RANK_TOLERANCE: f64 = 1e-12;

/// The rotation and translation that take the first points to the second with the least weighted squared error
/// (Kabsch 1976, with Umeyama's sign so that the result is never a reflection). Items are (from, to, weight), with
/// positive weights.
pub(super) fn kabsch(
    pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>, f64)> + Clone,
) -> (Matrix3<f64>, Vector3<f64>) {
    let (mut sum_a, mut sum_b, mut total) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for (a, b, weight) in pairs.clone() {
        sum_a += weight * a;
        sum_b += weight * b;
        total += weight;
    }
    let (mean_a, mean_b) = (sum_a / total, sum_b / total);
    let mut covariance = Matrix3::zeros();
    for (a, b, weight) in pairs {
        covariance += (weight * (b - mean_b)) * (a - mean_a).transpose();
    }
    // Singular values come in descending order: the last direction is the one to flip.
    let svd = covariance.svd(true, true);
    let u = svd.u.expect("U was asked for");
    let v_t = svd.v_t.expect("V was asked for");
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    (rotation, mean_b - rotation * mean_a)
}

/// One Gauss-Newton step on the squared point-to-plane distances (Chen and Medioni 1991). Items are (point, point
/// of the plane, the plane's unit normal). The solved angles about x, y, z are applied in this order; motions that
/// the planes do not constrain are left out.
pub(super) fn plane_step(
    pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>, Vector3<f64>)>,
) -> (Matrix3<f64>, Vector3<f64>) {
    let (mut normal_matrix, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    for (point, on_plane, normal) in pairs {
        let (turn, residual) = (point.cross(&normal), (point - on_plane).dot(&normal));
        let j = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
        normal_matrix += j * j.transpose();
        gradient += residual * j;
    }
    let eigen = normal_matrix.symmetric_eigen();
    let smallest = RANK_TOLERANCE * eigen.eigenvalues.max();
    let mut step = Vector6::zeros();
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > smallest {
            step -= vector.dot(&gradient) / value * vector;
        }
    }
    let rotation = Rotation3::from_euler_angles(step[0], step[1], step[2]);
    (*rotation.matrix(), step.fixed_rows::<3>(3).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_planar_cloud_is_turned_not_mirrored() {
        let pairs: Vec<_> = (0..40)
            .map(|i| Vector3::new((i % 8) as f64, (i / 8) as f64, 0.0))
            .map(|p| (p, Vector3::new(-p.y, p.x, 2.0), 1.0))
            .collect();
        let (r, t) = kabsch(pairs.iter().copied());
        assert!((r.determinant() - 1.0).abs() < 1e-12 && (t.z - 2.0).abs() < 1e-12);
        assert!(pairs.iter().all(|(p, q, _)| (r * p + t - q).norm() < 1e-9));
    }

    #[test]
    fn weights_count_like_repeated_points() {
        let point = |i: usize| Vector3::new(i as f64, (i * i % 7) as f64, (3 * i % 5) as f64);
        let moved = |i: usize| point(i) + Vector3::new(1.0, 0.1 * i as f64, 0.0);
        let weighted = kabsch((0..9).map(|i| (point(i), moved(i), (1 + i % 2) as f64)));
        let repeated = (0..9).chain((0..9).filter(|i| i % 2 == 1));
        let repeated = kabsch(repeated.map(|i| (point(i), moved(i), 1.0)));
        assert!((weighted.0 - repeated.0).norm() < 1e-12);
        assert!((weighted.1 - repeated.1).norm() < 1e-12);
    }

    #[test]
    fn planes_pull_along_their_normals_only() {
        let floor = (0..20).map(|i| {
            let p = Vector3::new((i % 5) as f64, (i / 5) as f64, 0.3);
            (p, Vector3::new(9.0, -4.0, 0.0), Vector3::z())
        });
        let (r, t) = plane_step(floor);
        assert!((r - Matrix3::identity()).norm() < 1e-12, "{r}");
        assert!((t - Vector3::new(0.0, 0.0, -0.3)).norm() < 1e-12, "{t}");
        let (r, t) = plane_step(std::iter::empty());
        assert!(r == Matrix3::identity() && t == Vector3::zeros());
    }
}
