//! The last embedding layer of integers over points that lie close together, with AVX2.
//! As in [`super::avx2_bytes_wide`], codes of points and weights are spread to 16 bits.
//! Lanes are channels for bounds, and points for sums. See [`crate::kernels::pruned`].
//!
//! Every function requires that AVX2 was detected, that the layer's arrays have their padded lengths and at most [`INPUTS`]
//! inputs, and that `max` is as long as its outputs; [`crate::kernels::Isa`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::avx2_bytes_wide::{PAIRS, Panel, pairs_of, spread};
use crate::dims::PANEL;
use crate::dims::QUAD;
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, PANELS, Survivors, prune};
use crate::layer::Codes;
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is spread and loaded once for all of them.
const GROUPS: usize = 4;
/// Values in one register.
const LANES: usize = 8;
/// Channels whose sums fit the registers.
const TOGETHER: usize = 4;

const _: () = assert!(INPUTS == 2 * PAIRS && CHANNELS.is_multiple_of(TOGETHER));

/// Codes of [`NEAR`] points, two inputs at a time.
#[derive(Clone, Copy)]
struct Group {
    /// The codes of each point.
    points: [[u32; NEAR]; PAIRS],
    /// The highest and the lowest code of each input.
    high: [u32; PAIRS],
    low: [u32; PAIRS],
}

impl Group {
    const ZERO: Group = Group {
        points: [[0; NEAR]; PAIRS],
        high: [0; PAIRS],
        low: [0; PAIRS],
    };

    /// Fills a group with rows; if there are too few, repeats the last one.
    #[target_feature(enable = "avx2")]
    fn fill(&mut self, inputs: usize, rows: &[u8]) {
        let last = rows.len() / inputs - 1;
        let (mut high, mut low) = ([0; INPUTS], [u8::MAX; INPUTS]);
        for lane in 0..NEAR {
            let row = &rows[lane.min(last) * inputs..][..inputs];
            for ((high, low), &code) in high.iter_mut().zip(&mut low).zip(row) {
                *high = code.max(*high);
                *low = code.min(*low);
            }
            let points = self.points.as_chunks_mut::<2>().0.iter_mut();
            for ([even, odd], &four) in points.zip(row.as_chunks::<QUAD>().0) {
                [even[lane], odd[lane]] = pairs_of(four);
            }
        }
        for (extreme, codes) in [(&mut self.high, high), (&mut self.low, low)] {
            let pairs = extreme.as_chunks_mut::<2>().0.iter_mut();
            for (pairs, &four) in pairs.zip(codes.as_chunks::<QUAD>().0) {
                *pairs = pairs_of(four);
            }
        }
    }
}

/// See [`crate::kernels::Isa::dense_codes_max_near`].
#[target_feature(enable = "avx2")]
pub(in crate::kernels) unsafe fn dense_codes_max(layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
    let inputs = layer.inputs();
    let mut groups = [Group::ZERO; GROUPS];
    let mut wide: [Panel; PANELS] = [[[0; 2 * PANEL]; PAIRS]; PANELS];
    let wide = wide.as_mut_ptr();
    let max = max.as_mut_ptr();
    let whole = x.len() - x.len() % inputs;
    for x in x[..whole].chunks(GROUPS * NEAR * inputs) {
        let mut count = 0;
        for (group, rows) in groups.iter_mut().zip(x.chunks(NEAR * inputs)) {
            group.fill(inputs, rows);
            count += 1;
        }
        prune::<1, GROUPS>(
            layer.outputs() / PANEL,
            count,
            // SAFETY: the caller guarantees the weights and maxima of each panel; nothing else refers to its place.
            |panel, survivors| unsafe {
                let wide = &mut *wide.add(panel % PANELS);
                let weights = &layer.panels()[panel * inputs * PANEL..][..inputs * PANEL];
                spread(weights, wide);
                bound(inputs / 2, panel, wide, &groups, max, survivors);
            },
            // SAFETY: groups and channels come from the bounds, and their panels are spread.
            |group, channels| unsafe {
                for channels in channels.as_chunks().0 {
                    raise(inputs / 2, wide, groups.get_unchecked(group), channels, max);
                }
            },
        );
    }
}

/// For each group, adds the channels of one panel whose bound is above the maximum.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn bound(
    pairs: usize,
    panel: usize,
    wide: &Panel,
    groups: &[Group; GROUPS],
    max: *const i32,
    survivors: &mut [Survivors; GROUPS],
) {
    // SAFETY: the caller guarantees the maxima of the panel.
    unsafe {
        let mut sum = [[_mm256_setzero_si256(); 2]; GROUPS];
        for k in 0..pairs {
            let mut w = [_mm256_setzero_si256(); 2];
            let mut negative = w;
            for half in 0..2 {
                let weights = wide.get_unchecked(k).as_ptr().add(half * 2 * LANES);
                w[half] = _mm256_loadu_si256(weights.cast());
                negative[half] = _mm256_srai_epi16::<15>(w[half]);
            }
            for (sum, group) in sum.iter_mut().zip(groups) {
                let high = _mm256_set1_epi32(*group.high.get_unchecked(k) as i32);
                let low = _mm256_set1_epi32(*group.low.get_unchecked(k) as i32);
                for half in 0..2 {
                    let extreme = _mm256_blendv_epi8(high, low, negative[half]);
                    let product = _mm256_madd_epi16(extreme, w[half]);
                    sum[half] = _mm256_add_epi32(sum[half], product);
                }
            }
        }
        for (survivors, sum) in survivors.iter_mut().zip(sum) {
            let mut higher = 0;
            for half in 0..2 {
                let max = max.add(panel * PANEL + half * LANES);
                let above = _mm256_cmpgt_epi32(sum[half], _mm256_loadu_si256(max.cast()));
                higher |= _mm256_movemask_ps(_mm256_castsi256_ps(above)) << (half * LANES);
            }
            survivors.add_of(panel, higher as u16);
        }
    }
}

/// Folds the points of a group into the maxima of some channels.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn raise(
    pairs: usize,
    wide: *const Panel,
    group: &Group,
    channels: &[u16; TOGETHER],
    max: *mut i32,
) {
    // SAFETY: the caller guarantees the channels, and that their panels are spread.
    unsafe {
        let mut sum = [[_mm256_setzero_si256(); 2]; TOGETHER];
        let mut weights = [wide.cast::<i32>(); TOGETHER];
        for (weights, &channel) in weights.iter_mut().zip(channels) {
            let (panel, lane) = (usize::from(channel) / PANEL, usize::from(channel) % PANEL);
            *weights = weights.add(panel % PANELS * PAIRS * PANEL + lane);
        }
        for k in 0..pairs {
            let points = group.points.get_unchecked(k).as_ptr();
            let points = [0, LANES].map(|from| points.add(from).cast());
            let points = [_mm256_loadu_si256(points[0]), _mm256_loadu_si256(points[1])];
            for (sum, weights) in sum.iter_mut().zip(weights) {
                let w = _mm256_set1_epi32(*weights.add(k * PANEL));
                for half in 0..2 {
                    let product = _mm256_madd_epi16(points[half], w);
                    sum[half] = _mm256_add_epi32(sum[half], product);
                }
            }
        }
        for (sum, &channel) in sum.into_iter().zip(channels) {
            let max = &mut *max.add(channel.into());
            let most = _mm256_max_epi32(sum[0], sum[1]);
            let above = _mm256_cmpgt_epi32(most, _mm256_set1_epi32(*max));
            if _mm256_movemask_epi8(above) != 0 {
                let mut lanes = [0i32; LANES];
                _mm256_storeu_si256(lanes.as_mut_ptr().cast(), most);
                *max = lanes.into_iter().fold(*max, i32::max);
            }
        }
    }
}
