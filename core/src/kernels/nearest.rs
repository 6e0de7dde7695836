//! Nearest neighbours by brute force, with queries in lanes.
//!
//! It uses no fused multiply-add, and a minimum never rounds, so every kernel gives the same bits. Each is the portable code
//! compiled for its instruction set; nothing is written by hand.

#![allow(unsafe_code)]

/// A block of query points, coordinate by coordinate, and the distances found for them.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Queries {
    /// First coordinates of the queries.
    pub x: [f32; Queries::LEN],
    /// Second coordinates.
    pub y: [f32; Queries::LEN],
    /// Third coordinates.
    pub z: [f32; Queries::LEN],
    /// Squared distance to the nearest point.
    pub nearest: [f32; Queries::LEN],
}

impl Queries {
    /// Queries in a block: their coordinates and minima fit 32 registers of 16 lanes.
    pub const LEN: usize = 64;
}

impl Default for Queries {
    fn default() -> Self {
        Queries {
            x: [0.0; Self::LEN],
            y: [0.0; Self::LEN],
            z: [0.0; Self::LEN],
            nearest: [f32::INFINITY; Self::LEN],
        }
    }
}

#[inline(always)]
pub(super) fn portable<const LANES: usize>(queries: &mut Queries, others: &[[f32; 3]]) {
    let Queries { x, y, z, nearest } = queries;
    let (x, _) = x.as_chunks::<LANES>();
    let (y, _) = y.as_chunks::<LANES>();
    let (z, _) = z.as_chunks::<LANES>();
    let (nearest, _) = nearest.as_chunks_mut::<LANES>();
    for (((x, y), z), nearest) in x.iter().zip(y).zip(z).zip(nearest) {
        let mut best = [f32::INFINITY; LANES];
        for &[a, b, c] in others {
            for ((best, (&x, &y)), &z) in best.iter_mut().zip(x.iter().zip(y)).zip(z) {
                let (dx, dy, dz) = (x - a, y - b, z - c);
                let squared = dx * dx + dy * dy + dz * dz;
                *best = if squared < *best { squared } else { *best };
            }
        }
        *nearest = best;
    }
}

/// [`portable`] with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(super) fn avx2(queries: &mut Queries, others: &[[f32; 3]]) {
    portable::<16>(queries, others);
}

/// [`portable`] with AVX-512F.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
pub(super) fn avx512(queries: &mut Queries, others: &[[f32; 3]]) {
    portable::<64>(queries, others);
}
