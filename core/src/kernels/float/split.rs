//! f32 as the sum of three bf16: an f32 layer at the speed of bf16 tiles, without their loss of precision.
//!
//! The 24 bits of an f32's significand are cut into three times eight, which is exact: `x = h + m + l`. Of the nine products of
//! two such numbers, the six largest are summed, in f32; the other three are below 2^-23 of the product. So the sums are as
//! close to the exact ones as those of fused multiply-add in f32.

#![allow(unsafe_code, clippy::indexing_slicing)]
// Only x86-64 has a kernel.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

use crate::dims::{EMBED, PANEL};
use crate::layer::Dense;

/// Parts of a number.
pub(in crate::kernels) const PARTS: usize = 3;
/// Inputs of one tile of activations: a row of 64 bytes.
pub(in crate::kernels) const TILE_INPUTS: usize = 32;
/// Most inputs of a layer.
pub(in crate::kernels) const INPUTS: usize = EMBED[1];
/// Outputs in a block; a layer has a multiple of this.
const BLOCK: usize = 4 * PANEL;

/// One part of 32 inputs of 16 points or outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Tile(pub(in crate::kernels) [u16; PANEL * TILE_INPUTS]);

// SAFETY: an array of integers, of a size that its alignment divides.
unsafe impl bytemuck::Zeroable for Tile {}
// SAFETY: as above.
unsafe impl bytemuck::Pod for Tile {}

impl Tile {
    /// A tile of zeros.
    pub const ZERO: Tile = Tile([0; PANEL * TILE_INPUTS]);
}

/// A layer whose weights are split.
#[derive(Clone, Copy, Debug)]
pub struct SplitDense<'a> {
    /// The layer itself; its inputs are a multiple of 32, at most [`INPUTS`].
    pub(in crate::kernels) layer: Dense<'a>,
    /// Its weights in parts, from [`crate::kernels::PackedDense::pack`].
    pub(in crate::kernels) tiles: &'a [Tile],
}

impl<'a> SplitDense<'a> {
    /// A layer with memory that [`crate::kernels::PackedDense::pack`] filled from it; `None` if its length is not
    /// [`crate::kernels::PackedDense::tiles`].
    pub fn new(layer: &Dense<'a>, packed: &'a [Tile]) -> Option<Self> {
        (packed_tiles(layer) == Some(packed.len())).then_some(SplitDense {
            layer: *layer,
            tiles: packed,
        })
    }
}

/// Tiles that a layer's weights fill; `None` if inputs are not a multiple of 32, outputs not of 64, or inputs too many.
pub(in crate::kernels) fn packed_tiles(layer: &Dense<'_>) -> Option<usize> {
    let (inputs, outputs) = (layer.inputs(), layer.width());
    let whole = inputs.is_multiple_of(TILE_INPUTS) && outputs.is_multiple_of(BLOCK);
    let whole = whole && (1..=INPUTS).contains(&inputs);
    whole.then(|| outputs / PANEL * (inputs / TILE_INPUTS) * PARTS)
}

/// Splits a layer's weights into `[outputs / 16][inputs / 32][part]`; each tile is `[inputs / 2][output][2]`.
pub(in crate::kernels) fn pack(layer: &Dense<'_>, memory: &mut [Tile]) {
    let groups = layer.panels().chunks_exact(PANEL * TILE_INPUTS);
    for (group, parts) in groups.zip(memory.as_chunks_mut::<PARTS>().0) {
        for (k, lanes) in group.chunks_exact(PANEL).enumerate() {
            for (output, &weight) in lanes.iter().enumerate() {
                for (tile, part) in parts.iter_mut().zip(split(weight)) {
                    tile.0[(k / 2 * PANEL + output) * 2 + k % 2] = part;
                }
            }
        }
    }
}

/// The upper 16 bits of each of the three parts.
#[inline(always)]
fn split(x: f32) -> [u16; PARTS] {
    let upper = |x: f32| f32::from_bits(x.to_bits() & 0xffff_0000);
    let high = upper(x);
    let middle = upper(x - high);
    let low = x - high - middle;
    [high, middle, low].map(|part| (part.to_bits() >> 16) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn three_parts_are_the_whole_number(x in proptest::num::f32::NORMAL) {
            // Below this, parts become subnormal.
            prop_assume!(x.abs() > 1e-30);
            let parts = split(x).map(|part| f64::from(f32::from_bits(u32::from(part) << 16)));
            prop_assert_eq!(parts.iter().sum::<f64>(), f64::from(x));
        }
    }
}
