//! Layers of the network: views of arrays whose lengths were checked once. What [`crate::kernels`] read without bounds checks
//! follows from these types alone.

mod codes;
mod requantise;

use crate::dims::{PANEL, PANELS_TOGETHER};

pub(crate) use codes::nearest_even;
pub use codes::{Codes, QuantLayer, pack_codes, padded_codes};
pub use requantise::Requantise;

/// A view of one dense layer in f32, `y = W x + b`.
///
/// Kernels rely on these invariants: `outputs > 0`, `width` is `outputs` rounded up to whole panels, and the arrays have
/// exactly the lengths that [`Dense::panels`] and [`Dense::bias`] state. So safe code cannot make one of other lengths:
///
/// ```compile_fail,E0451
/// let (panels, bias) = ([1.0; 16], [0.0; 16]);
/// reagent_core::layer::Dense { inputs: 4096, outputs: 16, panels: &panels, bias: &bias };
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Dense<'a> {
    inputs: usize,
    outputs: usize,
    panels: &'a [f32],
    bias: &'a [f32],
}

impl<'a> Dense<'a> {
    /// A layer over arrays of exactly the padded lengths; `None` for any other length, or for no outputs.
    pub fn new(inputs: usize, outputs: usize, panels: &'a [f32], bias: &'a [f32]) -> Option<Self> {
        let width = outputs.checked_next_multiple_of(PANEL)?;
        let fits = width > 0 && bias.len() == width && panels.len() == inputs.checked_mul(width)?;
        fits.then_some(Dense {
            inputs,
            outputs,
            panels,
            bias,
        })
    }

    /// Length of `x`.
    #[inline(always)]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Length of `y`, without padding.
    #[inline(always)]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Length of `y`, padded to whole panels.
    #[inline(always)]
    pub fn width(&self) -> usize {
        self.bias.len()
    }

    /// `W` in panels, `[width / PANEL][inputs][PANEL]`.
    #[inline(always)]
    pub fn panels(&self) -> &'a [f32] {
        self.panels
    }

    /// `b`, padded to whole panels, `[width]`.
    #[inline(always)]
    pub fn bias(&self) -> &'a [f32] {
        self.bias
    }

    /// The layer in parts of [`PANELS_TOGETHER`] panels, each with the index of its first output.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (usize, Dense<'a>)> {
        let inputs = self.inputs;
        let outputs = PANELS_TOGETHER * PANEL;
        let panels = self.panels.chunks((inputs * outputs).max(1));
        let parts = panels.zip(self.bias.chunks(outputs));
        parts.enumerate().map(move |(i, (panels, bias))| {
            let part = Dense {
                inputs,
                outputs: bias.len(),
                panels,
                bias,
            };
            (i * outputs, part)
        })
    }
}

/// Copies a row-major `[outputs, inputs]` matrix into panels; `panels` must have the padded length.
pub fn pack_panels(inputs: usize, outputs: usize, row_major: &[f32], panels: &mut [f32]) {
    for (p, panel) in panels.chunks_exact_mut(inputs * PANEL).enumerate() {
        for (k, lanes) in panel.chunks_exact_mut(PANEL).enumerate() {
            for (lane, value) in lanes.iter_mut().enumerate() {
                let row = p * PANEL + lane;
                *value = if row < outputs {
                    row_major.get(row * inputs + k).copied().unwrap_or(0.0)
                } else {
                    0.0
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_other_lengths_are_no_layer() {
        let (panels, bias) = ([0.0; 48], [0.0; 16]);
        assert!(Dense::new(3, 9, &panels, &bias).is_some());
        for (inputs, outputs) in [
            (2, 9),
            (4096, 16),
            (3, 0),
            (3, 17),
            (usize::MAX, 16),
            (3, usize::MAX),
            (usize::MAX / 16 + 1 + 3, 16),
        ] {
            assert!(
                Dense::new(inputs, outputs, &panels, &bias).is_none(),
                "{inputs} {outputs}"
            );
        }
        assert!(Dense::new(usize::MAX, 0, &[], &[]).is_none());
    }
}
