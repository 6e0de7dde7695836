//! Maxima over points that lie close together, without most of the sums.
//!
//! For [`NEAR`] points at a time, the highest and the lowest value of each input bound what a channel can reach
//! among them: `Σ w (w > 0 ? high : low)` (interval arithmetic), a sixteenth of the work. The points are summed only
//! if the bound is above the channel's maximum so far: for a quarter of all pairs of channel and group, if points are
//! in the order of [`crate::order`]. The maxima are the same to the bit in any order: integers are exact, and an f32
//! bound is summed as the points are, input by input, in steps that are monotonic despite rounding.

// Microcontrollers have their own kernels (`arm_m::near`), and NEON uses only part of it.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
#![allow(unsafe_code)]

use crate::dims::PANEL;

/// Points that share a bound.
pub(crate) const NEAR: usize = 16;
/// Most inputs of a layer that can be pruned.
pub(super) const INPUTS: usize = 128;
/// Channels whose points are summed together.
pub(super) const CHANNELS: usize = 8;
/// Panels of weights taken at a time, so that they stay in the cache while the groups pass.
pub(super) const PANELS: usize = 8;

/// Whether a layer can be pruned: it has inputs, not too many, and channel numbers fit 16 bits.
pub(super) fn fits(inputs: usize, outputs: usize) -> bool {
    (1..=INPUTS).contains(&inputs) && outputs <= 1 << u16::BITS
}

/// Channels for which a group's points must be summed.
#[derive(Clone, Copy)]
pub(super) struct Survivors {
    channels: [u16; (PANELS + 1) * PANEL],
    count: usize,
}

impl Survivors {
    const NONE: Survivors = Survivors {
        channels: [0; (PANELS + 1) * PANEL],
        count: 0,
    };

    /// Adds the first `count` of `channels`.
    #[inline(always)]
    pub(super) fn add(&mut self, channels: [u16; PANEL], count: u32) {
        let end = self.count.min(PANELS * PANEL);
        self.channels[end..end + PANEL].copy_from_slice(&channels);
        self.count = end + count as usize;
    }

    /// Adds the channels of a panel whose bit is set in `mask`.
    #[inline(always)]
    pub(super) fn add_of(&mut self, panel: usize, mut mask: u16) {
        while mask != 0 {
            let at = self.count.min(PANELS * PANEL);
            self.channels[at] = (panel * PANEL) as u16 + mask.trailing_zeros() as u16;
            self.count = at + 1;
            mask &= mask - 1;
        }
    }

    /// All channels in whole chunks; the last one is repeated to fill the last chunk.
    #[inline(always)]
    fn together(&mut self) -> &[[u16; CHANNELS]] {
        let count = self.count.min(PANELS * PANEL);
        if let Some(&last) = self.channels[..count].last() {
            self.channels[count..count + CHANNELS].fill(last);
        }
        self.channels[..count.next_multiple_of(CHANNELS)]
            .as_chunks()
            .0
    }
}

/// Groups of points, and the maxima that they may raise.
pub(super) trait Pruned<const GROUPS: usize> {
    /// For each group, adds the channels of some panels from `panel` on whose bound is above the maximum.
    ///
    /// # Safety
    /// There are such panels; the machine runs the instruction set.
    unsafe fn bound(&mut self, panel: usize, survivors: &mut [Survivors; GROUPS]);

    /// Folds the points of a group into the maxima of some channels, some of which may repeat.
    ///
    /// # Safety
    /// There is such a group, and [`Pruned::bound`] added the channels to it, not more than [`PANELS`] panels ago; the machine
    /// runs the instruction set.
    unsafe fn raise(&mut self, group: usize, channels: &[u16; CHANNELS]);
}

/// Goes through all panels, `STEP` at a time, with the first `count` groups, at most `GROUPS`.
///
/// # Safety
/// There are as many panels and groups; the machine runs the instruction set.
// A trait, since a closure may be left out of line, where it has no instruction set: a hundred times slower.
#[inline(always)]
pub(super) unsafe fn prune<const STEP: usize, const GROUPS: usize>(
    panels: usize,
    count: usize,
    groups: &mut impl Pruned<GROUPS>,
) {
    for first in (0..panels).step_by(PANELS) {
        let mut survivors = [Survivors::NONE; GROUPS];
        for panel in (first..panels.min(first + PANELS)).step_by(STEP) {
            // SAFETY: as the caller guarantees.
            unsafe { groups.bound(panel, &mut survivors) };
        }
        for (group, survivors) in survivors.iter_mut().enumerate().take(count) {
            for channels in survivors.together() {
                // SAFETY: the channels are those of this block of panels.
                unsafe { groups.raise(group, channels) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::kernels::Isa;
    use crate::layer::Dense;

    #[test]
    fn a_layer_without_inputs_changes_nothing() {
        let layer = Dense::new(0, 16, &[], &[1.0; 16]).expect("no weights");
        for isa in Isa::all() {
            let mut max = [0.0; 16];
            isa.dense_max_near(&layer, &[], &mut max);
            assert_eq!(max, [0.0; 16], "{}", isa.name());
        }
    }
}
