//! Batches of query points, and the moments of their neighbourhoods, in lanes.
//!
//! As in [`super::lanes`], the bits are the same on every kernel.

#![allow(unsafe_code)]

use super::Isa;
use super::boxes::{Boxed, bounds};
use super::lanes::{LANES, Lanes, Row, Vectors};
use super::on_lanes::on_lanes;

/// Queries in a [`Batch`].
pub const BATCH: usize = LANES;

/// A batch of query points, and the nearest point found so far for each, within a limit.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Batch {
    /// Coordinates of the queries, one row for each axis.
    pub at: [[f32; BATCH]; 3],
    /// Squared distance to the nearest point; the limit if none is nearer.
    pub nearest: [f32; BATCH],
    /// Place of the nearest point, the first of equals; unchanged if none is nearer than the limit.
    pub place: [u32; BATCH],
}

impl Batch {
    /// Queries at the origin that have no nearest point yet.
    pub const EMPTY: Batch = Batch {
        at: [[0.0; BATCH]; 3],
        nearest: [f32::INFINITY; BATCH],
        place: [0; BATCH],
    };
}

/// Weighted moments of the points around each query: weight, first moments (x, y, z), second moments (xx, yy, zz, xy, xz, yz).
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Moments(pub [[f32; BATCH]; 10]);

impl Moments {
    /// Moments of no points.
    pub const ZERO: Moments = Moments([[0.0; BATCH]; 10]);
}

/// See [`Isa::moments`].
#[inline(always)]
fn moments<L: Lanes>(at: &[Row; 3], points: &Boxed<'_>, radius_squared: f32, sums: &mut Moments) {
    let per_squared = if radius_squared > 0.0 {
        1.0 / radius_squared
    } else {
        0.0
    };
    let gaps = points.gaps::<L>(&bounds::<L>(at));
    for (block, &gap) in gaps.iter().take(points.count()).enumerate() {
        if gap < radius_squared {
            let of_block = points.points.0.get(points.places(block));
            for lane in (0..LANES).step_by(L::COUNT) {
                add::<L>(at, of_block.unwrap_or(&[]), per_squared, lane, sums);
            }
        }
    }
}

/// Adds the moments of points around the queries in the lanes from `lane` on.
#[inline(always)]
fn add<L: Lanes>(
    at: &[Row; 3],
    points: &[[f32; 3]],
    per_squared: f32,
    lane: usize,
    sums: &mut Moments,
) {
    let (at, per_squared) = (Vectors::<L>::load(at, lane), L::all(per_squared));
    let mut sum = [L::all(0.0); 10];
    for (sum, row) in sum.iter_mut().zip(&sums.0) {
        *sum = L::load(row, lane);
    }
    for &point in points {
        let d = Vectors::all(point) - at;
        let weight = (L::all(1.0) - d.dot(d) * per_squared).max(L::all(0.0));
        let (wx, wy, wz) = (weight * d.x, weight * d.y, weight * d.z);
        sum = [
            sum[0] + weight,
            sum[1] + wx,
            sum[2] + wy,
            sum[3] + wz,
            sum[4] + wx * d.x,
            sum[5] + wy * d.y,
            sum[6] + wz * d.z,
            sum[7] + wx * d.y,
            sum[8] + wx * d.z,
            sum[9] + wy * d.z,
        ];
    }
    for (sum, row) in sum.iter().zip(&mut sums.0) {
        sum.store(row, lane);
    }
}

impl Isa {
    /// Adds the moments of points around each query, with the weight `1 - squared distance / squared radius`, or 0 beyond the
    /// radius. The same bits on every kernel.
    pub fn moments(
        self,
        at: &[Row; 3],
        points: &Boxed<'_>,
        radius_squared: f32,
        sums: &mut Moments,
    ) {
        on_lanes!(
            self,
            moments(at: &[Row; 3], points: &Boxed<'_>, radius_squared: f32, sums: &mut Moments)
        );
    }
}
