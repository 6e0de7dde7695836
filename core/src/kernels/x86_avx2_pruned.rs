//! The last embedding layer over points that lie close together, with AVX2 and FMA, in f32: lanes are channels where
//! bounds are computed, and points where sums are. See [`super::pruned`].
//!
//! Every function must only be called where AVX2 and FMA were detected, with a layer whose arrays have their padded
//! lengths and at most [`super::pruned::INPUTS`] inputs, and `max` as long as its bias; [`super::Isa`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::pruned::{CHANNELS, Floats, NEAR, Survivors, prune};
use crate::dims::{PANEL, TILE};
use crate::layer::Dense;
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is loaded once for all.
const GROUPS: usize = TILE / NEAR;
/// Values of one register.
const LANES: usize = 8;
/// Channels whose sums have room in the registers.
const TOGETHER: usize = 4;

/// See [`super::Isa::dense_max_near`]; `points` rows.
#[target_feature(enable = "avx2,fma")]
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
#[target_feature(enable = "avx2,fma")]
#[inline]
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
        let bias = layer.bias().as_ptr().add(panel * PANEL);
        let start = [_mm256_loadu_ps(bias), _mm256_loadu_ps(bias.add(LANES))];
        let mut sum = [start; GROUPS];
        for k in 0..layer.inputs() {
            let w = weights.add(k * PANEL);
            let w = [_mm256_loadu_ps(w), _mm256_loadu_ps(w.add(LANES))];
            for (sum, group) in sum.iter_mut().zip(groups) {
                let high = _mm256_set1_ps(*group.high.get_unchecked(k));
                let low = _mm256_set1_ps(*group.low.get_unchecked(k));
                for half in 0..2 {
                    let extreme = _mm256_blendv_ps(high, low, w[half]);
                    sum[half] = _mm256_fmadd_ps(w[half], extreme, sum[half]);
                }
            }
        }
        for (survivors, sum) in survivors.iter_mut().zip(sum) {
            let mut higher = 0;
            for half in 0..2 {
                let max = _mm256_loadu_ps(max.add(panel * PANEL + half * LANES));
                let above = _mm256_cmp_ps::<_CMP_NLE_UQ>(sum[half], max);
                higher |= _mm256_movemask_ps(above) << (half * LANES);
            }
            survivors.add_of(panel, higher as u16);
        }
    }
}

/// Takes the points of a group into the maxima of some channels.
#[target_feature(enable = "avx2,fma")]
#[inline]
unsafe fn raise(layer: &Dense<'_>, group: &Floats, channels: &[u16; TOGETHER], max: *mut f32) {
    // SAFETY: the caller guarantees the channels.
    unsafe {
        let mut sum = [[_mm256_setzero_ps(); 2]; TOGETHER];
        let mut weights = [layer.panels().as_ptr(); TOGETHER];
        for (i, &channel) in channels.iter().enumerate() {
            let channel = usize::from(channel);
            sum[i] = [_mm256_set1_ps(*layer.bias().get_unchecked(channel)); 2];
            weights[i] = weights[i].add(channel / PANEL * layer.inputs() * PANEL + channel % PANEL);
        }
        for k in 0..layer.inputs() {
            let points = group.points.get_unchecked(k).as_ptr();
            let points = [_mm256_loadu_ps(points), _mm256_loadu_ps(points.add(LANES))];
            for (sum, weights) in sum.iter_mut().zip(weights) {
                let w = _mm256_set1_ps(*weights.add(k * PANEL));
                for half in 0..2 {
                    sum[half] = _mm256_fmadd_ps(w, points[half], sum[half]);
                }
            }
        }
        for (sum, &channel) in sum.into_iter().zip(channels) {
            let max = &mut *max.add(channel.into());
            let most = _mm256_max_ps(sum[0], sum[1]);
            let above = _mm256_cmp_ps::<_CMP_GT_OQ>(most, _mm256_set1_ps(*max));
            if _mm256_movemask_ps(above) != 0 {
                let mut lanes = [0.0f32; LANES];
                _mm256_storeu_ps(lanes.as_mut_ptr(), most);
                *max = lanes
                    .into_iter()
                    .fold(*max, |max, sum| if sum > max { sum } else { max });
            }
        }
    }
}

const _: () = assert!(CHANNELS.is_multiple_of(TOGETHER));
