//! The last embedding layer in f32 over points that lie close together, with AVX-512F: lanes are channels where bounds
//! are computed, and points where sums are. See [`super::pruned`].
//!
//! Every function must only be called where AVX-512F was detected, with a layer whose arrays have their padded lengths
//! and at most [`super::pruned::INPUTS`] inputs, and `max` as long as its bias; [`super::Isa`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::pruned::{CHANNELS, Floats, NEAR, channels_of, prune};
use crate::dims::{PANEL, TILE};
use crate::layer::Dense;
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is loaded once for all.
const GROUPS: usize = TILE / NEAR;
/// Panels whose bounds are computed together.
const TOGETHER: usize = 2;

/// See [`super::Isa::dense_max_near`]; `points` rows.
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn dense_max(layer: &Dense<'_>, points: usize, x: &[f32], max: &mut [f32]) {
    let mut groups = [Floats::ZERO; GROUPS];
    for x in x[..points * layer.inputs()].chunks(GROUPS * NEAR * layer.inputs()) {
        let count = Floats::fill_all(&mut groups, layer.inputs(), x);
        // SAFETY: as the caller guarantees.
        unsafe {
            match count {
                1 => dense_groups::<1>(layer, &groups, count, max),
                _ => dense_groups::<GROUPS>(layer, &groups, count, max),
            }
        }
    }
}

/// Takes the first `count` groups, at most `N`, into all maxima.
#[target_feature(enable = "avx512f")]
unsafe fn dense_groups<const N: usize>(
    layer: &Dense<'_>,
    groups: &[Floats; GROUPS],
    count: usize,
    max: &mut [f32],
) {
    let max = max.as_mut_ptr();
    prune::<TOGETHER, N>(
        layer.width() / PANEL,
        count,
        // SAFETY: the caller guarantees the maxima of each panel.
        |panel, survivors| unsafe {
            let two = panel + 1 < layer.width() / PANEL;
            let bounds = bounds::<N>(layer, [panel, panel + usize::from(two)], groups);
            for p in 0..1 + usize::from(two) {
                let max = _mm512_loadu_ps(max.add((panel + p) * PANEL));
                for (survivors, bound) in survivors.iter_mut().zip(bounds) {
                    let higher = _mm512_cmp_ps_mask::<_CMP_NLE_UQ>(bound[p], max);
                    channels_of(panel + p, higher, survivors);
                }
            }
        },
        // SAFETY: groups and channels are those of bounds.
        |group, channels| unsafe { raise(layer, groups.get_unchecked(group), channels, max) },
    );
}

/// What no sum of some panels exceeds, for the points of each group.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn bounds<const N: usize>(
    layer: &Dense<'_>,
    panels: [usize; TOGETHER],
    groups: &[Floats; GROUPS],
) -> [[__m512; TOGETHER]; N] {
    // SAFETY: the caller guarantees the panels; no more groups are asked for than there are.
    unsafe {
        let mut start = [_mm512_setzero_ps(); TOGETHER];
        let mut weights = [layer.panels().as_ptr(); TOGETHER];
        for p in 0..TOGETHER {
            start[p] = _mm512_loadu_ps(layer.bias().as_ptr().add(panels[p] * PANEL));
            weights[p] = weights[p].add(panels[p] * layer.inputs() * PANEL);
        }
        let mut sum = [start; N];
        for k in 0..layer.inputs() {
            let mut w = [_mm512_setzero_ps(); TOGETHER];
            let mut negative = [0; TOGETHER];
            for p in 0..TOGETHER {
                w[p] = _mm512_loadu_ps(weights[p].add(k * PANEL));
                negative[p] = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(w[p], _mm512_setzero_ps());
            }
            for n in 0..N {
                let group = groups.get_unchecked(n);
                let high = _mm512_set1_ps(*group.high.get_unchecked(k));
                let low = _mm512_set1_ps(*group.low.get_unchecked(k));
                for p in 0..TOGETHER {
                    let extreme = _mm512_mask_blend_ps(negative[p], high, low);
                    sum[n][p] = _mm512_fmadd_ps(w[p], extreme, sum[n][p]);
                }
            }
        }
        sum
    }
}

/// Takes the points of a group into the maxima of some channels.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn raise(layer: &Dense<'_>, group: &Floats, channels: &[u16; CHANNELS], max: *mut f32) {
    // SAFETY: the caller guarantees the channels.
    unsafe {
        let sums = sums(layer, group, channels);
        for (sum, &channel) in sums.into_iter().zip(channels) {
            let max = &mut *max.add(channel.into());
            if _mm512_cmp_ps_mask::<_CMP_GT_OQ>(sum, _mm512_set1_ps(*max)) != 0 {
                *max = _mm512_reduce_max_ps(sum);
            }
        }
    }
}

/// Sums of some channels, a lane for each point of a group.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn sums(
    layer: &Dense<'_>,
    group: &Floats,
    channels: &[u16; CHANNELS],
) -> [__m512; CHANNELS] {
    // SAFETY: the caller guarantees the channels.
    unsafe {
        let mut sum = [_mm512_setzero_ps(); CHANNELS];
        let mut weights = [layer.panels().as_ptr(); CHANNELS];
        for (i, &channel) in channels.iter().enumerate() {
            let channel = usize::from(channel);
            sum[i] = _mm512_set1_ps(*layer.bias().get_unchecked(channel));
            let column = channel / PANEL * layer.inputs() * PANEL + channel % PANEL;
            weights[i] = weights[i].add(column);
        }
        for k in 0..layer.inputs() {
            let points = _mm512_loadu_ps(group.points.get_unchecked(k).as_ptr());
            for (sum, weights) in sum.iter_mut().zip(weights) {
                let w = _mm512_set1_ps(*weights.add(k * PANEL));
                *sum = _mm512_fmadd_ps(w, points, *sum);
            }
        }
        sum
    }
}
