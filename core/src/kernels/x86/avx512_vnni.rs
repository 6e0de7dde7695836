//! Bytes with AVX-512 VNNI: sixteen sums in one register.
#![allow(unsafe_code)]

use crate::kernels::byte::search::Scores;
use crate::kernels::byte::vector::Sums;
use crate::kernels::search::{GROUPS, PLACE};
use core::arch::x86_64::*;

/// Points in one block; a multiple of the groups.
const POINTS: usize = 12;

const _: () = assert!(POINTS.is_multiple_of(GROUPS));

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Whole(pub(in crate::kernels) __m512i);

// SAFETY (all): as `Sums` asks.
impl Sums for Whole {
    type Partial = Self;
    type Weights = __m512i;
    type Codes = __m512i;

    #[inline(always)]
    unsafe fn zero() -> Self {
        unsafe { Self::splat(0) }
    }

    #[inline(always)]
    unsafe fn load_weights(from: *const i8) -> __m512i {
        unsafe { _mm512_loadu_si512(from.cast()) }
    }

    #[inline(always)]
    unsafe fn load_four<const EIGHT: bool>(from: *const u8) -> __m512i {
        unsafe { _mm512_set1_epi32(from.cast::<i32>().read_unaligned()) }
    }

    #[inline(always)]
    unsafe fn add_products<const WHICH: i32>(sum: Self, w: __m512i, x: __m512i) -> Self {
        Whole(unsafe { _mm512_dpbusd_epi32(sum.0, x, w) })
    }

    #[inline(always)]
    unsafe fn total(sum: Self) -> Self {
        sum
    }

    #[inline(always)]
    unsafe fn splat(value: i32) -> Self {
        Whole(unsafe { _mm512_set1_epi32(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const i32) -> Self {
        Whole(unsafe { _mm512_loadu_si512(from.cast()) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut i32) {
        unsafe { _mm512_storeu_si512(to.cast(), self.0) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        Whole(unsafe { _mm512_add_epi32(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        Whole(unsafe { _mm512_max_epi32(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn shift_left<const BITS: i32>(self) -> Self {
        Whole(unsafe { _mm512_sllv_epi32(self.0, _mm512_set1_epi32(BITS)) })
    }

    #[inline(always)]
    unsafe fn store_codes(self, Whole(requantise): Self, to: *mut u8) {
        unsafe {
            let factor = _mm512_and_si512(requantise, _mm512_set1_epi32(0xffff));
            let shift = _mm512_srli_epi32::<16>(requantise);
            let one = _mm512_set1_epi32(1);
            let half = _mm512_srli_epi32::<1>(_mm512_sllv_epi32(one, shift));
            let product = _mm512_mullo_epi32(self.0, factor);
            let code = _mm512_srav_epi32(_mm512_add_epi32(product, half), shift);
            let code = _mm512_max_epi32(code, _mm512_setzero_si512());
            _mm_storeu_si128(to.cast(), _mm512_cvtusepi32_epi8(code));
        }
    }
}

// SAFETY (all): as `Sums` asks.
impl Scores for Whole {
    #[inline(always)]
    unsafe fn raise_scores(self, scale: f32, place: usize, best: *mut f32) {
        unsafe {
            let score = score(self.0, scale, _mm512_set1_epi32(place as i32));
            _mm512_storeu_ps(best, _mm512_max_ps(score, _mm512_loadu_ps(best)));
        }
    }
}

/// Score of the point at `place` in its tile; the last bits hold the place.
#[target_feature(enable = "avx512f")]
#[inline]
pub(in crate::kernels) fn score(sum: __m512i, scale: f32, place: __m512i) -> __m512 {
    let score = _mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_set1_ps(scale));
    /// `a & !b | c`, bit by bit.
    const REPLACE: i32 = 0b1011_1010;
    let kept = _mm512_set1_epi32(PLACE as i32);
    _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<REPLACE>(
        _mm512_castps_si512(score),
        kept,
        place,
    ))
}

entries!("avx512f,avx512vnni", Whole, 2 by POINTS, 8 of a vector);
