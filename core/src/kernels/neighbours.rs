//! Nearest neighbours with their places, and moments of neighbourhoods; queries in lanes.
//!
//! As in [`super::nearest`]: no fused multiply-add, sums in the order of the points, so that every kernel
//! gives the same bits.

#![allow(unsafe_code)]

use super::Isa;
#[cfg(target_arch = "x86_64")]
use super::Kind;

/// Queries of a [`Batch`].
pub const BATCH: usize = 16;

/// A batch of query points and the nearest of the points that they were shown so far, of those that are nearer than a limit.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Batch {
    /// Coordinates, one row an axis.
    pub at: [[f32; BATCH]; 3],
    /// Squared distance to the nearest point; the limit where none is nearer.
    pub nearest: [f32; BATCH],
    /// Place of the nearest point, the first of equals; as it was where none is nearer than the limit.
    pub place: [u32; BATCH],
}

impl Batch {
    /// Queries at the origin that were shown nothing.
    pub const EMPTY: Batch = Batch {
        at: [[0.0; BATCH]; 3],
        nearest: [f32::INFINITY; BATCH],
        place: [0; BATCH],
    };
}

/// Weighted moments of the points about each query: weight, first moments (x, y, z), second moments (xx, yy, zz,
/// xy, xz, yz).
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Moments(pub [[f32; BATCH]; 10]);

impl Moments {
    /// Of no points.
    pub const ZERO: Moments = Moments([[0.0; BATCH]; 10]);
}

/// Points of a run of neighbours.
pub const RUN: usize = 8;

/// An axis-parallel box about [`RUN`] points or fewer: its lowest and highest corner.
pub type Corners = [[f32; 3]; 2];

#[inline(always)]
fn nearest<const LANES: usize>(
    batch: &mut Batch,
    points: &[[f32; 3]],
    boxes: &[Corners],
    first: u32,
) {
    let Batch {
        at: [x, y, z],
        nearest,
        place,
    } = batch;
    let (x, _) = x.as_chunks::<LANES>();
    let (y, _) = y.as_chunks::<LANES>();
    let (z, _) = z.as_chunks::<LANES>();
    let (nearest, _) = nearest.as_chunks_mut::<LANES>();
    let (place, _) = place.as_chunks_mut::<LANES>();
    let queries = x.iter().zip(y).zip(z).zip(nearest).zip(place);
    for ((((x, y), z), nearest), place) in queries {
        let (mut best, mut best_place) = (*nearest, *place);
        let runs = (first..).step_by(RUN).zip(points.chunks(RUN)).zip(boxes);
        for ((start, points), corners) in runs {
            if !reaches([x, y, z], &best, corners) {
                continue;
            }
            for (here, &[a, b, c]) in (start..).zip(points) {
                let mut squared = [0.0f32; LANES];
                for i in 0..LANES {
                    let (dx, dy, dz) = (x[i] - a, y[i] - b, z[i] - c);
                    squared[i] = dx * dx + dy * dy + dz * dz;
                }
                // Places first: a comparison that also chose the distance would keep it in memory.
                for i in 0..LANES {
                    best_place[i] = if squared[i] < best[i] {
                        here
                    } else {
                        best_place[i]
                    };
                }
                for (best, squared) in best.iter_mut().zip(squared) {
                    *best = if squared < *best { squared } else { *best };
                }
            }
        }
        (*nearest, *place) = (best, best_place);
    }
}

/// Whether a box reaches nearer to one of the queries than its nearest point. No point of a box that does not is nearer, however
/// its distance is rounded: both are the same sums of differences, and those are ordered.
#[inline(always)]
fn reaches<const LANES: usize>(
    at: [&[f32; LANES]; 3],
    nearest: &[f32; LANES],
    [low, high]: &Corners,
) -> bool {
    let mut gaps = [0.0f32; LANES];
    for ((row, low), high) in at.into_iter().zip(low).zip(high) {
        for (gap, x) in gaps.iter_mut().zip(row) {
            let (below, above) = (low - x, x - high);
            let d = if below > above { below } else { above };
            let d = if d > 0.0 { d } else { 0.0 };
            *gap += d * d;
        }
    }
    let mut reached = 0u32;
    for (gap, &nearest) in gaps.into_iter().zip(nearest) {
        reached |= u32::from(gap < nearest);
    }
    reached != 0
}

#[inline(always)]
fn moments<const LANES: usize>(
    at: &[[f32; BATCH]; 3],
    points: &[[f32; 3]],
    per_squared_radius: f32,
    sums: &mut Moments,
) {
    for lane in (0..BATCH).step_by(LANES) {
        let load = |row: &[f32; BATCH]| -> [f32; LANES] { core::array::from_fn(|i| row[lane + i]) };
        let [x, y, z] = at.each_ref().map(load);
        let mut sum: [[f32; LANES]; 10] = sums.0.each_ref().map(load);
        for &[a, b, c] in points {
            for i in 0..LANES {
                let (dx, dy, dz) = (a - x[i], b - y[i], c - z[i]);
                let share = (dx * dx + dy * dy + dz * dz) * per_squared_radius;
                let weight = 1.0 - share;
                let weight = if weight > 0.0 { weight } else { 0.0 };
                let (wx, wy, wz) = (weight * dx, weight * dy, weight * dz);
                sum[0][i] += weight;
                sum[1][i] += wx;
                sum[2][i] += wy;
                sum[3][i] += wz;
                sum[4][i] += wx * dx;
                sum[5][i] += wy * dy;
                sum[6][i] += wz * dz;
                sum[7][i] += wx * dy;
                sum[8][i] += wx * dz;
                sum[9][i] += wy * dz;
            }
        }
        for (row, sum) in sums.0.iter_mut().zip(sum) {
            row[lane..lane + LANES].copy_from_slice(&sum);
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn nearest_avx2(batch: &mut Batch, points: &[[f32; 3]], boxes: &[Corners], first: u32) {
    nearest::<8>(batch, points, boxes, first);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn nearest_avx512(batch: &mut Batch, points: &[[f32; 3]], boxes: &[Corners], first: u32) {
    nearest::<16>(batch, points, boxes, first);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn moments_avx2(at: &[[f32; BATCH]; 3], points: &[[f32; 3]], share: f32, sums: &mut Moments) {
    moments::<8>(at, points, share, sums);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn moments_avx512(at: &[[f32; BATCH]; 3], points: &[[f32; 3]], share: f32, sums: &mut Moments) {
    moments::<16>(at, points, share, sums);
}

impl Isa {
    /// Shows `points`, whose places count from `first`, to a batch: in runs of [`RUN`], each within its box, and only those
    /// that may hold a point nearer than a query's nearest. The same bits on every kernel.
    pub fn show(self, batch: &mut Batch, points: &[[f32; 3]], boxes: &[Corners], first: u32) {
        match self.0 {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe { nearest_avx2(batch, points, boxes, first) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                nearest_avx512(batch, points, boxes, first);
            },
            _ => nearest::<8>(batch, points, boxes, first),
        }
    }

    /// Adds the moments of `points` about each query, weighted by `max(0, 1 - d² per_squared_radius)`. The
    /// same bits on every kernel.
    pub fn moments(
        self,
        at: &[[f32; BATCH]; 3],
        points: &[[f32; 3]],
        per_squared_radius: f32,
        sums: &mut Moments,
    ) {
        match self.0 {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                moments_avx2(at, points, per_squared_radius, sums);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                moments_avx512(at, points, per_squared_radius, sums);
            },
            _ => moments::<8>(at, points, per_squared_radius, sums),
        }
    }
}
