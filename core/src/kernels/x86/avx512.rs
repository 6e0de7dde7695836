//! AVX-512F: sixteen values in one register.
#![allow(unsafe_code)]

use crate::dims::PANEL;
use crate::kernels::float::vector::Vector;
use crate::kernels::float::{dense, pruned};
use crate::kernels::pruned::Survivors;
use crate::layer::Dense;
use core::arch::x86_64::*;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Whole(__m512);

// SAFETY (all): as `Vector` asks.
impl Vector for Whole {
    type Rows = __m512i;
    type Inputs = Whole;
    const INPUTS: usize = 1;

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Whole(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        Whole(unsafe { _mm512_loadu_ps(from) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { _mm512_storeu_ps(to, self.0) }
    }

    #[inline(always)]
    unsafe fn load_rows(from: *const u32) -> __m512i {
        unsafe { _mm512_loadu_si512(from.cast()) }
    }

    #[inline(always)]
    unsafe fn store_rows(rows: __m512i, to: *mut u32) {
        unsafe { _mm512_storeu_si512(to.cast(), rows) }
    }

    #[inline(always)]
    unsafe fn add_product(self, a: Self, b: Self) -> Self {
        Whole(unsafe { _mm512_fmadd_ps(a.0, b.0, self.0) })
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        Whole(unsafe { _mm512_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    unsafe fn keep_higher(self, rows: __m512i, sum: Self, row: u32) -> (Self, __m512i) {
        unsafe {
            let higher = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(sum.0, self.0);
            let here = _mm512_set1_epi32(row as i32);
            (
                Whole(_mm512_mask_mov_ps(self.0, higher, sum.0)),
                _mm512_mask_mov_epi32(rows, higher, here),
            )
        }
    }

    #[inline(always)]
    unsafe fn load_inputs(from: *const f32) -> Self {
        unsafe { Self::splat(*from) }
    }

    #[inline(always)]
    unsafe fn add_input<const WHICH: i32>(self, w: Self, x: Self) -> Self {
        unsafe { self.add_product(w, x) }
    }

    #[inline(always)]
    unsafe fn extreme(self, high: Self, low: Self) -> Self {
        unsafe {
            let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, _mm512_setzero_ps());
            Whole(_mm512_mask_blend_ps(negative, high.0, low.0))
        }
    }

    #[inline(always)]
    unsafe fn exceeds(self, other: Self) -> u16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_NLE_UQ>(self.0, other.0) }
    }

    #[inline(always)]
    unsafe fn raise(self, max: &mut f32) {
        unsafe {
            if _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, _mm512_set1_ps(*max)) != 0 {
                *max = _mm512_reduce_max_ps(self.0);
            }
        }
    }

    #[inline(always)]
    unsafe fn add_channels(panel: usize, mask: u16, survivors: &mut Survivors) {
        unsafe { channels_of(panel, mask, survivors) }
    }
}

/// Adds the channels of a panel whose bit is set in `mask`.
#[target_feature(enable = "avx512f")]
#[inline]
pub(in crate::kernels) fn channels_of(panel: usize, mask: u16, survivors: &mut Survivors) {
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    let channels = _mm512_add_epi32(_mm512_set1_epi32((panel * PANEL) as i32), lanes);
    let channels = _mm512_cvtepi32_epi16(_mm512_maskz_compress_epi32(mask, channels));
    let mut few = [0; PANEL];
    // SAFETY: sixteen channels of two bytes.
    unsafe { _mm256_storeu_si256(few.as_mut_ptr().cast(), channels) };
    survivors.add(few, mask.count_ones());
}

// SAFETY (all): where AVX-512F was detected, and as the algorithms ask.

#[target_feature(enable = "avx512f")]
pub(in crate::kernels) unsafe fn dense_relu(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    y: &mut [f32],
) {
    unsafe { dense::relu::<Whole, 2, 12>(layer, points, x, y) }
}

#[target_feature(enable = "avx512f")]
pub(in crate::kernels) unsafe fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    unsafe { dense::max::<Whole, ARG, 2, 12>(layer, points, x, first, max, argmax) }
}

#[target_feature(enable = "avx512f")]
pub(in crate::kernels) unsafe fn dense_max_near(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    max: &mut [f32],
) {
    unsafe { pruned::max::<Whole, 2, 8>(layer, points, x, max) }
}

#[target_feature(enable = "avx512f")]
pub(in crate::kernels) unsafe fn gemv(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
) {
    unsafe { dense::gemv::<Whole, 8>(layer, start, from, x, y) }
}
