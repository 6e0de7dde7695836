//! The last embedding layer of integers over points that lie close together, with AVX2: two codes to a word, since codes of
//! points and weights are spread to 16 bits as in [`super::avx2_bytes_wide`].
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::avx2_bytes::Halves;
use super::avx2_bytes_wide::{PAIRS, Panel, pairs_of, spread};
use crate::dims::{PANEL, QUAD};
use crate::kernels::byte::pruned::{self, Bounds, Group};
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, PANELS};
use crate::layer::Codes;
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is spread and loaded once for all of them.
const GROUPS: usize = 4;
/// Values in one register.
const LANES: usize = 8;
/// Channels whose sums fit the registers.
const TOGETHER: usize = 4;

const _: () = assert!(INPUTS == 2 * PAIRS && CHANNELS.is_multiple_of(TOGETHER));

// SAFETY (all): as `Bounds` asks.
impl Bounds<PAIRS> for Halves<false> {
    type Spread = [Panel; PANELS];
    const NONE: Self::Spread = [[[0; 2 * PANEL]; PAIRS]; PANELS];

    #[inline(always)]
    unsafe fn fill(group: &mut Group<PAIRS>, inputs: usize, rows: &[u8]) {
        unsafe { fill(group, inputs, rows) }
    }

    #[inline(always)]
    unsafe fn spread(layer: &Codes<'_>, panel: usize, to: &mut Self::Spread) {
        let len = layer.inputs() * PANEL;
        let weights = &layer.panels()[panel * len..][..len];
        unsafe { spread(weights, &mut to[panel % PANELS]) }
    }

    #[inline(always)]
    unsafe fn weights(_: &Codes<'_>, panel: usize, spread: &Self::Spread) -> *const i32 {
        spread[panel % PANELS].as_ptr().cast()
    }

    #[inline(always)]
    unsafe fn add_words(mut self, codes: Self, weights: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe {
                let product = _mm256_madd_epi16(codes.0[half], weights.0[half]);
                _mm256_add_epi32(self.0[half], product)
            };
        }
        self
    }

    #[inline(always)]
    unsafe fn add_extremes(mut self, high: Self, low: Self, weights: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe {
                let negative = _mm256_srai_epi16::<15>(weights.0[half]);
                let extreme = _mm256_blendv_epi8(high.0[half], low.0[half], negative);
                let product = _mm256_madd_epi16(extreme, weights.0[half]);
                _mm256_add_epi32(self.0[half], product)
            };
        }
        self
    }

    #[inline(always)]
    unsafe fn exceeds(self, other: Self) -> u16 {
        let mut mask = 0;
        for half in 0..2 {
            unsafe {
                let above = _mm256_cmpgt_epi32(self.0[half], other.0[half]);
                mask |= _mm256_movemask_ps(_mm256_castsi256_ps(above)) << (half * LANES);
            }
        }
        mask as u16
    }

    #[inline(always)]
    unsafe fn raise(self, max: &mut i32) {
        unsafe {
            let most = _mm256_max_epi32(self.0[0], self.0[1]);
            let above = _mm256_cmpgt_epi32(most, _mm256_set1_epi32(*max));
            if _mm256_movemask_epi8(above) != 0 {
                let mut lanes = [0i32; LANES];
                _mm256_storeu_si256(lanes.as_mut_ptr().cast(), most);
                *max = lanes.into_iter().fold(*max, i32::max);
            }
        }
    }
}

/// See [`Bounds::fill`].
#[target_feature(enable = "avx2")]
#[inline]
fn fill(group: &mut Group<PAIRS>, inputs: usize, rows: &[u8]) {
    let last = rows.len() / inputs - 1;
    let (mut high, mut low) = ([0; INPUTS], [u8::MAX; INPUTS]);
    for lane in 0..NEAR {
        let row = &rows[lane.min(last) * inputs..][..inputs];
        for ((high, low), &code) in high.iter_mut().zip(&mut low).zip(row) {
            *high = code.max(*high);
            *low = code.min(*low);
        }
        let points = group.points.as_chunks_mut::<2>().0.iter_mut();
        for ([even, odd], &four) in points.zip(row.as_chunks::<QUAD>().0) {
            [even[lane], odd[lane]] = pairs_of(four);
        }
    }
    for (extreme, codes) in [(&mut group.high, high), (&mut group.low, low)] {
        let pairs = extreme.as_chunks_mut::<2>().0.iter_mut();
        for (pairs, &four) in pairs.zip(codes.as_chunks::<QUAD>().0) {
            *pairs = pairs_of(four);
        }
    }
}

/// See [`crate::kernels::Isa::dense_codes_max_near`].
#[target_feature(enable = "avx2")]
pub(in crate::kernels) unsafe fn dense_codes_max(layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
    // SAFETY: as the caller guarantees.
    unsafe { pruned::max::<Halves<false>, PAIRS, GROUPS, TOGETHER>(layer, x, max) }
}
