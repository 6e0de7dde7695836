//! Lanes in registers of AVX2 and AVX-512F.
#![allow(unsafe_code)]

use crate::dims::SURFACE_POINTS;
use crate::kernels::lanes::{LANES, Lanes, Places, Row, Vectors};
use core::arch::x86_64::*;
use core::ops::{Add, Div, Mul, Sub};

/// Eight lanes in a register of AVX2.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Eight(__m256);

/// Sixteen lanes in a register of AVX-512F.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Sixteen(__m512);

/// Implements the operators of lanes by instructions.
macro_rules! operators {
    ($lanes:ident: $($operator:ident, $name:ident: $instruction:ident;)*) => {
        $(impl $operator for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                // SAFETY: as `Lanes` asks.
                $lanes(unsafe { $instruction(self.0, other.0) })
            }
        })*
    };
}

operators! { Eight:
    Add, add: _mm256_add_ps;
    Sub, sub: _mm256_sub_ps;
    Mul, mul: _mm256_mul_ps;
    Div, div: _mm256_div_ps;
}

operators! { Sixteen:
    Add, add: _mm512_add_ps;
    Sub, sub: _mm512_sub_ps;
    Mul, mul: _mm512_mul_ps;
    Div, div: _mm512_div_ps;
}

/// Pointer to `N` lanes of a row from `first` on.
#[inline(always)]
fn some<T, const N: usize>(row: &[T; LANES], first: usize) -> *const T {
    row[first..first + N].as_ptr()
}

/// The same, to write to.
#[inline(always)]
fn some_mut<T, const N: usize>(row: &mut [T; LANES], first: usize) -> *mut T {
    row[first..first + N].as_mut_ptr()
}

/// The vector at a place, followed by one more number.
///
/// # Safety
/// As [`Lanes`] asks.
#[inline(always)]
unsafe fn four(from: &Places, place: u16) -> __m128 {
    let place = usize::from(place) % SURFACE_POINTS;
    unsafe { _mm_loadu_ps(from.as_ptr().add(place).cast()) }
}

/// The vectors of a lane and of the fourth lane after it.
///
/// # Safety
/// As [`Lanes`] asks.
#[inline(always)]
unsafe fn two(from: &Places, places: &[u16; LANES], lane: usize) -> __m256 {
    unsafe {
        let low = _mm256_castps128_ps256(four(from, places[lane]));
        _mm256_insertf128_ps::<1>(low, four(from, places[lane + 4]))
    }
}

/// The vectors of a lane and of each fourth lane after it.
///
/// # Safety
/// As [`Lanes`] asks.
#[inline(always)]
unsafe fn every_fourth(from: &Places, places: &[u16; LANES], lane: usize) -> __m512 {
    unsafe {
        let low = _mm512_castps256_ps512(two(from, places, lane));
        let low = _mm512_insertf32x4::<2>(low, four(from, places[lane + 8]));
        _mm512_insertf32x4::<3>(low, four(from, places[lane + 12]))
    }
}

// SAFETY (all): as `Lanes` asks; what is loaded or stored lies within a row, or is followed by one more vector.
impl Lanes for Eight {
    const COUNT: usize = 8;
    type Counts = __m256i;

    #[inline(always)]
    fn all(x: f32) -> Self {
        Eight(unsafe { _mm256_set1_ps(x) })
    }

    #[inline(always)]
    fn load(row: &Row, first: usize) -> Self {
        Eight(unsafe { _mm256_loadu_ps(some::<_, 8>(row, first)) })
    }

    #[inline(always)]
    fn store(self, row: &mut Row, first: usize) {
        unsafe { _mm256_storeu_ps(some_mut::<_, 8>(row, first), self.0) }
    }

    #[inline(always)]
    fn load_counts(row: &[u32; LANES], first: usize) -> __m256i {
        unsafe { _mm256_loadu_si256(some::<_, 8>(row, first).cast()) }
    }

    #[inline(always)]
    fn store_counts(counts: __m256i, row: &mut [u32; LANES], first: usize) {
        unsafe { _mm256_storeu_si256(some_mut::<_, 8>(row, first).cast(), counts) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Eight(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Eight(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Eight(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn with_sign_flipped_by(self, by: Self) -> Self {
        unsafe {
            let negative = _mm256_cmp_ps::<_CMP_LT_OQ>(by.0, _mm256_setzero_ps());
            let sign = _mm256_and_ps(negative, _mm256_set1_ps(-0.0));
            Eight(_mm256_xor_ps(self.0, sign))
        }
    }

    #[inline(always)]
    fn largest(self) -> f32 {
        unsafe {
            let (low, high) = (
                _mm256_castps256_ps128(self.0),
                _mm256_extractf128_ps::<1>(self.0),
            );
            let four = _mm_max_ps(low, high);
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
    }

    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) as u32 }
    }

    #[inline(always)]
    fn keep_less(self, counts: __m256i, other: Self, count: u32) -> (Self, __m256i) {
        unsafe {
            let less = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(other.0, self.0));
            let count = _mm256_set1_epi32(count as i32);
            (other.min(self), _mm256_blendv_epi8(counts, count, less))
        }
    }

    #[inline(always)]
    fn bits_beyond(self, some: u32) -> __m256i {
        unsafe { _mm256_sub_epi32(_mm256_castps_si256(self.0), _mm256_set1_epi32(some as i32)) }
    }

    #[inline(always)]
    fn times_and(counts: __m256i, by: u32, other: __m256i) -> __m256i {
        unsafe {
            let product = _mm256_mullo_epi32(counts, _mm256_set1_epi32(by as i32));
            _mm256_add_epi32(product, other)
        }
    }

    #[inline(always)]
    fn gather(from: &Places, places: &[u16; LANES], first: usize) -> Vectors<Self> {
        unsafe {
            let (a, b) = (two(from, places, first), two(from, places, first + 1));
            let (c, d) = (two(from, places, first + 2), two(from, places, first + 3));
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ab_z, cd_z) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            Vectors {
                x: Eight(_mm256_shuffle_ps::<0b01_00_01_00>(ab, cd)),
                y: Eight(_mm256_shuffle_ps::<0b11_10_11_10>(ab, cd)),
                z: Eight(_mm256_shuffle_ps::<0b01_00_01_00>(ab_z, cd_z)),
            }
        }
    }
}

// SAFETY (all): as above.
impl Lanes for Sixteen {
    const COUNT: usize = 16;
    type Counts = __m512i;

    #[inline(always)]
    fn all(x: f32) -> Self {
        Sixteen(unsafe { _mm512_set1_ps(x) })
    }

    #[inline(always)]
    fn load(row: &Row, first: usize) -> Self {
        Sixteen(unsafe { _mm512_loadu_ps(some::<_, 16>(row, first)) })
    }

    #[inline(always)]
    fn store(self, row: &mut Row, first: usize) {
        unsafe { _mm512_storeu_ps(some_mut::<_, 16>(row, first), self.0) }
    }

    #[inline(always)]
    fn load_counts(row: &[u32; LANES], first: usize) -> __m512i {
        unsafe { _mm512_loadu_si512(some::<_, 16>(row, first).cast()) }
    }

    #[inline(always)]
    fn store_counts(counts: __m512i, row: &mut [u32; LANES], first: usize) {
        unsafe { _mm512_storeu_si512(some_mut::<_, 16>(row, first).cast(), counts) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Sixteen(unsafe { _mm512_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Sixteen(unsafe { _mm512_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Sixteen(unsafe { _mm512_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn with_sign_flipped_by(self, by: Self) -> Self {
        unsafe {
            let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(by.0, _mm512_setzero_ps());
            let bits = _mm512_castps_si512(self.0);
            let opposite = _mm512_mask_xor_epi32(bits, negative, bits, _mm512_set1_epi32(i32::MIN));
            Sixteen(_mm512_castsi512_ps(opposite))
        }
    }

    #[inline(always)]
    fn largest(self) -> f32 {
        unsafe { _mm512_reduce_max_ps(self.0) }
    }

    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0).into() }
    }

    #[inline(always)]
    fn keep_less(self, counts: __m512i, other: Self, count: u32) -> (Self, __m512i) {
        unsafe {
            let less = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(other.0, self.0);
            let count = _mm512_set1_epi32(count as i32);
            (other.min(self), _mm512_mask_mov_epi32(counts, less, count))
        }
    }

    #[inline(always)]
    fn bits_beyond(self, some: u32) -> __m512i {
        unsafe { _mm512_sub_epi32(_mm512_castps_si512(self.0), _mm512_set1_epi32(some as i32)) }
    }

    #[inline(always)]
    fn times_and(counts: __m512i, by: u32, other: __m512i) -> __m512i {
        unsafe {
            let product = _mm512_mullo_epi32(counts, _mm512_set1_epi32(by as i32));
            _mm512_add_epi32(product, other)
        }
    }

    #[inline(always)]
    fn gather(from: &Places, places: &[u16; LANES], first: usize) -> Vectors<Self> {
        unsafe {
            let (a, b) = (
                every_fourth(from, places, first),
                every_fourth(from, places, first + 1),
            );
            let (c, d) = (
                every_fourth(from, places, first + 2),
                every_fourth(from, places, first + 3),
            );
            let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
            let (ab_z, cd_z) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
            Vectors {
                x: Sixteen(_mm512_shuffle_ps::<0b01_00_01_00>(ab, cd)),
                y: Sixteen(_mm512_shuffle_ps::<0b11_10_11_10>(ab, cd)),
                z: Sixteen(_mm512_shuffle_ps::<0b01_00_01_00>(ab_z, cd_z)),
            }
        }
    }
}
