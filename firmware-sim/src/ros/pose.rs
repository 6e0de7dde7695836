//! Where the model is in the frame of the cloud, as ROS says it.

use super::messages::Pose;
use host_train::pose64::Pose64;
use host_train::register::prepared::Prepared;
use host_train::register::request::Done;
use nalgebra::{Matrix6, Rotation3, UnitQuaternion, Vector3};

/// The inverse of a registration's pose, whose source is the cloud and whose target the model.
pub(crate) fn of(target_from_source: &Pose64) -> Pose {
    let rotation = target_from_source.rotation.transpose();
    let position = -(rotation * target_from_source.translation);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Pose {
        position: position.into(),
        orientation: turn.coords.into(),
    }
}

/// The pose's covariance along the axes of the cloud's frame: position first, then turns about these axes. `None` if the pose was
/// not refined.
pub(crate) fn covariance(done: &Done, model: &Prepared<'_>) -> Option<[[f64; 6]; 6]> {
    let covariance = done.found.answer.refinement?.refined.covariance;
    let near = covariance.about.to_array().map(f64::from);
    let about = Vector3::from(near) + Vector3::from(model.origin);
    Some(of_inverse(covariance.matrix, about, &done.pose))
}

/// A registration's error `(ω, v)` is along the model's axes and about its centroid `a`. Let `R` be the rotation from the model to
/// the cloud, `p` the model's origin in the cloud's frame, and `a'` its centroid there. Then the inverse errs by the turn `-R ω`
/// and the shift `-R v + (p - a') × R ω`.
fn of_inverse(
    matrix: [[f32; 6]; 6],
    about: Vector3<f64>,
    target_from_source: &Pose64,
) -> [[f64; 6]; 6] {
    let given = Matrix6::from_fn(|i, j| f64::from(matrix[i][j]));
    let rotation = target_from_source.rotation.transpose();
    let arm = -(rotation * about);
    let mut change = Matrix6::zeros();
    let blocks = [
        (0, 0, arm.cross_matrix() * rotation),
        (0, 3, -rotation),
        (3, 0, -rotation),
    ];
    for (row, column, block) in blocks {
        let mut place = change.fixed_view_mut::<3, 3>(row, column);
        place.copy_from(&block);
    }
    let moved = change * given * change.transpose();
    std::array::from_fn(|i| std::array::from_fn(|j| moved[(i, j)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn the_pose_is_the_inverse_of_the_registration() {
        // A quarter turn about z, then a shift.
        let pose = Pose64::from_rows([
            [0.0, -1.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 2.0],
            [0.0, 0.0, 1.0, 3.0],
        ]);
        let found = of(&pose);
        assert_eq!(found.position, [-2.0, 1.0, -3.0]);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for (value, expected) in found.orientation.iter().zip([0.0, 0.0, -half, half]) {
            assert!((value - expected).abs() < 1e-12, "{found:?}");
        }
        let rotation: Matrix3<f64> = UnitQuaternion::from_quaternion(found.orientation.into())
            .to_rotation_matrix()
            .into_inner();
        for point in [[0.0; 3], [1.0, -2.0, 0.5]] {
            let back = rotation * Vector3::from(pose.apply(point)) + Vector3::from(found.position);
            assert!((back - Vector3::from(point)).amax() < 1e-12);
        }
    }

    /// Compares with poses that err a little in one direction after the other, by the core's definition of the error.
    #[test]
    fn the_covariance_is_that_of_small_errors() {
        let turn = Rotation3::from_euler_angles(0.3, -0.8, 1.1);
        let pose = Pose64 {
            rotation: turn.into_inner(),
            translation: Vector3::new(0.4, -2.0, 1.5),
        };
        let about = Vector3::new(0.7, -0.2, 0.9);
        let here = of(&pose);
        let turned = |pose: &Pose| UnitQuaternion::from_quaternion(pose.orientation.into());
        for k in 0..6 {
            let mut error = [0.0; 6];
            error[k] = 1e-6;
            let [w, v] = [0, 3].map(|from| Vector3::from_column_slice(&error[from..][..3]));
            let erring = Rotation3::new(w).into_inner();
            let truth = Pose64 {
                rotation: erring * pose.rotation,
                translation: erring * (pose.translation - about) + about + v,
            };
            let there = of(&truth);
            let shift = Vector3::from(there.position) - Vector3::from(here.position);
            let angle = (turned(&there) * turned(&here).inverse()).scaled_axis();
            let found: Vec<f64> = shift.iter().chain(&angle).map(|x| x / 1e-6).collect();
            let mut given = [[0.0; 6]; 6];
            given[k][k] = 1.0;
            let covariance = of_inverse(given, about, &pose);
            for (i, row) in covariance.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    let expected = found[i] * found[j];
                    assert!(
                        (value - expected).abs() < 1e-4,
                        "{k} {i} {j}: {value} {expected}"
                    );
                }
            }
        }
    }
}
