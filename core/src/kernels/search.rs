//! The search for critical points in int8: 8-bit codes find which point reaches the maximum of each output, and the caller
//! computes the winners' outputs in f32 ([`winners`]).
//!
//! Activations after a ReLU become unsigned codes with one scale for each point, weights signed codes with one scale for each
//! output. An output's scale and bias do not change the arg-max, so the search needs neither. Points take turns in [`GROUPS`]
//! groups, each with its own winner. A near tie is lost only within a group, which divides the wrong winners by about the
//! number of groups.
//!
//! Integer sums are exact. The score is one conversion and one product, whose last eight bits are replaced by the point's place
//! in its tile, so that one maximum keeps both: the same winners on every kernel. The eight bits held far less than
//! quantisation has lost.

#![allow(unsafe_code, clippy::indexing_slicing)]

use super::byte::portable::{panel_sums, quads};
use crate::dims::PANEL;
use crate::layer::{Codes, nearest_even};
use core::ops::Range;

/// Points in a tile: their codes stay in the L1 cache while the panels pass.
pub(super) const TILE: usize = 192;
/// Bits of a score that hold the point's place in the tile.
pub(super) const PLACE: u32 = 0xff;

const _: () = assert!(TILE <= PLACE as usize + 1 && TILE.is_multiple_of(GROUPS));

/// Highest scores of one panel's outputs within a tile, for each group.
pub(super) type PanelBest = [[f32; PANEL]; GROUPS];
/// Scores before the first point.
pub(super) const NONE: PanelBest = [[f32::NEG_INFINITY; PANEL]; GROUPS];

/// Groups of points, each with a candidate for each output.
pub const GROUPS: usize = 2;

/// Quantises non-negative rows to codes 0..=255 with a scale for each row: `x ≈ code * scale`.
///
/// `x [points, width]`, `codes [points, stride]`, `scale [points]`; `stride >= width`.
#[inline(always)]
pub(super) fn quantise(
    width: usize,
    stride: usize,
    x: &[f32],
    codes: &mut [u8],
    scales: &mut [f32],
) {
    let rows = x.chunks_exact(width).zip(codes.chunks_exact_mut(stride));
    for ((x, codes), scale) in rows.zip(scales) {
        let mut lanes = [0.0f32; 16];
        let (whole, rest) = x.as_chunks::<16>();
        for values in whole {
            for (m, &v) in lanes.iter_mut().zip(values) {
                *m = if v > *m { v } else { *m };
            }
        }
        let largest = lanes.iter().chain(rest).fold(0.0f32, |m, &v| m.max(v));
        let to_code = if largest > 0.0 { 255.0 / largest } else { 0.0 };
        *scale = largest * (1.0 / 255.0);
        let (values, rest) = codes.split_at_mut(width);
        for (code, &v) in values.iter_mut().zip(x) {
            *code = nearest_even(v * to_code) as u8;
        }
        rest.fill(0);
    }
}

/// Merges the best of a tile that starts at point `first` into the best of the cloud.
#[inline(always)]
pub(super) fn merge(
    tile: &PanelBest,
    first: usize,
    panel: usize,
    outputs: usize,
    best: &mut [f32],
    winner: &mut [u32],
) {
    for (group, tile) in tile.iter().enumerate() {
        let at = group * outputs + panel * PANEL;
        let best = best[at..at + PANEL].iter_mut();
        let winner = winner[at..at + PANEL].iter_mut();
        for ((best, winner), &score) in best.zip(winner).zip(tile) {
            let higher = score > *best;
            *best = if higher { score } else { *best };
            let here = first as u32 + (score.to_bits() & PLACE);
            *winner = if higher { here } else { *winner };
        }
    }
}

/// See [`super::Isa::search`]; `points` are one tile.
#[inline(always)]
pub(super) fn portable(
    layer: &Codes<'_>,
    points: Range<usize>,
    panels: Range<usize>,
    codes: &[u8],
    scales: &[f32],
    best: &mut [f32],
    winner: &mut [u32],
) {
    for p in panels {
        let quads = quads(layer, p);
        let mut tile = NONE;
        for n in points.clone() {
            let x = &codes[n * layer.inputs()..(n + 1) * layer.inputs()];
            let place = (n - points.start) as u32;
            for (best, s) in tile[n % GROUPS].iter_mut().zip(panel_sums(quads, x)) {
                let score = s as f32 * scales[n];
                let score = f32::from_bits(score.to_bits() & !PLACE | place);
                *best = if score > *best { score } else { *best };
            }
        }
        merge(&tile, points.start, p, layer.outputs(), best, winner);
    }
}

/// See [`super::Isa::winners`].
#[inline(always)]
pub(super) fn winners(
    width: usize,
    rows: &[f32],
    bias: &[f32],
    hidden: &[f32],
    winner: &mut [u32],
    feature: &mut [f32],
) {
    let outputs = bias.len();
    for (o, (row, feature)) in rows.chunks_exact(width).zip(feature.iter_mut()).enumerate() {
        let mut best = (f32::NEG_INFINITY, 0);
        for group in 0..GROUPS {
            let n = winner[group * outputs + o];
            let at = n as usize * width;
            let Some(x) = hidden.get(at..at + width) else {
                continue;
            };
            let value = dot(row, x) + bias[o];
            if value > best.0 || (value == best.0 && n < best.1) {
                best = (value, n);
            }
        }
        (*feature, winner[o]) = best;
    }
}

/// Sums in 16 lanes, then pairwise, then the rest: the same bits on every kernel.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 16];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..16 {
            lanes[i] += a[i] * b[i];
        }
    }
    let lanes: [f32; 8] = core::array::from_fn(|i| lanes[i] + lanes[8 + i]);
    let lanes: [f32; 4] = core::array::from_fn(|i| lanes[i] + lanes[4 + i]);
    let mut sum = (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
    for (a, b) in a_rest.iter().zip(b_rest) {
        sum += a * b;
    }
    sum
}

/// Arguments of [`super::Isa::max_backward`].
#[derive(Clone, Copy)]
pub(super) struct MaxBackward<'a> {
    pub(super) width: usize,
    pub(super) row: &'a [u32],
    pub(super) gradient: &'a [f32],
    pub(super) hidden: &'a [f32],
    pub(super) weight: &'a [f32],
}

/// See [`super::Isa::max_backward`].
#[inline(always)]
pub(super) fn max_backward(
    layer: MaxBackward<'_>,
    weight_gradient: &mut [f32],
    hidden_gradient: &mut [f32],
) {
    let width = layer.width;
    let weights = layer.weight.chunks_exact(width);
    for (((&row, &g), weight), sum) in layer
        .row
        .iter()
        .zip(layer.gradient)
        .zip(weights)
        .zip(weight_gradient.chunks_exact_mut(width))
    {
        let at = row as usize * width..(row as usize + 1) * width;
        let (Some(hidden), Some(gradient)) =
            (layer.hidden.get(at.clone()), hidden_gradient.get_mut(at))
        else {
            continue;
        };
        for (sum, hidden) in sum.iter_mut().zip(hidden) {
            *sum += g * hidden;
        }
        for (gradient, weight) in gradient.iter_mut().zip(weight) {
            *gradient += g * weight;
        }
    }
}

/// Compiles a function of this file for an instruction set.
#[cfg(target_arch = "x86_64")]
macro_rules! with_features {
    ($features:literal: $name:ident = $of:ident($($arg:ident: $t:ty),*)) => {
        #[target_feature(enable = $features)]
        #[allow(clippy::too_many_arguments)]
        pub(super) fn $name($($arg: $t),*) {
            $of($($arg),*);
        }
    };
}

#[cfg(target_arch = "x86_64")]
with_features!("avx2": quantise_avx2 = quantise(width: usize, stride: usize, x: &[f32], codes: &mut [u8], scales: &mut [f32]));
#[cfg(target_arch = "x86_64")]
with_features!("avx512f": quantise_avx512 = quantise(width: usize, stride: usize, x: &[f32], codes: &mut [u8], scales: &mut [f32]));
#[cfg(target_arch = "x86_64")]
with_features!("avx2": winners_avx2 = winners(width: usize, rows: &[f32], bias: &[f32], hidden: &[f32], winner: &mut [u32], feature: &mut [f32]));
#[cfg(target_arch = "x86_64")]
with_features!("avx512f": winners_avx512 = winners(width: usize, rows: &[f32], bias: &[f32], hidden: &[f32], winner: &mut [u32], feature: &mut [f32]));
#[cfg(target_arch = "x86_64")]
with_features!("avx2": max_backward_avx2 = max_backward(layer: MaxBackward<'_>, weight_gradient: &mut [f32], hidden_gradient: &mut [f32]));
#[cfg(target_arch = "x86_64")]
with_features!("avx512f": max_backward_avx512 = max_backward(layer: MaxBackward<'_>, weight_gradient: &mut [f32], hidden_gradient: &mut [f32]));
