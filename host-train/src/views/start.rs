//! Initial pose estimates with the errors of pose estimators.
//!
//! On real images of LINEMOD's occluded scene, the errors of three estimators are 3 to 6 degrees in the median and
//! 10 to 36 in one case of ten, and 9 to 23 mm, of which 7 to 21 mm lie along the viewing axis; the worst tenth
//! errs by five times that. Trackers and coarse searches give starts that are farther off.

use crate::augment::random_direction;
use crate::random::Rng;
use glam::{Mat3, Vec3};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use reagent_core::Pose;

/// Rotation of an estimator's error: standard deviation of each component of the rotation vector, degrees.
const ROTATION_SIGMA_DEG: f32 = 6.0;
/// Standard deviation along the viewing axis, millimetres.
const AXIAL_SIGMA_MM: f32 = 14.0;
/// Standard deviation across the viewing axis, millimetres.
const LATERAL_SIGMA_MM: f32 = 4.0;
/// Standard deviation of the logarithm of a factor that all errors of an estimate share: some images are hard.
const SPREAD: f32 = 0.6;
/// Shares of estimators' starts and of rough starts; the remaining starts are far off.
const SHARES: [f32; 2] = [0.6, 0.3];
/// Rough starts: largest angle, degrees; standard deviations along and across the viewing axis, millimetres.
const ROUGH: [f32; 3] = [30.0, 20.0, 6.0];
/// Far starts: the same.
const FAR: [f32; 3] = [80.0, 40.0, 30.0];
/// Longest translation error, in radii of the object: beyond it the policy has nothing of the object in reach.
/// Rotation errors are limited to those of far starts.
const FARTHEST: f32 = 0.9;

/// An initial estimate for an object of this radius, millimetres, in the frame of a camera that looks along z.
pub fn estimate(camera_from_model: &Pose, radius_mm: f32, rng: &mut Rng) -> Pose {
    let kind: f32 = rng.random();
    let normal = |rng: &mut Rng| -> f32 { StandardNormal.sample(rng) };
    let three = |rng: &mut Rng| Vec3::new(normal(rng), normal(rng), normal(rng));
    let hard = (SPREAD * normal(rng)).exp();
    let (turn, [axial, lateral]) = if kind < SHARES[0] {
        let turn = three(rng) * (hard * ROTATION_SIGMA_DEG.to_radians());
        (
            turn,
            [AXIAL_SIGMA_MM, LATERAL_SIGMA_MM].map(|sigma| hard * sigma),
        )
    } else {
        let rough = kind < SHARES[0] + SHARES[1];
        let [most, axial, lateral] = if rough { ROUGH } else { FAR };
        let angle = rng.random::<f32>() * most.to_radians();
        (random_direction(rng) * angle, [axial, lateral])
    };
    let shift = three(rng) * Vec3::new(lateral, lateral, axial);
    Pose {
        rotation: Mat3::from_axis_angle(
            turn.normalize_or(Vec3::Z),
            turn.length().min(FAR[0].to_radians()),
        ) * camera_from_model.rotation,
        translation: camera_from_model.translation + shift.clamp_length_max(FARTHEST * radius_mm),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    #[test]
    fn errors_are_those_of_estimators_with_some_far_starts() {
        let truth = Pose {
            translation: Vec3::Z * 800.0,
            ..Pose::IDENTITY
        };
        let errors: Vec<(f32, Vec3)> = (0..4000)
            .map(|i| {
                let pose = estimate(&truth, 100.0, &mut stream(3, Purpose::Augment, i));
                let cosine =
                    (pose.rotation.x_axis.x + pose.rotation.y_axis.y + pose.rotation.z_axis.z
                        - 1.0)
                        / 2.0;
                (
                    cosine.clamp(-1.0, 1.0).acos().to_degrees(),
                    pose.translation - truth.translation,
                )
            })
            .collect();
        let quantile = |q: f64, of: &dyn Fn(&(f32, Vec3)) -> f32| {
            crate::measure::metrics::quantile(errors.iter().map(|e| f64::from(of(e))).collect(), q)
        };
        let turn = |e: &(f32, Vec3)| e.0;
        assert!(
            (8.0..14.0).contains(&quantile(0.5, &turn)),
            "{}",
            quantile(0.5, &turn)
        );
        assert!(
            (25.0..60.0).contains(&quantile(0.9, &turn)),
            "{}",
            quantile(0.9, &turn)
        );
        let axial = |e: &(f32, Vec3)| e.1.z.abs();
        let lateral = |e: &(f32, Vec3)| e.1.truncate().length();
        assert!(quantile(0.5, &axial) > 1.5 * quantile(0.5, &lateral));
        assert!(
            errors
                .iter()
                .all(|e| e.1.length() < 90.1 && e.0 < FAR[0] + 0.1)
        );
    }
}
