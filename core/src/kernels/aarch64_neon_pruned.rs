//! The last embedding layer over points that lie close together, with NEON, in f32: lanes are channels where bounds are
//! computed, and points where sums are. See [`super::pruned`].
//!
//! Every function must only be called with a layer whose arrays have their padded lengths and at most
//! [`super::pruned::INPUTS`] inputs, and `max` as long as its bias; [`super::Isa`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::pruned::{CHANNELS, Floats, NEAR, Survivors, prune};
use crate::dims::{PANEL, TILE};
use crate::layer::Dense;
use core::arch::aarch64::*;

/// Groups whose bounds are computed together, so that a weight is loaded once for all.
const GROUPS: usize = TILE / NEAR;
/// Values of one register.
const LANES: usize = 4;
/// Registers of one panel, or of a group's points.
const QUARTERS: usize = 4;
/// Channels whose sums have room in the registers.
const TOGETHER: usize = 4;

const _: () = assert!(QUARTERS * LANES == PANEL && QUARTERS * LANES == NEAR);
const _: () = assert!(CHANNELS.is_multiple_of(TOGETHER));

#[inline(always)]
unsafe fn load(from: *const f32) -> [float32x4_t; QUARTERS] {
    // SAFETY: the caller guarantees sixteen values.
    core::array::from_fn(|q| unsafe { vld1q_f32(from.add(q * LANES)) })
}

/// See [`super::Isa::dense_max_near`]; `points` rows.
pub(super) unsafe fn dense_max(layer: &Dense<'_>, points: usize, x: &[f32], max: &mut [f32]) {
    let mut groups = [Floats::ZERO; GROUPS];
    for x in x[..points * layer.inputs()].chunks(GROUPS * NEAR * layer.inputs()) {
        let count = Floats::fill_all(&mut groups, layer.inputs(), x);
        let max = max.as_mut_ptr();
        prune::<1, GROUPS>(
            layer.width() / PANEL,
            count,
            // SAFETY: the caller guarantees the maxima of each panel.
            |panel, survivors| unsafe { bound(layer, panel, &groups, max, survivors) },
            // SAFETY: groups and channels are those of bounds.
            |group, channels| unsafe {
                for channels in channels.as_chunks::<TOGETHER>().0 {
                    raise(layer, groups.get_unchecked(group), channels, max);
                }
            },
        );
    }
}

/// For each group, adds the channels of one panel whose bound is above the maximum.
#[inline(always)]
unsafe fn bound(
    layer: &Dense<'_>,
    panel: usize,
    groups: &[Floats; GROUPS],
    max: *const f32,
    survivors: &mut [Survivors; GROUPS],
) {
    // SAFETY: the caller guarantees the panel.
    unsafe {
        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
        let mut sum = [load(layer.bias().as_ptr().add(panel * PANEL)); GROUPS];
        for k in 0..layer.inputs() {
            let w = load(weights.add(k * PANEL));
            for (sum, group) in sum.iter_mut().zip(groups) {
                let high = vdupq_n_f32(*group.high.get_unchecked(k));
                let low = vdupq_n_f32(*group.low.get_unchecked(k));
                for q in 0..QUARTERS {
                    let extreme = vbslq_f32(vcltzq_f32(w[q]), low, high);
                    sum[q] = vfmaq_f32(sum[q], w[q], extreme);
                }
            }
        }
        let max = load(max.add(panel * PANEL));
        for (survivors, sum) in survivors.iter_mut().zip(sum) {
            let mut higher = 0;
            for q in 0..QUARTERS {
                // Not: less or equal, so that what is no number stays.
                let lower = vcleq_f32(sum[q], max[q]);
                higher |= u16::from(mask(vmvnq_u32(lower))) << (q * LANES);
            }
            survivors.add_of(panel, higher);
        }
    }
}

/// A bit for each lane that is set.
#[inline(always)]
unsafe fn mask(lanes: uint32x4_t) -> u8 {
    // SAFETY: NEON is part of the target.
    unsafe {
        let bits = vld1q_u32([1, 2, 4, 8].as_ptr());
        vaddvq_u32(vandq_u32(lanes, bits)) as u8
    }
}

/// Takes the points of a group into the maxima of some channels.
#[inline(always)]
unsafe fn raise(layer: &Dense<'_>, group: &Floats, channels: &[u16; TOGETHER], max: *mut f32) {
    // SAFETY: the caller guarantees the channels.
    unsafe {
        let mut sum = [[vdupq_n_f32(0.0); QUARTERS]; TOGETHER];
        let mut weights = [layer.panels().as_ptr(); TOGETHER];
        for (i, &channel) in channels.iter().enumerate() {
            let channel = usize::from(channel);
            sum[i] = [vdupq_n_f32(*layer.bias().get_unchecked(channel)); QUARTERS];
            weights[i] = weights[i].add(channel / PANEL * layer.inputs() * PANEL + channel % PANEL);
        }
        for k in 0..layer.inputs() {
            let points = load(group.points.get_unchecked(k).as_ptr());
            for (sum, weights) in sum.iter_mut().zip(weights) {
                let w = vld1q_dup_f32(weights.add(k * PANEL));
                for q in 0..QUARTERS {
                    sum[q] = vfmaq_f32(sum[q], w, points[q]);
                }
            }
        }
        for ([a, b, c, d], &channel) in sum.into_iter().zip(channels) {
            let most = vmaxvq_f32(vmaxq_f32(vmaxq_f32(a, b), vmaxq_f32(c, d)));
            let max = &mut *max.add(channel.into());
            *max = if most > *max { most } else { *max };
        }
    }
}
