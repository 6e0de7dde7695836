//! Normals, from moments of neighbourhoods.

use super::boxes::bounds_of;
use super::matching::load;
use super::{BLOCK, Surface};
use crate::kernels::{BATCH, Batch, Isa, Moments};
use crate::solve::smallest_direction;
use glam::Vec3;

/// Points of a neighbourhood, in the median: what [`Surface::radius`] holds.
const NEIGHBOURS: usize = 24;
/// Radius within which a normal is estimated, in radii of a neighbourhood.
const NORMAL_RADIUS: f32 = 0.85;

impl Surface {
    /// See [`Self::radius`]; of some of the points.
    pub(super) fn neighbourhood(&mut self) -> f32 {
        const SAMPLES: usize = 32;
        let n = self.len;
        let mut found = [0.0f32; SAMPLES];
        for (s, found) in found.iter_mut().enumerate() {
            let (q, _) = self.at((2 * s + 1) * n / (2 * SAMPLES));
            for (key, &p) in self.keys.iter_mut().zip(&self.points).take(n) {
                *key = (Vec3::from_array(p) - q).length_squared().to_bits();
            }
            *found = self.select(n, NEIGHBOURS.min(n.saturating_sub(1)));
        }
        found.sort_unstable_by(f32::total_cmp);
        libm::sqrtf(found.get(SAMPLES / 2).copied().unwrap_or(0.0))
    }

    /// Estimates all normals.
    pub(super) fn estimate_normals(&mut self, isa: Isa) {
        let radius = NORMAL_RADIUS * self.radius;
        let squared = radius * radius;
        let share = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        for start in (0..self.len).step_by(BATCH) {
            let mut batch = Batch::EMPTY;
            let points = self.points().get(start..).unwrap_or(&[]);
            load(&mut batch, &mut points.iter().map(|&p| Vec3::from_array(p)));
            let gaps = self
                .boxes
                .gaps(&bounds_of(&batch), self.len.div_ceil(BLOCK));
            let mut sums = Moments::ZERO;
            for (&gap, (_, points)) in gaps.iter().zip(self.blocks()) {
                if gap < squared {
                    isa.moments(&batch.at, points, share, &mut sums);
                }
            }
            let end = self.len.min(start + BATCH);
            for (lane, normal) in self.normals.iter_mut().take(end).skip(start).enumerate() {
                let m = sums
                    .0
                    .each_ref()
                    .map(|row| row.get(lane).copied().unwrap_or(0.0));
                *normal = normal_of(m);
            }
        }
    }
}

fn normal_of([w, x, y, z, xx, yy, zz, xy, xz, yz]: [f32; 10]) -> [f32; 3] {
    if w <= 0.0 {
        return [0.0; 3];
    }
    let f = 1.0 / w;
    let (x, y, z) = (x * f, y * f, z * f);
    smallest_direction([
        xx * f - x * x,
        yy * f - y * y,
        zz * f - z * z,
        xy * f - x * y,
        xz * f - x * z,
        yz * f - y * z,
    ])
    .to_array()
}
