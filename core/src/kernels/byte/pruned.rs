//! The last embedding layer of integers over points that lie close together. Lanes are channels for bounds, and points for sums.
//! See [`crate::kernels::pruned`].
//!
//! # Safety
//! For every function: as [`Sums`] requires; the layer has at most [`INPUTS`] inputs, and `max` is as long as its outputs.
//! [`crate::kernels::Isa`] checks it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::vector::Sums;
use crate::dims::PANEL;
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, Pruned, Survivors, prune};
use crate::layer::Codes;

const _: () = assert!(NEAR == PANEL);

/// Sums that can be bounded. Codes and weights are multiplied in words of 32 bits; `WORDS` of them hold [`INPUTS`] inputs.
///
/// # Safety
/// For every function: as [`Sums`] requires; panels are the layer's.
pub(in crate::kernels) trait Bounds<const WORDS: usize>: Sums {
    /// Weights in words, of as many panels as [`prune`] takes at a time. Nothing, if the layer's own are such words.
    type Spread;
    /// Weights of no panel.
    const NONE: Self::Spread;

    /// Fills a group with rows, at least one, of `inputs` codes, a multiple of 64. If there are too few, repeats the last one.
    unsafe fn fill(group: &mut Group<WORDS>, inputs: usize, rows: &[u8]);
    /// Spreads the weights of a panel, in place of those of an earlier one.
    unsafe fn spread(layer: &Codes<'_>, panel: usize, to: &mut Self::Spread);
    /// The weights of a panel that is spread, `[word][output]`.
    unsafe fn weights(layer: &Codes<'_>, panel: usize, spread: &Self::Spread) -> *const i32;

    /// Adds the products of codes and weights.
    unsafe fn add_words(self, codes: Self, weights: Self) -> Self;
    /// Adds the products of weights and extreme codes: of `low` where a weight is negative, of `high` elsewhere. With AVX2, the
    /// extremes of both halves at once would not fit the registers.
    unsafe fn add_extremes(self, high: Self, low: Self, weights: Self) -> Self;
    /// A bit for each sum that is above `other`'s.
    unsafe fn exceeds(self, other: Self) -> u16;
    /// Raises `max` to the largest sum.
    unsafe fn raise(self, max: &mut i32);

    /// Adds the channels of a panel whose bit is set in `mask`.
    #[inline(always)]
    unsafe fn add_channels(panel: usize, mask: u16, survivors: &mut Survivors) {
        survivors.add_of(panel, mask);
    }
}

/// Codes of [`NEAR`] points, a few inputs to a word.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Group<const WORDS: usize> {
    /// The codes of each point.
    pub(in crate::kernels) points: [[u32; NEAR]; WORDS],
    /// The highest and the lowest code of each input.
    pub(in crate::kernels) high: [u32; WORDS],
    pub(in crate::kernels) low: [u32; WORDS],
}

impl<const WORDS: usize> Group<WORDS> {
    pub(in crate::kernels) const ZERO: Self = Group {
        points: [[0; NEAR]; WORDS],
        high: [0; WORDS],
        low: [0; WORDS],
    };
}

/// See [`crate::kernels::Isa::dense_codes_max_near`]. The bounds of one panel for `N` groups, and the sums of `C` channels, fit
/// the registers.
#[inline(always)]
pub(in crate::kernels) unsafe fn max<V, const WORDS: usize, const N: usize, const C: usize>(
    layer: &Codes<'_>,
    x: &[u8],
    max: &mut [i32],
) where
    V: Bounds<WORDS>,
{
    let inputs = layer.inputs();
    let mut groups = [Group::<WORDS>::ZERO; N];
    let mut spread = V::NONE;
    let whole = x.len() - x.len() % inputs;
    for x in x[..whole].chunks(N * NEAR * inputs) {
        let mut count = 0;
        for (group, rows) in groups.iter_mut().zip(x.chunks(NEAR * inputs)) {
            // SAFETY: the caller guarantees the width of rows.
            unsafe { V::fill(group, inputs, rows) };
            count += 1;
        }
        let (spread, max) = (&mut spread, &mut *max);
        // SAFETY: as the caller guarantees.
        unsafe {
            match count {
                1 => max_of_groups::<V, WORDS, 1, C>(layer, &groups, count, spread, max),
                2..=4 if N > 4 => {
                    max_of_groups::<V, WORDS, 4, C>(layer, &groups, count, spread, max)
                }
                _ => max_of_groups::<V, WORDS, N, C>(layer, &groups, count, spread, max),
            }
        }
    }
}

/// Folds the first `count` groups, at most `N`, into all maxima.
#[inline(always)]
unsafe fn max_of_groups<V, const WORDS: usize, const N: usize, const C: usize>(
    layer: &Codes<'_>,
    groups: &[Group<WORDS>],
    count: usize,
    spread: &mut V::Spread,
    max: &mut [i32],
) where
    V: Bounds<WORDS>,
{
    let max = max.as_mut_ptr();
    let mut of = Groups::<V, WORDS, C> {
        layer,
        groups,
        spread,
        max,
    };
    // SAFETY: as the caller guarantees.
    unsafe { prune::<1, N>(layer.outputs() / PANEL, count, &mut of) }
}

/// Some groups, and the maxima that they may raise.
struct Groups<'a, V: Bounds<WORDS>, const WORDS: usize, const C: usize> {
    layer: &'a Codes<'a>,
    groups: &'a [Group<WORDS>],
    spread: &'a mut V::Spread,
    max: *mut i32,
}

impl<V, const WORDS: usize, const N: usize, const C: usize> Pruned<N> for Groups<'_, V, WORDS, C>
where
    V: Bounds<WORDS>,
{
    #[inline(always)]
    unsafe fn bound(&mut self, panel: usize, survivors: &mut [Survivors; N]) {
        // SAFETY: the caller guarantees the panel; there are at least `N` groups.
        unsafe {
            V::spread(self.layer, panel, self.spread);
            let weights = V::weights(self.layer, panel, self.spread);
            let bounds = bounds::<V, WORDS, N>(self.layer, weights, self.groups);
            let max = V::load(self.max.add(panel * PANEL));
            for (survivors, bound) in survivors.iter_mut().zip(bounds) {
                V::add_channels(panel, bound.exceeds(max), survivors);
            }
        }
    }

    #[inline(always)]
    unsafe fn raise(&mut self, group: usize, channels: &[u16; CHANNELS]) {
        const { assert!(CHANNELS.is_multiple_of(C)) }
        // SAFETY: the caller guarantees the group and the channels, whose panels were spread.
        unsafe {
            let group = self.groups.get_unchecked(group);
            for channels in channels.as_chunks::<C>().0 {
                let sums = sums::<V, WORDS, C>(self.layer, self.spread, group, channels);
                for c in 0..C {
                    sums[c].raise(&mut *self.max.add(channels[c].into()));
                }
            }
        }
    }
}

/// Upper bounds on the sums of one panel, whose weights are given, for the points of the first `N` groups.
#[inline(always)]
pub(in crate::kernels) unsafe fn bounds<V: Bounds<WORDS>, const WORDS: usize, const N: usize>(
    layer: &Codes<'_>,
    weights: *const i32,
    groups: &[Group<WORDS>],
) -> [V; N] {
    // SAFETY: the caller guarantees the weights and the groups.
    unsafe {
        let mut sum = [V::splat(0); N];
        for k in 0..words_of::<WORDS>(layer) {
            let w = V::load(weights.add(k * PANEL));
            for n in 0..N {
                let group = groups.get_unchecked(n);
                let high = V::splat(*group.high.get_unchecked(k) as i32);
                let low = V::splat(*group.low.get_unchecked(k) as i32);
                sum[n] = sum[n].add_extremes(high, low, w);
            }
        }
        sum
    }
}

/// Sums of some channels, one lane for each point of a group.
#[inline(always)]
pub(in crate::kernels) unsafe fn sums<V: Bounds<WORDS>, const WORDS: usize, const C: usize>(
    layer: &Codes<'_>,
    spread: &V::Spread,
    group: &Group<WORDS>,
    channels: &[u16; C],
) -> [V; C] {
    // SAFETY: the caller guarantees the channels, and that the weights of their panels are ready.
    unsafe {
        let mut sum = [V::splat(0); C];
        let mut weights = [core::ptr::null::<i32>(); C];
        for c in 0..C {
            let (panel, lane) = (usize::from(channels[c]) / PANEL, channels[c] % PANEL as u16);
            weights[c] = V::weights(layer, panel, spread).add(lane.into());
        }
        for k in 0..words_of::<WORDS>(layer) {
            let points = V::load(group.points.get_unchecked(k).as_ptr().cast());
            for c in 0..C {
                let w = V::splat(weights[c].add(k * PANEL).read_unaligned());
                sum[c] = sum[c].add_words(points, w);
            }
        }
        sum
    }
}

/// Words that hold the inputs of a layer.
#[inline(always)]
fn words_of<const WORDS: usize>(layer: &Codes<'_>) -> usize {
    layer.inputs() / (INPUTS / WORDS)
}
