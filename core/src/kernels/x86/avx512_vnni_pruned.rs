//! The last embedding layer of integers over points that lie close together, with AVX-512 VNNI. Lanes are channels for bounds,
//! and points for sums. See [`crate::kernels::pruned`].
//!
//! Every function requires that its instruction sets were detected, that the layer's arrays have their padded lengths and at
//! most [`INPUTS`] inputs, and that `max` is as long as its outputs; [`crate::kernels::Isa`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::avx512::channels_of;
use crate::dims::{PANEL, QUAD};
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, prune};
use crate::layer::Codes;
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is loaded once for all of them.
const GROUPS: usize = 12;

/// Codes of [`NEAR`] points, four inputs at a time.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Group {
    /// The codes of each point.
    points: [[u32; NEAR]; INPUTS / QUAD],
    /// The highest and the lowest code of each input.
    high: [u32; INPUTS / QUAD],
    low: [u32; INPUTS / QUAD],
}

impl Group {
    pub(in crate::kernels) const ZERO: Group = Group {
        points: [[0; NEAR]; INPUTS / QUAD],
        high: [0; INPUTS / QUAD],
        low: [0; INPUTS / QUAD],
    };

    /// Fills a group with rows; if there are too few, repeats the last one.
    #[target_feature(enable = "avx512f,avx512bw")]
    pub(in crate::kernels) unsafe fn fill(&mut self, inputs: usize, rows: &[u8]) {
        let last = rows.len() / inputs - 1;
        // SAFETY: rows of `inputs` bytes, a multiple of 64 up to `INPUTS`.
        unsafe {
            for part in 0..inputs / 64 {
                let row = |lane: usize| {
                    let row = rows.as_ptr().add(lane.min(last) * inputs + part * 64);
                    _mm512_loadu_si512(row.cast())
                };
                let rows: [__m512i; NEAR] = core::array::from_fn(row);
                let (mut high, mut low) = (rows[0], rows[0]);
                for &row in &rows[1..] {
                    high = _mm512_max_epu8(high, row);
                    low = _mm512_min_epu8(low, row);
                }
                _mm512_storeu_si512(self.high.as_mut_ptr().add(part * 16).cast(), high);
                _mm512_storeu_si512(self.low.as_mut_ptr().add(part * 16).cast(), low);
                for (quad, points) in transposed(rows).into_iter().enumerate() {
                    let to = self.points.as_mut_ptr().add(part * 16 + quad);
                    _mm512_storeu_si512(to.cast(), points);
                }
            }
        }
    }
}

/// Transposes a 16 x 16 matrix of 32-bit values.
#[target_feature(enable = "avx512f")]
#[inline]
fn transposed(rows: [__m512i; 16]) -> [__m512i; 16] {
    let mut pairs = rows;
    for i in 0..8 {
        pairs[2 * i] = _mm512_unpacklo_epi32(rows[2 * i], rows[2 * i + 1]);
        pairs[2 * i + 1] = _mm512_unpackhi_epi32(rows[2 * i], rows[2 * i + 1]);
    }
    // Four rows at a time: columns 0, 1, 2, 3 of each 128-bit part.
    let mut fours = pairs;
    for i in 0..4 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|j| pairs[4 * i + j]);
        fours[4 * i] = _mm512_unpacklo_epi64(a, c);
        fours[4 * i + 1] = _mm512_unpackhi_epi64(a, c);
        fours[4 * i + 2] = _mm512_unpacklo_epi64(b, d);
        fours[4 * i + 3] = _mm512_unpackhi_epi64(b, d);
    }
    let mut columns = fours;
    for column in 0..4 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| fours[4 * i + column]);
        let (ab_even, ab_odd) = (
            _mm512_shuffle_i32x4::<0b10_00_10_00>(a, b),
            _mm512_shuffle_i32x4::<0b11_01_11_01>(a, b),
        );
        let (cd_even, cd_odd) = (
            _mm512_shuffle_i32x4::<0b10_00_10_00>(c, d),
            _mm512_shuffle_i32x4::<0b11_01_11_01>(c, d),
        );
        columns[column] = _mm512_shuffle_i32x4::<0b10_00_10_00>(ab_even, cd_even);
        columns[4 + column] = _mm512_shuffle_i32x4::<0b10_00_10_00>(ab_odd, cd_odd);
        columns[8 + column] = _mm512_shuffle_i32x4::<0b11_01_11_01>(ab_even, cd_even);
        columns[12 + column] = _mm512_shuffle_i32x4::<0b11_01_11_01>(ab_odd, cd_odd);
    }
    columns
}

/// See [`crate::kernels::Isa::dense_codes_max_near`].
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
pub(in crate::kernels) unsafe fn dense_codes_max(layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
    let mut groups = [Group::ZERO; GROUPS];
    let whole = x.len() - x.len() % layer.inputs();
    for x in x[..whole].chunks(GROUPS * NEAR * layer.inputs()) {
        let mut count = 0;
        for (group, rows) in groups.iter_mut().zip(x.chunks(NEAR * layer.inputs())) {
            // SAFETY: the caller guarantees the width of rows.
            unsafe { group.fill(layer.inputs(), rows) };
            count += 1;
        }
        // SAFETY: as the caller guarantees.
        unsafe {
            match count {
                1 => dense_groups::<1>(layer, &groups, count, max),
                2..=4 => dense_groups::<4>(layer, &groups, count, max),
                _ => dense_groups::<GROUPS>(layer, &groups, count, max),
            }
        }
    }
}

/// Folds the first `count` groups, at most `N`, into all maxima.
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
unsafe fn dense_groups<const N: usize>(
    layer: &Codes<'_>,
    groups: &[Group; GROUPS],
    count: usize,
    max: &mut [i32],
) {
    let max = max.as_mut_ptr();
    prune::<1, N>(
        layer.outputs() / PANEL,
        count,
        // SAFETY: the caller guarantees the maxima of each panel.
        |panel, survivors| unsafe {
            let bounds = bounds::<N>(layer, panel, groups);
            let max = _mm512_loadu_si512(max.add(panel * PANEL).cast());
            for (survivors, bound) in survivors.iter_mut().zip(bounds) {
                let higher = _mm512_cmpgt_epi32_mask(bound, max);
                channels_of(panel, higher, survivors);
            }
        },
        // SAFETY: groups and channels come from the bounds.
        |group, channels| unsafe {
            let sums = sums(layer, groups.get_unchecked(group), channels);
            for (sum, &channel) in sums.into_iter().zip(channels) {
                let max = &mut *max.add(channel.into());
                if _mm512_cmpgt_epi32_mask(sum, _mm512_set1_epi32(*max)) != 0 {
                    *max = _mm512_reduce_max_epi32(sum);
                }
            }
        },
    );
}

/// Upper bounds on the sums of one panel, for the points of each group.
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
#[inline]
pub(in crate::kernels) unsafe fn bounds<const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    groups: &[Group],
) -> [__m512i; N] {
    let mut sum = [_mm512_setzero_si512(); N];
    // SAFETY: the caller guarantees the panel; no more groups are asked for than there are.
    unsafe {
        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
        for k in 0..layer.inputs() / QUAD {
            let w = _mm512_loadu_si512(weights.add(k * PANEL * QUAD).cast());
            let negative = _mm512_movepi8_mask(w);
            for n in 0..N {
                let group = groups.get_unchecked(n);
                let high = _mm512_set1_epi32(*group.high.get_unchecked(k) as i32);
                let low = _mm512_set1_epi32(*group.low.get_unchecked(k) as i32);
                let extreme = _mm512_mask_blend_epi8(negative, high, low);
                sum[n] = _mm512_dpbusd_epi32(sum[n], extreme, w);
            }
        }
    }
    sum
}

/// Sums of some channels, one lane for each point of a group.
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
#[inline]
pub(in crate::kernels) unsafe fn sums(
    layer: &Codes<'_>,
    group: &Group,
    channels: &[u16; CHANNELS],
) -> [__m512i; CHANNELS] {
    let mut sum = [_mm512_setzero_si512(); CHANNELS];
    // SAFETY: the caller guarantees the channels.
    unsafe {
        let mut weights = [layer.panels().as_ptr(); CHANNELS];
        for (weights, &channel) in weights.iter_mut().zip(channels) {
            let channel = usize::from(channel);
            *weights =
                weights.add(channel / PANEL * layer.inputs() * PANEL + channel % PANEL * QUAD);
        }
        for k in 0..layer.inputs() / QUAD {
            let points = _mm512_loadu_si512(group.points.get_unchecked(k).as_ptr().cast());
            for (sum, weights) in sum.iter_mut().zip(weights) {
                let quad = weights.add(k * PANEL * QUAD).cast::<i32>();
                let w = _mm512_set1_epi32(quad.read_unaligned());
                *sum = _mm512_dpbusd_epi32(*sum, points, w);
            }
        }
    }
    sum
}
