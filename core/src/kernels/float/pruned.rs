//! The last embedding layer over points that lie close together. Lanes are
//! channels for bounds, and points for sums. See [`crate::kernels::pruned`].
//!
//! # Safety
//! For every function: as [`Vector`] requires; the layer's arrays have their padded lengths and it has at most [`INPUTS`]
//! inputs, and `max` is as long as its bias. [`crate::kernels::Isa`] checks it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::dense::{columns_and_bias, load_column};
use super::vector::Vector;
use crate::dims::{PANEL, TILE};
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, Pruned, Survivors, prune};
use crate::layer::Dense;
use core::marker::PhantomData;

/// Groups whose bounds are computed together, so that a weight is loaded once for all of them.
const GROUPS: usize = TILE / NEAR;

const _: () = assert!(NEAR == PANEL);

/// Activations of [`NEAR`] points.
#[derive(Clone, Copy)]
struct Group {
    /// The activations of each point, by input.
    points: [[f32; NEAR]; INPUTS],
    /// The highest and the lowest activation of each input.
    high: [f32; INPUTS],
    low: [f32; INPUTS],
}

impl Group {
    const ZERO: Group = Group {
        points: [[0.0; NEAR]; INPUTS],
        high: [0.0; INPUTS],
        low: [0.0; INPUTS],
    };

    /// Fills groups with rows; returns how many groups it filled.
    #[inline(always)]
    fn fill_all(groups: &mut [Group], inputs: usize, rows: &[f32]) -> usize {
        let mut count = 0;
        for (group, rows) in groups.iter_mut().zip(rows.chunks(NEAR * inputs)) {
            group.fill(inputs, rows);
            count += 1;
        }
        count
    }

    /// Fills a group with rows; if there are too few, repeats the last one.
    #[inline(always)]
    fn fill(&mut self, inputs: usize, rows: &[f32]) {
        let last = rows.len() / inputs - 1;
        self.high.fill(f32::NEG_INFINITY);
        self.low.fill(f32::INFINITY);
        for lane in 0..NEAR {
            let row = &rows[lane.min(last) * inputs..][..inputs];
            for (high, &value) in self.high.iter_mut().zip(row) {
                *high = if value > *high { value } else { *high };
            }
            for (low, &value) in self.low.iter_mut().zip(row) {
                *low = if value < *low { value } else { *low };
            }
            for (points, &value) in self.points.iter_mut().zip(row) {
                points[lane] = value;
            }
        }
    }
}

/// See [`crate::kernels::Isa::dense_max_near`]; `x` holds `points` rows. The bounds of `P` panels, and the sums of `C`
/// channels, fit the registers.
#[inline(always)]
pub(in crate::kernels) unsafe fn max<V: Vector, const P: usize, const C: usize>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    max: &mut [f32],
) {
    let mut groups = [Group::ZERO; GROUPS];
    for x in x[..points * layer.inputs()].chunks(GROUPS * NEAR * layer.inputs()) {
        let count = Group::fill_all(&mut groups, layer.inputs(), x);
        let max = max.as_mut_ptr();
        // SAFETY: as the caller guarantees.
        unsafe {
            match count {
                1 => max_of_groups::<V, P, C, 1>(layer, &groups, count, max),
                _ => max_of_groups::<V, P, C, GROUPS>(layer, &groups, count, max),
            }
        }
    }
}

/// Folds the first `count` groups, at most `N`, into all maxima.
#[inline(always)]
unsafe fn max_of_groups<V: Vector, const P: usize, const C: usize, const N: usize>(
    layer: &Dense<'_>,
    groups: &[Group; GROUPS],
    count: usize,
    max: *mut f32,
) {
    let mut of = Groups::<V, P, C> {
        layer,
        groups,
        max,
        vector: PhantomData,
    };
    // SAFETY: as the caller guarantees.
    unsafe { prune::<P, N>(layer.width() / PANEL, count, &mut of) }
}

/// Some groups, and the maxima that they may raise.
struct Groups<'a, V, const P: usize, const C: usize> {
    layer: &'a Dense<'a>,
    groups: &'a [Group; GROUPS],
    max: *mut f32,
    vector: PhantomData<V>,
}

impl<V: Vector, const P: usize, const C: usize, const N: usize> Pruned<N> for Groups<'_, V, P, C> {
    #[inline(always)]
    unsafe fn bound(&mut self, panel: usize, survivors: &mut [Survivors; N]) {
        let panels = self.layer.width() / PANEL;
        // SAFETY: the caller guarantees the first panel.
        unsafe {
            if panel + P <= panels {
                bound::<V, P, N>(self.layer, panel, self.groups, self.max, survivors);
            } else {
                for panel in panel..panels {
                    bound::<V, 1, N>(self.layer, panel, self.groups, self.max, survivors);
                }
            }
        }
    }

    #[inline(always)]
    unsafe fn raise(&mut self, group: usize, channels: &[u16; CHANNELS]) {
        const { assert!(CHANNELS.is_multiple_of(C)) }
        // SAFETY: the caller guarantees the group and the channels.
        unsafe {
            let group = self.groups.get_unchecked(group);
            for channels in channels.as_chunks::<C>().0 {
                raise::<V, C>(self.layer, group, channels, self.max);
            }
        }
    }
}

/// For each group, adds the channels of `P` panels from `panel` on whose bound is above the maximum.
#[inline(always)]
unsafe fn bound<V: Vector, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    panel: usize,
    groups: &[Group; GROUPS],
    max: *const f32,
    survivors: &mut [Survivors; N],
) {
    // SAFETY: the caller guarantees the panels; no more groups are asked for than there are.
    unsafe {
        let (weights, start) = columns_and_bias::<V, P>(layer, layer.inputs(), panel);
        let mut sum = [start; N];
        for k in 0..layer.inputs() {
            let w = load_column::<V, P>(weights, k);
            for n in 0..N {
                let group = groups.get_unchecked(n);
                let high = V::splat(*group.high.get_unchecked(k));
                let low = V::splat(*group.low.get_unchecked(k));
                for p in 0..P {
                    sum[n][p] = sum[n][p].add_product(w[p], w[p].extreme(high, low));
                }
            }
        }
        for p in 0..P {
            let max = V::load(max.add((panel + p) * PANEL));
            for n in 0..N {
                V::add_channels(panel + p, sum[n][p].exceeds(max), &mut survivors[n]);
            }
        }
    }
}

/// Folds the points of a group into the maxima of some channels.
#[inline(always)]
unsafe fn raise<V: Vector, const C: usize>(
    layer: &Dense<'_>,
    group: &Group,
    channels: &[u16; C],
    max: *mut f32,
) {
    let mut weights = [layer.panels().as_ptr(); C];
    // SAFETY: the caller guarantees the channels.
    unsafe {
        let mut sum = [V::splat(0.0); C];
        for c in 0..C {
            let channel = usize::from(channels[c]);
            sum[c] = V::splat(*layer.bias().get_unchecked(channel));
            let column = channel / PANEL * layer.inputs() * PANEL + channel % PANEL;
            weights[c] = weights[c].add(column);
        }
        for k in 0..layer.inputs() {
            let points = V::load(group.points.get_unchecked(k).as_ptr());
            for c in 0..C {
                let w = V::splat(*weights[c].add(k * PANEL));
                sum[c] = sum[c].add_product(w, points);
            }
        }
        for c in 0..C {
            sum[c].raise(&mut *max.add(channels[c].into()));
        }
    }
}
