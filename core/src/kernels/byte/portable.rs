//! Integer layers: unsigned activation codes times signed weight codes, in 32-bit sums. This is the reference that the other
//! kernels match to the bit; [`crate::quant`] defines the numbers.

#![allow(unsafe_code, clippy::indexing_slicing)]

use crate::dims::{PANEL, QUAD};
use crate::layer::{Codes, Requantise};
use core::ops::Range;

/// Sums of one row with one panel of weights.
#[inline(always)]
pub(in crate::kernels) fn panel_sums(quads: &[[i8; PANEL * QUAD]], x: &[u8]) -> [i32; PANEL] {
    let mut sum = [0i32; PANEL];
    for (x, weights) in x.as_chunks::<QUAD>().0.iter().zip(quads) {
        for (s, w) in sum.iter_mut().zip(weights.as_chunks::<QUAD>().0) {
            for k in 0..QUAD {
                *s += i32::from(x[k]) * i32::from(w[k]);
            }
        }
    }
    sum
}

/// A panel's weights in groups of four inputs; none beyond the last panel.
pub(in crate::kernels) fn quads<'a>(layer: &Codes<'a>, panel: usize) -> &'a [[i8; PANEL * QUAD]] {
    let len = layer.inputs() * PANEL;
    let weights = layer.panels().get(panel * len..(panel + 1) * len);
    weights.unwrap_or(&[]).as_chunks().0
}

/// See [`crate::kernels::Isa::point_codes`].
#[inline(always)]
pub(in crate::kernels) fn point_codes(
    panels: &[f32],
    bias: &[f32],
    points: &[[f32; 3]],
    codes: &mut [u8],
) {
    let width = bias.len();
    let columns = panels.as_chunks::<{ 3 * PANEL }>().0;
    for (&[x, y, z], codes) in points.iter().zip(codes.chunks_exact_mut(width.max(1))) {
        let panels = columns.iter().zip(bias.as_chunks::<PANEL>().0);
        for ((w, bias), codes) in panels.zip(codes.as_chunks_mut::<PANEL>().0) {
            for lane in 0..PANEL {
                let mut value = bias[lane] + w[lane] * x;
                value += w[PANEL + lane] * y;
                value += w[2 * PANEL + lane] * z;
                let value = if value > 0.0 { value } else { 0.0 };
                let value = if value < 255.0 { value } else { 255.0 };
                codes[lane] = crate::layer::nearest_even(value) as u8;
            }
        }
    }
}

/// See [`crate::kernels::Isa::dense_codes`]; `x` and `y` hold as many rows as the caller counted.
#[inline(always)]
pub(in crate::kernels) fn dense_codes(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    let rows = x
        .chunks_exact(layer.inputs().max(1))
        .zip(y.chunks_exact_mut(layer.outputs().max(1)));
    for (x, y) in rows {
        let bias = bias.as_chunks::<PANEL>().0;
        let outputs = y.as_chunks_mut::<PANEL>().0.iter_mut();
        let requantise = requantise.as_chunks::<PANEL>().0;
        for (p, ((y, bias), requantise)) in outputs.zip(bias).zip(requantise).enumerate() {
            let sums = panel_sums(quads(layer, p), x);
            for lane in 0..PANEL {
                y[lane] = Requantise(requantise[lane]).apply_32(sums[lane] + bias[lane], 255) as u8;
            }
        }
    }
}

/// Bits of a marked sum that hold its row.
pub(in crate::kernels) const ROW_BITS: u32 = 8;
/// Rows that these bits can tell apart.
pub(in crate::kernels) const ROWS: usize = 1 << ROW_BITS;
/// Most inputs whose sums leave these bits free: `255 * 128 * INPUTS < 2^(31 - ROW_BITS)`.
pub(in crate::kernels) const INPUTS: usize = 128;

/// The mark of a row, in the low bits of its sums. Earlier rows have
/// greater marks, so that one maximum finds the first of equals.
#[inline(always)]
pub(in crate::kernels) const fn row_mark(row: usize) -> i32 {
    (ROWS - 1 - row % ROWS) as i32
}

/// The row of a marked sum.
pub(in crate::kernels) const fn row_of(marked: i32) -> usize {
    ROWS - 1 - (marked as usize & (ROWS - 1))
}

/// A sum; with `mark`, shifted left to make room for its row's mark.
#[inline(always)]
pub(in crate::kernels) const fn marked(mark: bool, sum: i32, row: usize) -> i32 {
    if mark {
        sum << ROW_BITS | row_mark(row)
    } else {
        sum
    }
}

/// See [`crate::kernels::Isa::dense_codes_max`]; over sums, or over [`marked`] sums of at most [`ROWS`] rows of [`INPUTS`].
pub(in crate::kernels) fn dense_codes_max(
    mark: bool,
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    let maxima = max.as_chunks_mut::<PANEL>().0.iter_mut();
    for (p, max) in panels.clone().zip(maxima.skip(panels.start)) {
        for (row, x) in x.chunks_exact(layer.inputs().max(1)).enumerate() {
            for (max, s) in max.iter_mut().zip(panel_sums(quads(layer, p), x)) {
                let s = marked(mark, s, row);
                *max = if s > *max { s } else { *max };
            }
        }
    }
}

/// See [`crate::kernels::Isa::gemv_codes`]; planes of `columns.len()` codes.
#[inline(always)]
pub(in crate::kernels) fn gemv_codes(
    layer: &Codes<'_>,
    columns: Range<usize>,
    [high, low]: [&[u8]; 2],
    y: &mut [i32],
) {
    for (p, y) in y.as_chunks_mut::<PANEL>().0.iter_mut().enumerate() {
        let quads = quads(layer, p).get(columns.start / QUAD..columns.end / QUAD);
        let quads = quads.unwrap_or(&[]);
        let (high, low) = (panel_sums(quads, high), panel_sums(quads, low));
        for lane in 0..PANEL {
            y[lane] += 64 * high[lane] + low[lane];
        }
    }
}

/// [`point_codes`] with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(in crate::kernels) fn point_codes_avx2(
    panels: &[f32],
    bias: &[f32],
    points: &[[f32; 3]],
    codes: &mut [u8],
) {
    point_codes(panels, bias, points, codes);
}

/// [`point_codes`] with AVX-512F.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
pub(in crate::kernels) fn point_codes_avx512(
    panels: &[f32],
    bias: &[f32],
    points: &[[f32; 3]],
    codes: &mut [u8],
) {
    point_codes(panels, bias, points, codes);
}
