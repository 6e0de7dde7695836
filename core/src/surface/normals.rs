//! Normals, from the moments of neighbourhoods.

use super::keys::Keys;
use super::matching::load;
use super::{INWARD, Surface};
use crate::kernels::{BATCH, Batch, Isa, Moments};
use crate::select::select;
use crate::solve::least;
use glam::Vec3;

/// Other points in the median neighbourhood, which defines [`Surface::radius`].
const NEIGHBOURS: usize = 24;
/// Radius within which a normal is estimated, in neighbourhood radii.
const NORMAL_RADIUS: f32 = 0.85;
/// Thickness of neighbourhoods, in radii, from which on they may be all noise, without a plane; they are then taken `WIDER`
/// times as wide. A ball has .2.
const NO_PLANE: f32 = 0.125;
const WIDER: f32 = 1.6;
/// Growth of the thickness, in radii, from which on the wider ones show curvature, not noise: curved surfaces look thicker in
/// wider neighbourhoods, noise does not.
const BENT: f32 = 0.04;

impl Surface {
    /// See [`Self::radius`]; estimated at some of the points.
    pub(super) fn neighbourhood(&self, keys: &mut Keys) -> f32 {
        const SAMPLES: usize = 32;
        let n = self.len;
        let mut found = [0.0f32; SAMPLES];
        for (s, found) in found.iter_mut().enumerate() {
            let (q, _) = self.at((2 * s + 1) * n / (2 * SAMPLES));
            for (key, &p) in keys.0.iter_mut().zip(self.points()) {
                *key = (Vec3::from_array(p) - q).length_squared().to_bits();
            }
            *found = keys.select(n, NEIGHBOURS.min(n.saturating_sub(1)));
        }
        let median = select(&mut found, SAMPLES / 2, f32::total_cmp);
        libm::sqrtf(median.unwrap_or(0.0))
    }

    /// Estimates normals, in wider neighbourhoods if noise leaves no plane in the present ones.
    pub(super) fn estimate_normals(&mut self, isa: Isa, keys: &mut Keys) {
        let narrow = self.radius;
        let thickness = self.normals_within_radius(isa, keys);
        if thickness < NO_PLANE {
            return;
        }
        self.radius = WIDER * narrow;
        if self.normals_within_radius(isa, keys) > thickness + BENT {
            self.radius = narrow;
            self.normals_within_radius(isa, keys);
        }
    }

    /// Estimates normals within the present radius; returns the lower quartile of the thickness across them, in radii.
    fn normals_within_radius(&mut self, isa: Isa, keys: &mut Keys) -> f32 {
        let radius = NORMAL_RADIUS * self.radius;
        let squared = radius * radius;
        for start in (0..self.len).step_by(BATCH) {
            let mut batch = Batch::EMPTY;
            let points = self.points().get(start..).unwrap_or(&[]);
            load(&mut batch, &mut points.iter().map(|&p| Vec3::from_array(p)));
            let mut sums = Moments::ZERO;
            isa.moments(&batch.at, &self.boxed(), squared, &mut sums);
            let end = self.len.min(start + BATCH);
            let places = self.normals.iter_mut().zip(&mut self.inward);
            let places = places.zip(&mut keys.0);
            for (lane, ((normal, inward), key)) in places.take(end).skip(start).enumerate() {
                let m = sums
                    .0
                    .each_ref()
                    .map(|row| row.get(lane).copied().unwrap_or(0.0));
                let (direction, across, middle) = plane_of(m);
                *normal = direction.to_array();
                let along = middle - direction * direction.dot(middle);
                *inward = (along * (INWARD / radius.max(1e-30)))
                    .to_array()
                    .map(|x| x as i8);
                *key = across.to_bits(); // non-negative floats order as their bits do
            }
        }
        libm::sqrtf(keys.select(self.len, self.len / 4)) / self.radius.max(1e-30)
    }
}

/// Normal of a neighbourhood from its moments, mean squared distance from the plane, and mean offset from the centre.
fn plane_of([w, x, y, z, xx, yy, zz, xy, xz, yz]: [f32; 10]) -> (Vec3, f32, Vec3) {
    if w <= 0.0 {
        return (Vec3::ZERO, 0.0, Vec3::ZERO);
    }
    let f = 1.0 / w;
    let (x, y, z) = (x * f, y * f, z * f);
    let spread = [
        xx * f - x * x,
        yy * f - y * y,
        zz * f - z * z,
        xy * f - x * y,
        xz * f - x * z,
        yz * f - y * z,
    ];
    let (direction, share) = least(spread);
    let [xx, yy, zz, ..] = spread;
    let across = (share * (xx + yy + zz)).max(0.0);
    (direction, across, Vec3::new(x, y, z))
}
