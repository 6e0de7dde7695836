//! Augmentations and rigid offsets, always applied to fresh copies of a cloud.
//!
//! Distributions and their order are those of the paper's experiments; values that the text does not give are from the
//! authors' code.

use crate::dataset::Point;
use crate::dataset::pairs::Sample;
use crate::random::{Rng, resample};
use glam::{Affine3, Mat3, Quat, Vec3};
use rand::{RngExt, seq::SliceRandom};
use rand_distr::{Distribution, Normal, StandardNormal};
use reagent_core::Pose;
use reagent_core::pose::{centroid, rotation_from_euler};
use serde::{Deserialize, Serialize};
use std::f32::consts::{FRAC_PI_4, TAU};

/// Standard deviation of the sensor noise, normalised units; the noise is clipped to [`JITTER_CLIP`].
pub const JITTER_SIGMA: f32 = 0.01;
/// Largest noise per coordinate, normalised units.
pub const JITTER_CLIP: f32 = 0.05;

/// A random offset: each Euler angle U[0, 45) deg (positive only), each translation U[-0.5, 0.5).
pub fn random_rigid(rng: &mut Rng) -> Pose {
    random_rigid_within(rng, FRAC_PI_4, 0.5)
}

/// A random offset: each Euler angle U[0, `max_angle_rad`), each translation U[-`max_shift`, `max_shift`). Equal
/// streams give the same offset up to these scales.
pub fn random_rigid_within(rng: &mut Rng, max_angle_rad: f32, max_shift: f32) -> Pose {
    let mut unit = || rng.random_range(0.0..1.0f32);
    let angles = Vec3::from_array(std::array::from_fn(|_| unit() * max_angle_rad));
    let shift = Vec3::from_array(std::array::from_fn(|_| {
        unit() * (2.0 * max_shift) - max_shift
    }));
    Pose {
        rotation: rotation_from_euler(angles),
        translation: shift,
    }
}

/// Adds noise N(0, 0.01), clipped to 0.05, to every coordinate.
pub fn jitter(rng: &mut Rng, points: &mut [Point]) {
    jitter_by(rng, points, JITTER_SIGMA, JITTER_CLIP);
}

/// Adds noise N(0, `sigma`), clipped to `clip`, to every coordinate.
pub fn jitter_by(rng: &mut Rng, points: &mut [Point], sigma: f32, clip: f32) {
    for x in points.as_flattened_mut() {
        let noise: f32 = StandardNormal.sample(rng);
        *x += (sigma * noise).clamp(-clip, clip);
    }
}

/// Cuts a cloud by a plane with a random normal and keeps this share of the points, rounded up, on one side of it, in
/// their order.
pub fn crop(rng: &mut Rng, points: &mut Vec<Point>, share: f32) {
    let normal = random_direction(rng);
    let mut by_height: Vec<(f32, usize)> = points
        .iter()
        .enumerate()
        .map(|(i, &p)| (normal.dot(Vec3::from_array(p)), i))
        .collect();
    by_height.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    by_height.truncate((share * points.len() as f32).ceil() as usize);
    let mut kept: Vec<usize> = by_height.into_iter().map(|(_, i)| i).collect();
    kept.sort_unstable();
    *points = kept.into_iter().map(|i| points[i]).collect();
}

/// Replaces this share of a cloud's points, the first ones, by points uniform in the unit ball.
pub fn clutter(rng: &mut Rng, points: &mut [Point], share: f32) {
    let replaced = (share * points.len() as f32).round() as usize;
    for p in points.iter_mut().take(replaced) {
        let radius = rng.random_range(0.0..1.0f32).cbrt();
        *p = (radius * random_direction(rng)).to_array();
    }
}

/// Permutes the order of the points.
pub fn shuffle(rng: &mut Rng, points: &mut [Point]) {
    points.shuffle(rng);
}

/// A uniformly random direction.
pub fn random_direction(rng: &mut Rng) -> Vec3 {
    let azimuth = rng.random_range(0.0..TAU);
    let cos_polar: f32 = rng.random_range(-1.0..1.0);
    let sin_polar = (1.0 - cos_polar * cos_polar).max(0.0).sqrt();
    Vec3::new(
        sin_polar * azimuth.cos(),
        sin_polar * azimuth.sin(),
        cos_polar,
    )
}

/// Three independent scale factors, N(1, 0.1) clipped to [0.5, 1.5].
pub fn random_scale(rng: &mut Rng) -> Vec3 {
    let normal = Normal::new(1.0f32, 0.1).expect("a positive deviation");
    Vec3::from_array(std::array::from_fn(|_| normal.sample(rng).clamp(0.5, 1.5)))
}

/// A random shear: angle N(0, 5) deg clipped to 15 deg, random direction and plane.
pub fn random_shear(rng: &mut Rng) -> Mat3 {
    let z: f32 = StandardNormal.sample(rng);
    let angle = (5.0 * z).clamp(-15.0, 15.0).to_radians();
    let direction = random_direction(rng);
    let normal = direction.cross(random_direction(rng));
    shear_matrix(angle, direction, normal)
}

/// Shear `I + tan(angle) d nᵀ`; the plane's normal is normalised here. A zero normal shears nothing.
pub fn shear_matrix(angle_rad: f32, direction: Vec3, normal: Vec3) -> Mat3 {
    let n = normal.normalize_or_zero() * angle_rad.tan();
    Mat3::IDENTITY + outer(direction, n)
}

/// Reflection `I - 2 n nᵀ` at the plane through the origin with unit normal `n`.
pub fn mirror_matrix(normal: Vec3) -> Mat3 {
    Mat3::IDENTITY - outer(normal * 2.0, normal)
}

fn outer(a: Vec3, b: Vec3) -> Mat3 {
    Mat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Scales each axis about the cloud's centroid.
pub fn scale(points: &mut [Point], factors: Vec3) {
    let centre = centroid(points);
    map(points, |p| (p - centre) * factors + centre);
}

/// Applies a linear map about the origin.
pub fn linear(points: &mut [Point], matrix: &Mat3) {
    map(points, |p| *matrix * p);
}

/// Applies a plain rigid transform.
pub fn transform(points: &mut [Point], pose: &Pose) {
    map(points, |p| pose.apply(p));
}

fn map(points: &mut [Point], f: impl Fn(Vec3) -> Vec3) {
    for p in points {
        *p = f(Vec3::from_array(*p)).to_array();
    }
}

/// The paper's affine regularisation as one map: scale about `centre`, then shear, then mirror, one draw each.
pub fn random_affine(rng: &mut Rng, centre: Vec3) -> Affine3 {
    let factors = random_scale(rng);
    let shear = random_shear(rng);
    let mirror = mirror_matrix(random_direction(rng));
    let scale = Affine3 {
        matrix3: Mat3::from_diagonal(factors),
        translation: centre - centre * factors,
    };
    Affine3::from_mat3(mirror * shear) * scale
}

/// Applies an affine map.
pub fn affine(points: &mut [Point], map_of_point: &Affine3) {
    map(points, |p| map_of_point.transform_point3(p));
}

/// A rotation drawn uniformly from all rotations.
pub fn random_rotation(rng: &mut Rng) -> Quat {
    let [x, y, z, w]: [f32; 4] = std::array::from_fn(|_| StandardNormal.sample(rng));
    Quat::from_xyzw(x, y, z, w).normalize()
}

/// Moves a source that is aligned with its target by a random rigid offset.
pub fn misalign(rng: &mut Rng, source: Vec<Point>, target: Vec<Point>) -> Sample {
    misalign_by(random_rigid(rng), source, target)
}

/// Moves a source that is aligned with its target by `offset`.
pub fn misalign_by(offset: Pose, mut source: Vec<Point>, target: Vec<Point>) -> Sample {
    transform(&mut source, &offset);
    Sample {
        source,
        target,
        target_from_source: offset.inverse(),
    }
}

/// The clean condition: source and target are the same points, in different orders.
pub fn clean_pair(rng: &mut Rng, points: Vec<Point>) -> Sample {
    let mut sample = misalign(rng, points.clone(), points);
    shuffle(rng, &mut sample.source);
    shuffle(rng, &mut sample.target);
    sample
}

/// The noisy condition: `k` points drawn independently for source and target, noise on both.
pub fn noisy_pair(rng: &mut Rng, whole: &[Point], k: usize) -> Sample {
    // A random draw is in random order already: no further shuffle is needed.
    let (source, target) = (resample(rng, whole, k), resample(rng, whole, k));
    with_noise(rng, source, target)
}

fn with_noise(rng: &mut Rng, source: Vec<Point>, target: Vec<Point>) -> Sample {
    let mut sample = misalign(rng, source, target);
    jitter(rng, &mut sample.source);
    jitter(rng, &mut sample.target);
    sample
}

/// A clean training sample: `k` points of the model, deformed by scale, shear and mirror.
pub fn clean_sample(rng: &mut Rng, model: &[Point], k: usize) -> Sample {
    let mut points = resample(rng, model, k);
    let deformed = random_affine(rng, centroid(&points));
    affine(&mut points, &deformed);
    clean_pair(rng, points)
}

/// A noisy training sample: the model deformed by scale (about the centroid of all its points), shear and mirror, then
/// [`noisy_pair`]. Only the points that are drawn are actually deformed.
pub fn noisy_sample(rng: &mut Rng, model: &[Point], k: usize) -> Sample {
    let deformed = random_affine(rng, centroid(model));
    let (mut source, mut target) = (resample(rng, model, k), resample(rng, model, k));
    affine(&mut source, &deformed);
    affine(&mut target, &deformed);
    with_noise(rng, source, target)
}

/// Disturbances that observations of real objects have and whole shapes do not (ours; the paper trains without). They
/// apply to half of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Disturbance {
    /// Least share of a source's points that are kept on one side of a random plane; the share is uniform between this
    /// and 1.
    pub min_overlap: f32,
    /// Largest share of a source's points that are replaced by points in the unit ball about the target's origin;
    /// the share is uniform between 0 and this.
    pub max_outliers: f32,
}

impl Disturbance {
    /// No disturbance: whole shapes only.
    pub const NONE: Disturbance = Disturbance {
        min_overlap: 1.0,
        max_outliers: 0.0,
    };

    /// Crops and clutters the source of half of the samples.
    pub fn apply(self, rng: &mut Rng, sample: &mut Sample) {
        if self == Disturbance::NONE || rng.random_bool(0.5) {
            return;
        }
        let overlap = 1.0 - rng.random_range(0.0..=1.0 - self.min_overlap);
        crop(rng, &mut sample.source, overlap);
        let outliers = rng.random_range(0.0..=self.max_outliers);
        // Outliers are placed about the target, so the source is first moved there.
        transform(&mut sample.source, &sample.target_from_source);
        clutter(rng, &mut sample.source, outliers);
        transform(&mut sample.source, &sample.target_from_source.inverse());
    }
}

impl Default for Disturbance {
    fn default() -> Self {
        Self::NONE
    }
}

#[cfg(test)]
mod tests;
