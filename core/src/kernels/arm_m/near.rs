//! Points that lie close together share a bound, as in [`crate::kernels::pruned`]: a channel is
//! not summed if the bound is below its maximum. Here the bound is
//! `Σ w low + Σ max(w, 0) (high - low)`, one pass over a channel's weights for [`NEAR`] points.
#![allow(clippy::indexing_slicing)]

use crate::dims::{FEATURES, PANEL};

pub(super) use crate::kernels::pruned::NEAR;

/// Most inputs of a layer that can be pruned.
pub(super) const INPUTS: usize = 128;
/// Mean range of codes up to which a bound is worth its time. Neighbours have 12, which leaves a quarter of the channels;
/// points from anywhere have 60, which leaves nearly all.
const WORTH: u32 = 30;

/// For each panel, a bit for each output for which the points must be summed.
pub(super) type Masks = [u16; MASKS];
pub(super) const MASKS: usize = FEATURES / PANEL;

/// The lowest code of each input, and the range up to the highest.
#[repr(C)]
pub(super) struct Bounds {
    pub(super) low: [u8; INPUTS],
    pub(super) range: [u8; INPUTS],
}

impl Bounds {
    /// The bounds of rows of `inputs` codes, set by `fill`, which returns the sum of all ranges. `None` if the rows are too far
    /// apart, or the maxima have seen no point yet.
    #[inline(always)]
    pub(super) fn of(
        inputs: usize,
        max: &[i32],
        fill: impl FnOnce(&mut Bounds) -> u32,
    ) -> Option<Bounds> {
        let is_empty = max.first() == Some(&i32::MIN);
        if is_empty || inputs > INPUTS || max.len() > FEATURES {
            return None;
        }
        let mut bounds = Bounds {
            low: [0; INPUTS],
            range: [0; INPUTS],
        };
        let sum = fill(&mut bounds);
        (sum <= WORTH * inputs as u32).then_some(bounds)
    }
}

/// The positions of the set bits, from the lowest on.
#[cfg(arm_kernels = "dsp")]
pub(super) fn lanes(mut mask: u16) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = mask.trailing_zeros();
        mask &= mask.checked_sub(1)?;
        Some(lane as usize)
    })
}
