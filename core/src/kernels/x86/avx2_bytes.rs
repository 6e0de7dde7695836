//! Bytes in 256-bit registers, sixteen sums in two of them: with AVX-VNNI, or with 16-bit products of AVX2.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use crate::kernels::byte::search::Scores;
use crate::kernels::byte::vector::Sums;
use crate::kernels::search::PLACE;
use core::arch::x86_64::*;

/// Values in one register.
const LANES: usize = 8;
/// Points in one block.
const POINTS: usize = 4;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Halves<const VNNI: bool>(pub(super) [__m256i; 2]);

// SAFETY (all): as `Sums` asks.
impl<const VNNI: bool> Sums for Halves<VNNI> {
    type Partial = Self;
    type Weights = [__m256i; 2];
    type Codes = __m256i;

    #[inline(always)]
    unsafe fn zero() -> Self {
        unsafe { Self::splat(0) }
    }

    #[inline(always)]
    unsafe fn load_weights(from: *const i8) -> [__m256i; 2] {
        unsafe {
            [
                _mm256_loadu_si256(from.cast()),
                _mm256_loadu_si256(from.add(4 * LANES).cast()),
            ]
        }
    }

    #[inline(always)]
    unsafe fn load_four<const EIGHT: bool>(from: *const u8) -> __m256i {
        unsafe { _mm256_set1_epi32(from.cast::<i32>().read_unaligned()) }
    }

    #[inline(always)]
    unsafe fn add_products<const WHICH: i32>(mut sum: Self, w: [__m256i; 2], x: __m256i) -> Self {
        for half in 0..2 {
            sum.0[half] = unsafe {
                if VNNI {
                    _mm256_dpbusd_avx_epi32(sum.0[half], x, w[half])
                } else {
                    // 16-bit products, because the byte products of AVX2 saturate.
                    let even_x = _mm256_and_si256(x, _mm256_set1_epi16(0xff));
                    let even_w = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(w[half]));
                    let odd_x = _mm256_srli_epi16::<8>(x);
                    let odd_w = _mm256_srai_epi16::<8>(w[half]);
                    let even = _mm256_madd_epi16(even_x, even_w);
                    let sum = _mm256_add_epi32(sum.0[half], even);
                    _mm256_add_epi32(sum, _mm256_madd_epi16(odd_x, odd_w))
                }
            };
        }
        sum
    }

    #[inline(always)]
    unsafe fn total(sum: Self) -> Self {
        sum
    }

    #[inline(always)]
    unsafe fn splat(value: i32) -> Self {
        Halves([unsafe { _mm256_set1_epi32(value) }; 2])
    }

    #[inline(always)]
    unsafe fn load(from: *const i32) -> Self {
        unsafe {
            Halves([
                _mm256_loadu_si256(from.cast()),
                _mm256_loadu_si256(from.add(LANES).cast()),
            ])
        }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut i32) {
        unsafe {
            _mm256_storeu_si256(to.cast(), self.0[0]);
            _mm256_storeu_si256(to.add(LANES).cast(), self.0[1]);
        }
    }

    #[inline(always)]
    unsafe fn add(mut self, other: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe { _mm256_add_epi32(self.0[half], other.0[half]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn max(mut self, other: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe { _mm256_max_epi32(self.0[half], other.0[half]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn shift_left<const BITS: i32>(mut self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe { _mm256_slli_epi32::<BITS>(self.0[half]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn store_codes(self, requantise: Self, to: *mut u8) {
        unsafe {
            let codes: [__m256i; 2] = core::array::from_fn(|half| {
                let factor = _mm256_and_si256(requantise.0[half], _mm256_set1_epi32(0xffff));
                let shift = _mm256_srli_epi32::<16>(requantise.0[half]);
                let one = _mm256_set1_epi32(1);
                let rounding = _mm256_srli_epi32::<1>(_mm256_sllv_epi32(one, shift));
                let product = _mm256_mullo_epi32(self.0[half], factor);
                _mm256_srav_epi32(_mm256_add_epi32(product, rounding), shift)
            });
            // Each packing saturates to its type; the first interleaves the registers' quarters.
            let words = _mm256_packs_epi32(codes[0], codes[1]);
            let words = _mm256_permute4x64_epi64::<0b11_01_10_00>(words);
            let (low, high) = (
                _mm256_castsi256_si128(words),
                _mm256_extracti128_si256::<1>(words),
            );
            _mm_storeu_si128(to.cast(), _mm_packus_epi16(low, high));
        }
    }
}

// SAFETY (all): as `Sums` asks.
impl<const VNNI: bool> Scores for Halves<VNNI> {
    #[inline(always)]
    unsafe fn raise_scores(self, scale: f32, place: usize, best: *mut f32) {
        unsafe {
            let kept = _mm256_castsi256_ps(_mm256_set1_epi32(!PLACE as i32));
            let place = _mm256_castsi256_ps(_mm256_set1_epi32(place as i32));
            let scale = _mm256_set1_ps(scale);
            for half in 0..2 {
                let best = best.add(half * LANES);
                let score = _mm256_mul_ps(_mm256_cvtepi32_ps(self.0[half]), scale);
                let score = _mm256_or_ps(_mm256_and_ps(score, kept), place);
                _mm256_storeu_ps(best, _mm256_max_ps(score, _mm256_loadu_ps(best)));
            }
        }
    }
}

pub(in crate::kernels) mod avx2 {
    use super::{Halves, POINTS};
    entries!("avx2", Halves<false>, 1 by POINTS, 1 of a vector);
}

pub(in crate::kernels) mod avx_vnni {
    use super::{Halves, POINTS};
    entries!("avx2,avxvnni", Halves<true>, 1 by POINTS, 1 of a vector);
}
