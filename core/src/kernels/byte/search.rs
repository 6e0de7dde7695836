//! The search for critical points in bytes, as [`crate::kernels::search::portable`].
//!
//! # Safety
//! For every function: as [`Sums`] requires; `points` (of one tile, which starts at `tile`) and `panels` lie within `codes`,
//! `scales` and the layer; `best` and `winner` hold [`GROUPS`] rows of its outputs. [`crate::kernels::Isa::search`] checks it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::dense::layer_sums;
use super::vector::Sums;
use crate::kernels::search::{GROUPS, NONE, PanelBest, merge};
use crate::layer::Codes;
use core::ops::Range;

/// Sums that are comparable between rows of different scales.
pub(in crate::kernels) trait Scores: Sums {
    /// Raises `best`, sixteen values, to the scores of the point at `place` in its tile, which the last bits of a score hold.
    ///
    /// # Safety
    /// As [`Sums`] requires.
    unsafe fn raise_scores(self, scale: f32, place: usize, best: *mut f32);
}

/// See [`crate::kernels::Isa::search`]; blocks of `P` panels by `N` points.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
pub(in crate::kernels) unsafe fn search<V: Scores, const P: usize, const N: usize>(
    layer: &Codes<'_>,
    tile: usize,
    points: Range<usize>,
    panels: Range<usize>,
    codes: &[u8],
    scales: &[f32],
    best: &mut [f32],
    winner: &mut [u32],
) {
    let mut panel = panels.start;
    while panel < panels.end {
        let together = panel + P <= panels.end;
        let mut kept = [NONE; P];
        let mut n = points.start;
        while n < points.end {
            let many = points.end - n >= N;
            // SAFETY: blocks cover the given panels and points only.
            unsafe {
                let x = codes.as_ptr().add(n * layer.inputs());
                let scales = scales.as_ptr().add(n);
                n += match (together, many) {
                    (true, true) => raise::<V, P, N>(layer, panel, x, scales, n, tile, &mut kept),
                    (true, false) => raise::<V, P, 1>(layer, panel, x, scales, n, tile, &mut kept),
                    (false, _) => raise::<V, 1, 1>(layer, panel, x, scales, n, tile, &mut kept),
                };
            }
        }
        let count = if together { P } else { 1 };
        for (p, kept) in kept.iter().take(count).enumerate() {
            merge(kept, tile, panel + p, layer.outputs(), best, winner);
        }
        panel += count;
    }
}

/// Raises the best scores of `P` panels to those of `N` points; point `first` is at `x`.
#[inline(always)]
unsafe fn raise<V: Scores, const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    x: *const u8,
    scales: *const f32,
    first: usize,
    tile: usize,
    best: &mut [PanelBest],
) -> usize {
    // SAFETY: the caller guarantees the panels, points and scales; `best` holds whole panels.
    unsafe {
        let sums = layer_sums::<V, P, N>(layer, panel, x);
        for n in 0..N {
            for p in 0..P {
                let best = best[p][(first + n) % GROUPS].as_mut_ptr();
                sums[n][p].raise_scores(*scales.add(n), first - tile + n, best);
            }
        }
    }
    N
}
