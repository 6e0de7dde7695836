//! The units in which a pose is refined, and the way back to millimetres in the camera's frame.
//!
//! Let μ be the mean of the target's points and s the distance of the farthest from it. `n = (m - μ) / s` takes the
//! model's frame to normalised units, and a pose `m' = R m + t` becomes `n' = R n + (t + R μ - μ) / s`. (The authors'
//! code takes `t / s`, which is exact only if the mean is zero.)

use crate::dataset::Point;
use crate::dataset::mesh;
use glam::Vec3;
use reagent_core::Pose;

/// Mean and extent of a target, millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalisation {
    /// Mean of the target's points, in the model's frame.
    pub centre: Vec3,
    /// Distance of the farthest point from the mean.
    pub scale: f32,
}

impl Normalisation {
    /// Moves the target's mean to the origin and scales its farthest point to distance 1, and does the same to the
    /// source. `None`, with nothing changed, if all points of the target coincide.
    pub fn of(source: &mut [Point], target: &mut [Point]) -> Option<Normalisation> {
        let (centre, scale) = mesh::normalise(target)?;
        let frame = Normalisation { centre, scale };
        for point in source {
            *point = frame.point(Vec3::from_array(*point));
        }
        Some(frame)
    }

    /// A point of the model's frame, millimetres, in normalised units.
    pub fn point(&self, point: Vec3) -> Point {
        ((point - self.centre) / self.scale).to_array()
    }

    /// A pose in the model's frame, millimetres, converted to normalised units.
    pub fn normalised(&self, pose: &Pose) -> Pose {
        let shift = pose.translation + pose.rotation * self.centre - self.centre;
        Pose {
            rotation: pose.rotation,
            translation: shift / self.scale,
        }
    }

    /// A pose in normalised units, converted to the model's frame, millimetres: the inverse of [`Self::normalised`].
    pub fn restored(&self, pose: &Pose) -> Pose {
        let shift = self.scale * pose.translation + self.centre - pose.rotation * self.centre;
        Pose {
            rotation: pose.rotation,
            translation: shift,
        }
    }

    /// The refined pose, camera_from_model, millimetres. `target_from_source` registers, in normalised units, a source
    /// that `estimate` placed in the model's frame.
    pub fn refined(&self, estimate: &Pose, target_from_source: &Pose) -> Pose {
        let model_from_estimated = self.restored(target_from_source);
        estimate.after(model_from_estimated.inverse())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::pose::rotation_from_euler;

    fn pose(x: f32, t: [f32; 3]) -> Pose {
        Pose {
            rotation: rotation_from_euler(Vec3::new(x, -0.4 * x, 0.7)),
            translation: Vec3::from_array(t),
        }
    }

    /// A camera sees points of a model at the true pose. They are placed by the estimate, normalised, and registered
    /// onto the model; the refined pose is then the true one.
    #[test]
    fn a_perfect_registration_gives_the_true_pose() {
        let model: Vec<Vec3> = (0..40)
            .map(|i| Vec3::new(i as f32, (i * i % 17) as f32, 20.0 + (i % 7) as f32) * 3.0)
            .collect();
        let truth = pose(1.1, [30.0, -60.0, 900.0]);
        let estimate = pose(1.4, [25.0, -50.0, 930.0]);
        let placed = |p: &Vec3| estimate.inverse().apply(truth.apply(*p)).to_array();
        let mut source: Vec<Point> = model.iter().map(placed).collect();
        let mut target: Vec<Point> = model.iter().map(|p| p.to_array()).collect();
        let frame = Normalisation::of(&mut source, &mut target).expect("an extent");
        assert!(frame.centre.length() > 50.0, "a mean far from the origin");

        let registering = frame.normalised(&truth.inverse().after(estimate));
        for (s, t) in source.iter().zip(&target) {
            let moved = registering.apply(Vec3::from_array(*s));
            assert!((moved - Vec3::from_array(*t)).length() < 1e-5);
        }
        let refined = frame.refined(&estimate, &registering);
        for p in &model {
            assert!((refined.apply(*p) - truth.apply(*p)).length() < 2e-3);
        }
        let unchanged = frame.refined(&estimate, &Pose::IDENTITY);
        assert!((unchanged.translation - estimate.translation).length() < 1e-3);
    }

    #[test]
    fn restoring_undoes_normalising() {
        let frame = Normalisation {
            centre: Vec3::new(4.0, -8.0, 15.0),
            scale: 16.0,
        };
        let there = pose(-0.8, [3.0, 2.0, 1.0]);
        let back = frame.restored(&frame.normalised(&there));
        assert!((back.translation - there.translation).length() < 1e-5);
        assert!(Normalisation::of(&mut [], &mut [[1.0; 3]; 4]).is_none());
    }
}
