//! Maxima in f32 over points that lie close together. Only the sums that 8-bit integers do not rule out are computed in f32: no
//! maximum is lost, at little more than the cost of integers.
//!
//! With codes `q` of the weights and `a` of a group's activations, `w = u q + dw` and `h = s a + dh`, a
//! channel's sum is `Σ w h = u s Σ q a + Σ dw s a + Σ w dh`. By Cauchy-Schwarz, the last two terms are at most
//! `|dw| |s a| + |w| |dh|`, which are known norms. Rounding changes a sum in f32 by less than [`ROUNDING`] times
//! `|b| + |w| |h|`. So a point whose integer sum is below the maximum by more than that is below it in f32, too.

#![allow(unsafe_code, clippy::indexing_slicing)]
// Only x86-64 has a kernel.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

use super::split::Tile;
use crate::dims::{CODES, PANEL, QUAD};
use crate::kernels::pruned::{INPUTS, fits};
use crate::layer::{Codes, Dense, nearest_even};

/// Upper bound on the relative error of f32 sums of [`INPUTS`] products and a bias, and of the few operations on thresholds.
pub(in crate::kernels) const ROUNDING: f32 = 2.0 * (INPUTS + 8) as f32 * f32::EPSILON;
/// Factors stored for each channel.
const FACTORS: usize = 4;

/// A layer with its weights in 8 bits as well.
#[derive(Clone, Copy, Debug)]
pub struct SieveDense<'a> {
    /// The layer itself.
    pub(in crate::kernels) layer: Dense<'a>,
    /// Its weights in codes, symmetric in ±127 of each channel's largest magnitude.
    pub(in crate::kernels) codes: Codes<'a>,
    /// Its weights in f32, `[outputs, inputs]`.
    pub(in crate::kernels) rows: &'a [f32],
    /// `1 / u` of each channel.
    pub(in crate::kernels) per_unit: &'a [f32],
    /// `|w|` of each channel.
    pub(in crate::kernels) norm: &'a [f32],
    /// `|dw|` of each channel.
    pub(in crate::kernels) rest: &'a [f32],
    /// [`ROUNDING`] times `|b|` of each channel.
    pub(in crate::kernels) slack: &'a [f32],
}

/// Length of the codes in bytes, and of rows and factors in f32 values.
fn lengths(layer: &Dense<'_>) -> Option<(usize, usize)> {
    let (inputs, outputs) = (layer.inputs(), layer.width());
    let whole = inputs > 0 && fits(inputs, outputs) && inputs.is_multiple_of(CODES);
    whole.then_some((inputs * outputs, (inputs + FACTORS) * outputs))
}

impl<'a> SieveDense<'a> {
    /// A layer with memory that [`crate::kernels::PackedDense::pack`] filled from it; `None` if its length is not
    /// [`crate::kernels::PackedDense::tiles`].
    pub fn new(layer: &Dense<'a>, packed: &'a [Tile]) -> Option<Self> {
        let (codes, _) = lengths(layer)?;
        if packed_tiles(layer) != Some(packed.len()) {
            return None;
        }
        let (codes, floats) = bytemuck::cast_slice::<_, i8>(packed).split_at(codes);
        let floats: &[f32] = bytemuck::cast_slice(floats);
        let (rows, factors) = floats.split_at(layer.panels().len());
        let mut factors = factors.chunks_exact(layer.width());
        Some(SieveDense {
            layer: *layer,
            codes: Codes::new(layer.inputs(), layer.width(), codes)?,
            rows,
            per_unit: factors.next()?,
            norm: factors.next()?,
            rest: factors.next()?,
            slack: factors.next()?,
        })
    }
}

/// Tiles that a layer's codes and factors fill; `None` if it is too wide, or its inputs are not a multiple of [`CODES`].
pub(in crate::kernels) fn packed_tiles(layer: &Dense<'_>) -> Option<usize> {
    let (codes, floats) = lengths(layer)?;
    Some((codes + floats * size_of::<f32>()).div_ceil(size_of::<Tile>()))
}

/// Fills [`packed_tiles`] tiles; does nothing for another number of tiles.
pub(in crate::kernels) fn pack(layer: &Dense<'_>, memory: &mut [Tile]) {
    let Some((codes, _)) = lengths(layer).filter(|_| packed_tiles(layer) == Some(memory.len()))
    else {
        return;
    };
    let memory = bytemuck::cast_slice_mut::<_, i8>(memory);
    let (codes, floats) = memory.split_at_mut(codes);
    let floats: &mut [f32] = bytemuck::cast_slice_mut(floats);
    let (rows, factors) = floats.split_at_mut(layer.panels().len());
    for (channel, &bias) in layer.bias().iter().enumerate() {
        let (panel, lane) = (channel / PANEL, channel % PANEL);
        let weights = &layer.panels()[panel * layer.inputs() * PANEL..][..layer.inputs() * PANEL];
        let weights = weights.iter().skip(lane).step_by(PANEL);
        let largest = weights.clone().fold(0.0f32, |most, w| most.max(w.abs()));
        // A channel of zeros, or nearly so: all codes are zero, and only sums far below are ruled out.
        let unit = (largest / 127.0).max(f32::MIN_POSITIVE);
        let (mut norm, mut rest) = (0.0f64, 0.0f64);
        for (k, &w) in weights.enumerate() {
            rows[channel * layer.inputs() + k] = w;
            let code = nearest_even(w / unit);
            let quad = panel * layer.inputs() * PANEL + (k / QUAD * PANEL + lane) * QUAD;
            codes[quad + k % QUAD] = code as i8;
            norm += f64::from(w) * f64::from(w);
            let error = f64::from(w) - f64::from(unit) * f64::from(code);
            rest += error * error;
        }
        let up = |square: f64| libm::sqrt(square) as f32 * (1.0 + 1e-6);
        let values = [1.0 / unit, up(norm), up(rest), ROUNDING * bias.abs()];
        let places = factors.iter_mut().skip(channel).step_by(layer.width());
        for (place, value) in places.zip(values) {
            *place = value;
        }
    }
}
