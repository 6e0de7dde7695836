//! Maxima over points that lie close together, without most of their sums.
//!
//! For [`NEAR`] points at a time, the highest and the lowest value of each input bound what a channel can reach among
//! them: `Σ w (w > 0 ? high : low)` (interval arithmetic), a sixteenth of the work. Only where that is above the
//! channel's maximum so far are the points summed up: a third of all pairs of channel and group, where the order of
//! points is that of [`crate::order`]. In any order the maxima are the same to the bit: integers are exact, and in f32
//! a bound is summed up as the points are, input by input, each step of which is monotonic, rounding included.

// Microcontrollers have kernels of their own (`arm_m::near`), and NEON does not use all of it.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

use crate::dims::PANEL;

/// Points that share a bound.
pub(crate) const NEAR: usize = 16;
/// Most inputs of a layer that is pruned.
pub(super) const INPUTS: usize = 128;
/// Channels whose points are summed up together.
pub(super) const CHANNELS: usize = 8;
/// Panels of weights at a time, so that they stay in the cache while the groups pass.
pub(super) const PANELS: usize = 8;

/// Whether a layer can be pruned: it has inputs, and there is room for them, and a channel's number has 16 bits.
pub(super) fn fits(inputs: usize, outputs: usize) -> bool {
    (1..=INPUTS).contains(&inputs) && outputs <= 1 << u16::BITS
}

/// Channels for which the points of a group are to be summed up.
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

    /// Adds the first `count` of some channels.
    #[inline(always)]
    pub(super) fn add(&mut self, channels: [u16; PANEL], count: u32) {
        let end = self.count.min(PANELS * PANEL);
        self.channels[end..end + PANEL].copy_from_slice(&channels);
        self.count = end + count as usize;
    }

    /// Adds the channels of a panel that a mask tells.
    #[inline(always)]
    pub(super) fn add_of(&mut self, panel: usize, mut mask: u16) {
        while mask != 0 {
            let at = self.count.min(PANELS * PANEL);
            self.channels[at] = (panel * PANEL) as u16 + mask.trailing_zeros() as u16;
            self.count = at + 1;
            mask &= mask - 1;
        }
    }

    /// All of them; the last one again and again, where they are not whole.
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

/// Goes through all panels, `STEP` at a time, with `groups` groups, at most `GROUPS`: `bound` says for which channels of
/// these panels the bound of each group is above the maximum; `raise` takes the points of a group into the maxima of
/// some channels, some of them more than once.
#[inline(always)]
pub(super) fn prune<const STEP: usize, const GROUPS: usize>(
    panels: usize,
    groups: usize,
    mut bound: impl FnMut(usize, &mut [Survivors; GROUPS]),
    mut raise: impl FnMut(usize, &[u16; CHANNELS]),
) {
    for first in (0..panels).step_by(PANELS) {
        let mut survivors = [Survivors::NONE; GROUPS];
        for panel in (first..panels.min(first + PANELS)).step_by(STEP) {
            bound(panel, &mut survivors);
        }
        for (group, survivors) in survivors.iter_mut().enumerate().take(groups) {
            for channels in survivors.together() {
                raise(group, channels);
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
