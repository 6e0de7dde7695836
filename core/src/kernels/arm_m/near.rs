//! Points that lie close together share a bound, as in [`crate::kernels::pruned`]: what it leaves below a channel's maximum is
//! not summed up. Here the bound of a channel is `Σ w low + Σ max(w, 0) (high - low)`, one pass over its weights for
//! [`NEAR`] points.
#![allow(clippy::indexing_slicing)]

use crate::dims::{FEATURES, PANEL};

pub(super) use crate::kernels::pruned::NEAR;

/// Most inputs of a layer that is pruned.
pub(super) const INPUTS: usize = 128;
/// Mean difference of the highest and the lowest code, up to which a bound is worth its time: of neighbours it is 12, and a
/// quarter of the channels are left; of points from anywhere 60, and nearly all are.
const WORTH: u32 = 30;

/// Of each panel, a bit for each of its outputs for which the points are to be summed up.
pub(super) type Masks = [u16; MASKS];
pub(super) const MASKS: usize = FEATURES / PANEL;

/// The lowest of each input, and how much higher the highest is.
#[repr(C)]
pub(super) struct Bounds {
    pub(super) low: [u8; INPUTS],
    pub(super) range: [u8; INPUTS],
}

impl Bounds {
    /// Of rows of so many codes, by `fill`, which tells the sum of all ranges; none where they are too far apart, or the maxima
    /// are still without a point.
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

/// The bits that are set, from the lowest on.
#[cfg(arm_kernels = "dsp")]
pub(super) fn lanes(mut mask: u16) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = mask.trailing_zeros();
        mask &= mask.checked_sub(1)?;
        Some(lane as usize)
    })
}
