//! The int8 search with dot products of four bytes: AVX-512 VNNI by 32 outputs and 12 points, AVX-VNNI
//! by 16 outputs and 6 points.
//!
//! Every function must only be called where its instruction set was detected, with `points` (of
//! one tile, which starts at `tile`) and `panels` within `codes`, `scales`, `layer`, and [`GROUPS`] rows
//! of `layer.outputs` in `best` and `winner`; [`super::Isa::search`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::search::{Codes, GROUPS, NONE, PLACE, PanelBest, merge};
use crate::dims::PANEL;
use core::arch::x86_64::*;
use core::ops::Range;

/// Points of one AVX-512 block; a multiple of the groups.
const POINTS: usize = 12;
/// Bytes of one group of four inputs in a panel.
const QUAD: usize = 4 * PANEL;

const _: () = assert!(POINTS.is_multiple_of(GROUPS));

/// Score of the point at `place` in its tile, which the last bits keep.
#[target_feature(enable = "avx512f")]
#[inline]
pub(super) fn score_512(sum: __m512i, scale: f32, place: __m512i) -> __m512 {
    let score = _mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_set1_ps(scale));
    /// `a & !b | c`, bit by bit.
    const REPLACE: i32 = 0b1011_1010;
    let kept = _mm512_set1_epi32(PLACE as i32);
    _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<REPLACE>(
        _mm512_castps_si512(score),
        kept,
        place,
    ))
}

#[target_feature(enable = "avx512f,avx512vnni")]
#[allow(clippy::too_many_arguments)]
pub(super) unsafe fn search_512(
    layer: &Codes<'_>,
    tile: usize,
    points: Range<usize>,
    panels: Range<usize>,
    codes: &[u8],
    scales: &[f32],
    best: &mut [f32],
    winner: &mut [u32],
) {
    // SAFETY: blocks cover the given panels and points only.
    unsafe {
        let mut panel = panels.start;
        while panel < panels.end {
            let two = panel + 2 <= panels.end;
            let mut best_of_tile = [NONE; 2];
            let mut n = points.start;
            while n < points.end {
                let x = codes.as_ptr().add(n * layer.inputs);
                let scales = scales.as_ptr().add(n);
                let place = n - tile;
                let best = &mut best_of_tile;
                n += match (two, points.end - n) {
                    (true, POINTS..) => block::<2, POINTS>(layer, panel, n, place, x, scales, best),
                    (true, _) => block::<2, 1>(layer, panel, n, place, x, scales, best),
                    (false, _) => block::<1, 1>(layer, panel, n, place, x, scales, best),
                };
            }
            let count = if two { 2 } else { 1 };
            for (p, kept) in best_of_tile.iter().take(count).enumerate() {
                merge(kept, tile, panel + p, layer.outputs, best, winner);
            }
            panel += count;
        }
    }
}

#[target_feature(enable = "avx512f,avx512vnni")]
#[inline]
unsafe fn block<const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    first: usize,
    place: usize,
    x: *const u8,
    scales: *const f32,
    best: &mut [PanelBest; 2],
) -> usize {
    // SAFETY: the caller guarantees `P` panels from `panel` on, `N` rows at `x` and as many scales.
    unsafe {
        let weights: [*const i8; P] = core::array::from_fn(|p| {
            layer
                .panels
                .as_ptr()
                .add((panel + p) * layer.inputs * PANEL)
        });
        let mut sum = [[_mm512_setzero_si512(); P]; N];
        for k in 0..layer.inputs / 4 {
            let w: [__m512i; P] =
                core::array::from_fn(|p| _mm512_loadu_si512(weights[p].add(k * QUAD).cast()));
            for n in 0..N {
                let quad = x.add(n * layer.inputs + 4 * k).cast::<i32>();
                let quad = _mm512_set1_epi32(quad.read_unaligned());
                for p in 0..P {
                    sum[n][p] = _mm512_dpbusd_epi32(sum[n][p], quad, w[p]);
                }
            }
        }
        for n in 0..N {
            let place = _mm512_set1_epi32((place + n) as i32);
            for p in 0..P {
                let best = best[p][(first + n) % GROUPS].as_mut_ptr();
                let score = score_512(sum[n][p], *scales.add(n), place);
                _mm512_storeu_ps(best, _mm512_max_ps(score, _mm512_loadu_ps(best)));
            }
        }
    }
    N
}

/// Outputs in one 256-bit register.
const LANES: usize = 8;

#[target_feature(enable = "avx2,avxvnni")]
#[allow(clippy::too_many_arguments)]
pub(super) unsafe fn search_256(
    layer: &Codes<'_>,
    points: Range<usize>,
    panels: Range<usize>,
    codes: &[u8],
    scales: &[f32],
    best: &mut [f32],
    winner: &mut [u32],
) {
    // SAFETY: blocks cover the given panels and points only.
    unsafe {
        for panel in panels {
            let weights = layer.panels.as_ptr().add(panel * layer.inputs * PANEL);
            let mut tile = NONE;
            let mut n = points.start;
            while n < points.end {
                let x = codes.as_ptr().add(n * layer.inputs);
                let scales = scales.as_ptr().add(n);
                let place = n - points.start;
                n += if points.end - n >= 6 {
                    block_256::<6>(layer.inputs, weights, n, place, x, scales, &mut tile)
                } else {
                    block_256::<1>(layer.inputs, weights, n, place, x, scales, &mut tile)
                };
            }
            merge(&tile, points.start, panel, layer.outputs, best, winner);
        }
    }
}

#[target_feature(enable = "avx2,avxvnni")]
#[inline]
unsafe fn block_256<const N: usize>(
    inputs: usize,
    weights: *const i8,
    first: usize,
    place: usize,
    x: *const u8,
    scales: *const f32,
    best: &mut PanelBest,
) -> usize {
    // SAFETY: the caller guarantees one panel at `weights`, `N` rows at `x` and as many scales.
    unsafe {
        let mut sum = [[_mm256_setzero_si256(); 2]; N];
        for k in 0..inputs / 4 {
            let w: [__m256i; 2] = core::array::from_fn(|half| {
                _mm256_loadu_si256(weights.add(k * QUAD + half * QUAD / 2).cast())
            });
            for n in 0..N {
                let quad = x.add(n * inputs + 4 * k).cast::<i32>();
                let quad = _mm256_set1_epi32(quad.read_unaligned());
                for half in 0..2 {
                    sum[n][half] = _mm256_dpbusd_avx_epi32(sum[n][half], quad, w[half]);
                }
            }
        }
        let kept = _mm256_castsi256_ps(_mm256_set1_epi32(!PLACE as i32));
        for n in 0..N {
            let place = _mm256_castsi256_ps(_mm256_set1_epi32((place + n) as i32));
            let scale = _mm256_set1_ps(*scales.add(n));
            let best = best[(first + n) % GROUPS].as_mut_ptr();
            for half in 0..2 {
                let best = best.add(half * LANES);
                let score = _mm256_mul_ps(_mm256_cvtepi32_ps(sum[n][half]), scale);
                let score = _mm256_or_ps(_mm256_and_ps(score, kept), place);
                _mm256_storeu_ps(best, _mm256_max_ps(score, _mm256_loadu_ps(best)));
            }
        }
    }
    N
}
