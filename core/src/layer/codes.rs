//! Layers in 8-bit integers.

use crate::dims::{CODES, PANEL, QUAD};

/// Length of a padded row of codes.
pub const fn padded_codes(inputs: usize) -> usize {
    inputs.div_ceil(CODES) * CODES
}

/// Signed weight codes of one layer.
///
/// Kernels rely on these invariants: `inputs` is a positive multiple of [`CODES`], `outputs` of [`PANEL`], and there are
/// exactly as many codes as [`Codes::panels`] states.
#[derive(Clone, Copy, Debug)]
pub struct Codes<'a> {
    inputs: usize,
    outputs: usize,
    panels: &'a [i8],
}

impl<'a> Codes<'a> {
    /// A view of codes of exactly the padded length; `None` for any other length.
    pub fn new(inputs: usize, outputs: usize, panels: &'a [i8]) -> Option<Self> {
        let fits = inputs > 0
            && outputs > 0
            && inputs.is_multiple_of(CODES)
            && outputs.is_multiple_of(PANEL)
            && panels.len() == inputs.checked_mul(outputs)?;
        fits.then_some(Codes {
            inputs,
            outputs,
            panels,
        })
    }

    /// Length of a row of activation codes, a multiple of [`CODES`].
    #[inline(always)]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Outputs, padded to whole panels.
    #[inline(always)]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// The codes in panels, `[outputs / PANEL][inputs / 4][PANEL][4]`.
    #[inline(always)]
    pub fn panels(&self) -> &'a [i8] {
        self.panels
    }

    /// The layer in parts of `panels` panels, each with the index of its first output.
    pub(crate) fn parts(&self, panels: usize) -> impl Iterator<Item = (usize, Codes<'a>)> {
        let (inputs, outputs) = (self.inputs, panels * PANEL);
        let parts = self.panels.chunks((inputs * outputs).max(1));
        parts.enumerate().map(move |(i, panels)| {
            let part = Codes {
                inputs,
                outputs: panels.len() / inputs.max(1),
                panels,
            };
            (i * outputs, part)
        })
    }
}

/// An integer layer.
///
/// Kernels rely on it: the bias and the requantisation have one entry for each output.
#[derive(Clone, Copy, Debug)]
pub struct QuantLayer<'a> {
    codes: Codes<'a>,
    bias: &'a [i32],
    requantise: &'a [u32],
}

impl<'a> QuantLayer<'a> {
    /// A layer whose arrays have one entry for each output; `None` for any other length.
    pub fn new(codes: Codes<'a>, bias: &'a [i32], requantise: &'a [u32]) -> Option<Self> {
        let fits = bias.len() == codes.outputs && requantise.len() == codes.outputs;
        fits.then_some(QuantLayer {
            codes,
            bias,
            requantise,
        })
    }

    /// Weights.
    #[inline(always)]
    pub fn codes(&self) -> &Codes<'a> {
        &self.codes
    }

    /// Bias, padded to whole panels.
    #[inline(always)]
    pub fn bias(&self) -> &'a [i32] {
        self.bias
    }

    /// Factors that turn sums into codes ([`super::Requantise`]), one for each bias; or scales of logits, as bits of f32.
    #[inline(always)]
    pub fn requantise(&self) -> &'a [u32] {
        self.requantise
    }
}

/// Quantises a row-major `[outputs, inputs]` matrix to codes, symmetric
/// in ±127 of each row's largest magnitude; `panels` as in [`Codes`].
pub fn pack_codes(inputs: usize, row_major: &[f32], panels: &mut [i8]) {
    let stride = padded_codes(inputs);
    panels.fill(0);
    for (p, panel) in panels.chunks_exact_mut(stride * PANEL).enumerate() {
        for lane in 0..PANEL {
            let at = (p * PANEL + lane) * inputs;
            let row = row_major.get(at..at + inputs).unwrap_or(&[]);
            let largest = row.iter().fold(0.0f32, |m, w| m.max(w.abs()));
            let to_code = if largest > 0.0 { 127.0 / largest } else { 0.0 };
            for (quad, weights) in panel.chunks_exact_mut(PANEL * QUAD).zip(row.chunks(QUAD)) {
                for (code, w) in quad.iter_mut().skip(lane * QUAD).zip(weights) {
                    *code = nearest_even(w * to_code) as i8;
                }
            }
        }
    }
}

/// Rounds to the nearest integer, ties to even, for magnitudes below 2^22.
#[inline(always)]
pub(crate) fn nearest_even(x: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0; // 1.5 * 2^23: one unit in the last place is 1
    (x + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_other_lengths_are_no_layer() {
        let panels = [0; 64 * 16];
        assert!(Codes::new(64, 16, &panels).is_some());
        for (inputs, outputs) in [
            (0, 16),
            (64, 0),
            (32, 32),
            (128, 8),
            (128, 16),
            (usize::MAX / 64 * 64, 16),
        ] {
            assert!(
                Codes::new(inputs, outputs, &panels).is_none(),
                "{inputs} {outputs}"
            );
        }
        assert!(Codes::new(usize::MAX / 64 * 64, 0, &[]).is_none());
        let codes = Codes::new(64, 16, &panels).expect("whole panels");
        assert!(QuantLayer::new(codes, &[0; 16], &[0; 15]).is_none());
    }
}
