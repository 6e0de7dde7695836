//! Integer layers and the int8 search with AVX-512 VNNI: 32 outputs by 12 points.
//!
//! Every function must only be called where its instruction set was detected, with `points` (of
//! one tile, which starts at `tile`) and `panels` within `codes`, `scales`, `layer`, and [`GROUPS`] rows
//! of `layer.outputs()` in `best` and `winner`; [`super::Isa::search`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::bytes::{ROW_BITS, row_mark};
use super::search::{GROUPS, NONE, PLACE, PanelBest, merge};
use crate::dims::PANEL;
use crate::layer::Codes;
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
                let x = codes.as_ptr().add(n * layer.inputs());
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
                merge(kept, tile, panel + p, layer.outputs(), best, winner);
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
        let sum = sums::<P, N>(layer, panel, x);
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

/// Sums of `P` panels and `N` rows at `x`.
#[target_feature(enable = "avx512f,avx512vnni")]
#[inline]
unsafe fn sums<const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    x: *const u8,
) -> [[__m512i; P]; N] {
    // SAFETY: the caller guarantees `P` panels from `panel` on and `N` rows at `x`.
    unsafe {
        let weights: [*const i8; P] = core::array::from_fn(|p| {
            layer
                .panels()
                .as_ptr()
                .add((panel + p) * layer.inputs() * PANEL)
        });
        let mut sum = [[_mm512_setzero_si512(); P]; N];
        for k in 0..layer.inputs() / 4 {
            let w: [__m512i; P] =
                core::array::from_fn(|p| _mm512_loadu_si512(weights[p].add(k * QUAD).cast()));
            for n in 0..N {
                let quad = x.add(n * layer.inputs() + 4 * k).cast::<i32>();
                let quad = _mm512_set1_epi32(quad.read_unaligned());
                for p in 0..P {
                    sum[n][p] = _mm512_dpbusd_epi32(sum[n][p], quad, w[p]);
                }
            }
        }
        sum
    }
}

/// As [`super::bytes::marked`].
#[target_feature(enable = "avx512f")]
#[inline]
pub(super) fn marked_512<const MARK: bool>(sum: __m512i, row: usize) -> __m512i {
    if MARK {
        let mark = _mm512_set1_epi32(row_mark(row));
        _mm512_or_si512(_mm512_slli_epi32::<ROW_BITS>(sum), mark)
    } else {
        sum
    }
}

/// As [`super::bytes::dense_codes_max`], of rows that count from `first`.
#[target_feature(enable = "avx512f,avx512vnni")]
pub(super) unsafe fn dense_codes_max_512<const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    first: usize,
    max: &mut [i32],
) {
    let points = x.len() / layer.inputs();
    // SAFETY: blocks cover the given panels and whole rows of `x` only.
    unsafe {
        let mut panel = panels.start;
        while panel < panels.end {
            let two = panel + 2 <= panels.end;
            let max = max.as_mut_ptr().add(panel * PANEL);
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let row = first + n;
                n += match (two, points - n) {
                    (true, POINTS..) => max_block::<2, POINTS, MARK>(layer, panel, x, row, max),
                    (true, 4..) => max_block::<2, 4, MARK>(layer, panel, x, row, max),
                    (true, _) => max_block::<2, 1, MARK>(layer, panel, x, row, max),
                    (false, _) => max_block::<1, 1, MARK>(layer, panel, x, row, max),
                };
            }
            panel += if two { 2 } else { 1 };
        }
    }
}

#[target_feature(enable = "avx512f,avx512vnni")]
#[inline]
unsafe fn max_block<const P: usize, const N: usize, const MARK: bool>(
    layer: &Codes<'_>,
    panel: usize,
    x: *const u8,
    row: usize,
    max: *mut i32,
) -> usize {
    // SAFETY: as in `sums`, with `P` panels of maxima at `max`.
    unsafe {
        let sum = sums::<P, N>(layer, panel, x);
        for p in 0..P {
            let max = max.add(p * PANEL).cast::<__m512i>();
            let mut best = _mm512_loadu_si512(max);
            for n in 0..N {
                let sum = marked_512::<MARK>(sum[n][p], row + n);
                best = _mm512_max_epi32(best, sum);
            }
            _mm512_storeu_si512(max, best);
        }
    }
    N
}

/// As [`super::bytes::dense_codes`].
#[target_feature(enable = "avx512f,avx512vnni")]
pub(super) unsafe fn dense_codes_512(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    let points = (x.len() / layer.inputs()).min(y.len() / layer.outputs());
    // SAFETY: blocks cover whole panels and whole rows of `x` and `y` only.
    unsafe {
        for panel in 0..layer.outputs() / PANEL {
            let bias = _mm512_loadu_si512(bias.as_ptr().add(panel * PANEL).cast());
            let factors = _mm512_loadu_si512(requantise.as_ptr().add(panel * PANEL).cast());
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let y = y.as_mut_ptr().add(n * layer.outputs() + panel * PANEL);
                n += if points - n >= POINTS {
                    codes_block::<POINTS>(layer, panel, bias, factors, x, y)
                } else {
                    codes_block::<1>(layer, panel, bias, factors, x, y)
                };
            }
        }
    }
}

#[target_feature(enable = "avx512f,avx512vnni")]
#[inline]
unsafe fn codes_block<const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    bias: __m512i,
    factors: __m512i,
    x: *const u8,
    y: *mut u8,
) -> usize {
    // SAFETY: as in `sums`, with `N` rows of `layer.outputs()` codes at `y`.
    unsafe {
        let factor = _mm512_and_si512(factors, _mm512_set1_epi32(0xffff));
        let shift = _mm512_srli_epi32::<16>(factors);
        let one = _mm512_set1_epi32(1);
        let half = _mm512_srli_epi32::<1>(_mm512_sllv_epi32(one, shift));
        let sum = sums::<1, N>(layer, panel, x);
        for n in 0..N {
            let product = _mm512_mullo_epi32(_mm512_add_epi32(sum[n][0], bias), factor);
            let code = _mm512_srav_epi32(_mm512_add_epi32(product, half), shift);
            let code = _mm512_max_epi32(code, _mm512_setzero_si512());
            let code = _mm512_cvtusepi32_epi8(code);
            _mm_storeu_si128(y.add(n * layer.outputs()).cast(), code);
        }
    }
    N
}

/// As [`super::bytes::gemv_codes`].
#[target_feature(enable = "avx512f,avx512vnni")]
pub(super) unsafe fn gemv_codes_512(
    layer: &Codes<'_>,
    columns: Range<usize>,
    planes: [&[u8]; 2],
    y: &mut [i32],
) {
    let panels = layer.outputs() / PANEL;
    // SAFETY: blocks cover whole panels, of columns that exist, as the caller guarantees.
    unsafe {
        let mut panel = 0;
        while panel < panels {
            panel += if panel + 8 <= panels {
                gemv_block::<8>(layer, columns.clone(), planes, y, panel)
            } else {
                gemv_block::<1>(layer, columns.clone(), planes, y, panel)
            };
        }
    }
}

#[target_feature(enable = "avx512f,avx512vnni")]
#[inline]
unsafe fn gemv_block<const P: usize>(
    layer: &Codes<'_>,
    columns: Range<usize>,
    [high, low]: [&[u8]; 2],
    y: &mut [i32],
    panel: usize,
) -> usize {
    // SAFETY: the caller guarantees `P` panels from `panel` on, in `y` too, and planes as long as
    // `columns`.
    unsafe {
        let weights: [*const i8; P] = core::array::from_fn(|p| {
            let column = (panel + p) * layer.inputs() + columns.start;
            layer.panels().as_ptr().add(column * PANEL)
        });
        let mut sum = [[_mm512_setzero_si512(); 2]; P];
        for k in 0..columns.len() / 4 {
            let quad = |plane: &[u8]| {
                _mm512_set1_epi32(plane.as_ptr().add(4 * k).cast::<i32>().read_unaligned())
            };
            let (high, low) = (quad(high), quad(low));
            for p in 0..P {
                let w = _mm512_loadu_si512(weights[p].add(k * QUAD).cast());
                sum[p][0] = _mm512_dpbusd_epi32(sum[p][0], high, w);
                sum[p][1] = _mm512_dpbusd_epi32(sum[p][1], low, w);
            }
        }
        for (p, [high, low]) in sum.into_iter().enumerate() {
            let y = y.as_mut_ptr().add((panel + p) * PANEL).cast::<__m512i>();
            let sum = _mm512_add_epi32(_mm512_slli_epi32::<6>(high), low);
            _mm512_storeu_si512(y, _mm512_add_epi32(_mm512_loadu_si512(y), sum));
        }
    }
    P
}
