//! Initial poses with errors as large as PoseCNN's on LINEMOD.
//!
//! The errors are chosen so that the AD of estimates of non-symmetric built-in shapes is below .10, .05 and .02
//! diameters about as often as PoseCNN's on LINEMOD: 62.8, 26.9 and 3.3 percent (the paper's tables). Measured on two
//! sets of scenes of 32 shapes: 66 and 71, 30 and 26, 2 and 3 percent. PoseCNN estimates the object's centre in the
//! image and its distance: the centre errs by a few pixels, the distance by centimetres.

use crate::dataset::raster::Pinhole;
use crate::random::Rng;
use glam::{Mat3, Vec2, Vec3};
use rand_distr::{Distribution, StandardNormal};
use reagent_core::Pose;

/// Rotation error: standard deviation of each component of the rotation vector, degrees.
const ROTATION_SIGMA_DEG: f32 = 6.0;
/// Standard deviation of the centre in an image of 640 columns, pixels.
const CENTRE_SIGMA: f32 = 2.0;
/// Standard deviation of the distance, millimetres.
const DEPTH_SIGMA_MM: f32 = 13.0;
/// Standard deviation of the logarithm of a factor that all errors of an estimate share: some images are hard.
const SPREAD: f32 = 0.5;

/// An initial estimate of a pose.
pub fn estimate(camera_from_model: &Pose, camera: &Pinhole, rng: &mut Rng) -> Pose {
    let mut normal = || -> f32 { StandardNormal.sample(rng) };
    let hard = (SPREAD * normal()).exp();
    let turn = Vec3::new(normal(), normal(), normal()) * (hard * ROTATION_SIGMA_DEG.to_radians());
    let pixels = hard * CENTRE_SIGMA * camera.size[0] as f32 / 640.0;
    let shift = Vec2::new(normal(), normal()) * pixels;
    let nearer = normal() * hard * DEPTH_SIGMA_MM;
    let there = camera_from_model.translation;
    let seen = camera.project(there) + shift;
    let depth = (there.z + nearer).max(1.0);
    Pose {
        rotation: camera_from_model.rotation
            * Mat3::from_axis_angle(turn.normalize_or(Vec3::Z), turn.length()),
        translation: ((seen - camera.centre) / camera.focal).extend(1.0) * depth,
    }
}
