//! BOP's average recall: Hodaň et al., BOP Challenge 2020 on 6D Object Localization, section 2.
//!
//! | error | definition for an estimated pose | right below | |
//! |---|---|---|---|
//! | VSD | share of the visible pixels of both poses whose distances from the camera differ by τ or more, or that only one of them has | θ = .05, .1, … .5 | for each of τ = .05, .1, … .5 diameters |
//! | MSSD | largest distance of a vertex between both poses, least over the object's symmetries | .05, .1, … .5 diameters | |
//! | MSPD | the same in the image, pixels | 5, 10, … 50 | of an image that is 640 pixels wide |
//!
//! A recall is the share of all poses that are right, including those that were not estimated; an error's average
//! recall is the mean of its recalls over the thresholds. AR is the mean of the three.

use crate::dataset::bop::BopModel;
use crate::dataset::depth::DepthImage;
use crate::dataset::raster::Pinhole;
use glam::{Affine3A, Vec3};
use reagent_core::Pose;
use serde::Serialize;

/// Number of thresholds of each error.
const THRESHOLDS: usize = 10;
/// First threshold of VSD and MSSD, and the distance to the next.
const STEP: f64 = 0.05;
/// The same for MSPD, pixels.
const PIXEL_STEP: f64 = 5.0;
/// Width of an image to which these apply, pixels.
const WIDTH: f64 = 640.0;
/// How far a surface may lie behind the measured depth and still count as visible, millimetres.
const VISIBLE_MM: f32 = 15.0;

/// Errors of one estimated pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseErrors {
    /// Visible surface discrepancy for each τ.
    pub vsd: [f64; THRESHOLDS],
    /// Maximum symmetry-aware surface distance, diameters.
    pub mssd: f64,
    /// Maximum symmetry-aware projection distance, pixels of an image that is 640 pixels wide.
    pub mspd: f64,
}

impl PoseErrors {
    /// Errors of an object that was not estimated.
    pub const MISSING: PoseErrors = PoseErrors {
        vsd: [1.0; THRESHOLDS],
        mssd: f64::INFINITY,
        mspd: f64::INFINITY,
    };

    /// Errors of an estimate; poses are camera_from_model, in millimetres like `seen`.
    pub fn of(model: &BopModel, seen: &DepthImage, truth: &Pose, estimate: &Pose) -> PoseErrors {
        let project = |p: Vec3| match p.z > 0.0 {
            true => seen.camera.project(p).extend(0.0),
            false => Vec3::INFINITY,
        };
        let wide = WIDTH / seen.camera.size[0] as f64;
        PoseErrors {
            vsd: visible_surface_discrepancy(model, seen, truth, estimate),
            mssd: largest_distance(model, truth, estimate, |p| p) / model.diameter_mm,
            mspd: largest_distance(model, truth, estimate, project) * wide,
        }
    }
}

/// Average recalls, percent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AverageRecall {
    /// Of the visible surface discrepancy.
    pub ar_vsd: f64,
    /// Of the maximum symmetry-aware surface distance.
    pub ar_mssd: f64,
    /// Of the maximum symmetry-aware projection distance.
    pub ar_mspd: f64,
    /// The mean of the three.
    pub ar: f64,
}

impl AverageRecall {
    /// Average recalls over the errors of all poses.
    pub fn of(errors: impl IntoIterator<Item = PoseErrors>) -> AverageRecall {
        let errors: Vec<PoseErrors> = errors.into_iter().collect();
        let recalls = |error: &dyn Fn(&PoseErrors) -> f64, step: f64| {
            let below = |k: usize| {
                let right = errors.iter().filter(|e| error(e) < step * k as f64);
                right.count() as f64
            };
            let all = (THRESHOLDS * errors.len()) as f64;
            100.0 * (1..=THRESHOLDS).map(below).sum::<f64>() / all
        };
        let of_tau = |tau: usize| recalls(&|e| e.vsd[tau], STEP);
        let ar_vsd = (0..THRESHOLDS).map(of_tau).sum::<f64>() / THRESHOLDS as f64;
        let ar_mssd = recalls(&|e| e.mssd, STEP);
        let ar_mspd = recalls(&|e| e.mspd, PIXEL_STEP);
        AverageRecall {
            ar_vsd,
            ar_mssd,
            ar_mspd,
            ar: (ar_vsd + ar_mssd + ar_mspd) / 3.0,
        }
    }
}

/// Largest distance of a vertex between estimate and truth, both seen through `of`; the least over the symmetries.
fn largest_distance(
    model: &BopModel,
    truth: &Pose,
    estimate: &Pose,
    of: impl Fn(Vec3) -> Vec3,
) -> f64 {
    let placed = |pose: &Pose| -> Vec<Vec3> {
        let vertices = model.mesh.vertices.iter();
        vertices.map(|&v| of(pose.apply(v))).collect()
    };
    let estimated = placed(estimate);
    let mut least = f32::INFINITY;
    for symmetry in &model.symmetries {
        let turned = truth.after(*symmetry);
        let mut largest = 0.0f32;
        for (v, at) in model.mesh.vertices.iter().zip(&estimated) {
            let apart = of(turned.apply(*v)).distance_squared(*at);
            // Infinity minus infinity: neither is in the image.
            largest = largest.max(if apart.is_nan() { f32::INFINITY } else { apart });
            if largest >= least {
                break;
            }
        }
        least = least.min(largest);
    }
    f64::from(least).sqrt()
}

/// VSD for each τ; 1 if neither pose has a visible pixel.
fn visible_surface_discrepancy(
    model: &BopModel,
    seen: &DepthImage,
    truth: &Pose,
    estimate: &Pose,
) -> [f64; THRESHOLDS] {
    let [of_truth, of_estimate] = [truth, estimate].map(|pose| {
        let place = Affine3A::from_mat3_translation(pose.rotation, pose.translation);
        seen.camera.inverse_depths(&model.mesh, &place)
    });
    let (mut visible, mut wrong) = (0u32, [0u32; THRESHOLDS]);
    for (pixel, (&inverse_truth, &inverse_estimate)) in
        of_truth.iter().zip(&of_estimate).enumerate()
    {
        if inverse_truth == 0.0 && inverse_estimate == 0.0 {
            continue;
        }
        // Converts depths along the ray to distances.
        let ray = ray_length(&seen.camera, pixel);
        let measured = seen.depth(pixel) * ray;
        let is_seen = |inverse: f32| {
            inverse > 0.0 && (measured == 0.0 || ray / inverse - measured <= VISIBLE_MM)
        };
        let in_truth = is_seen(inverse_truth);
        let in_estimate = is_seen(inverse_estimate) || in_truth && inverse_estimate > 0.0;
        if !(in_truth || in_estimate) {
            continue;
        }
        visible += 1;
        let apart = match in_truth && in_estimate {
            true => {
                f64::from((ray / inverse_truth - ray / inverse_estimate).abs()) / model.diameter_mm
            }
            false => f64::INFINITY,
        };
        for (k, wrong) in (1u32..).zip(&mut wrong) {
            *wrong += u32::from(apart >= STEP * f64::from(k));
        }
    }
    wrong.map(|wrong| match visible {
        0 => 1.0,
        _ => f64::from(wrong) / f64::from(visible),
    })
}

/// Length of the ray through a pixel to depth 1.
fn ray_length(camera: &Pinhole, pixel: usize) -> f32 {
    let width = camera.size[0];
    camera.ray(pixel % width, pixel / width).length()
}

#[cfg(test)]
mod tests;
