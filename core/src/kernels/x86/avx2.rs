//! AVX2 and FMA: sixteen values in two registers.
#![allow(unsafe_code, clippy::needless_range_loop)]

use crate::kernels::float::vector::Vector;
use crate::kernels::float::{dense, pruned};
use crate::layer::Dense;
use core::arch::x86_64::*;

/// Values in one register.
const LANES: usize = 8;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Halves([__m256; 2]);

// SAFETY (all): as `Vector` asks.
impl Vector for Halves {
    type Rows = [__m256i; 2];
    type Inputs = __m256;
    const INPUTS: usize = 1;

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Halves([unsafe { _mm256_set1_ps(value) }; 2])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { Halves([_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(LANES))]) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe {
            _mm256_storeu_ps(to, self.0[0]);
            _mm256_storeu_ps(to.add(LANES), self.0[1]);
        }
    }

    #[inline(always)]
    unsafe fn load_rows(from: *const u32) -> Self::Rows {
        unsafe {
            [
                _mm256_loadu_si256(from.cast()),
                _mm256_loadu_si256(from.add(LANES).cast()),
            ]
        }
    }

    #[inline(always)]
    unsafe fn store_rows(rows: Self::Rows, to: *mut u32) {
        unsafe {
            _mm256_storeu_si256(to.cast(), rows[0]);
            _mm256_storeu_si256(to.add(LANES).cast(), rows[1]);
        }
    }

    #[inline(always)]
    unsafe fn add_product(mut self, a: Self, b: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe { _mm256_fmadd_ps(a.0[half], b.0[half], self.0[half]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn max(mut self, other: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe { _mm256_max_ps(self.0[half], other.0[half]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn keep_higher(
        mut self,
        mut rows: Self::Rows,
        sum: Self,
        row: u32,
    ) -> (Self, Self::Rows) {
        for half in 0..2 {
            unsafe {
                let higher = _mm256_cmp_ps::<_CMP_GT_OQ>(sum.0[half], self.0[half]);
                self.0[half] = _mm256_blendv_ps(self.0[half], sum.0[half], higher);
                let here = _mm256_castsi256_ps(_mm256_set1_epi32(row as i32));
                let kept = _mm256_blendv_ps(_mm256_castsi256_ps(rows[half]), here, higher);
                rows[half] = _mm256_castps_si256(kept);
            }
        }
        (self, rows)
    }

    #[inline(always)]
    unsafe fn load_inputs(from: *const f32) -> __m256 {
        unsafe { _mm256_set1_ps(*from) }
    }

    #[inline(always)]
    unsafe fn add_input<const WHICH: i32>(self, w: Self, x: __m256) -> Self {
        unsafe { self.add_product(w, Halves([x; 2])) }
    }

    #[inline(always)]
    unsafe fn extreme(mut self, high: Self, low: Self) -> Self {
        for half in 0..2 {
            self.0[half] = unsafe { _mm256_blendv_ps(high.0[half], low.0[half], self.0[half]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn exceeds(self, other: Self) -> u16 {
        let mut mask = 0;
        for half in 0..2 {
            let above = unsafe { _mm256_cmp_ps::<_CMP_NLE_UQ>(self.0[half], other.0[half]) };
            mask |= unsafe { _mm256_movemask_ps(above) } << (half * LANES);
        }
        mask as u16
    }

    #[inline(always)]
    unsafe fn raise(self, max: &mut f32) {
        unsafe {
            let most = _mm256_max_ps(self.0[0], self.0[1]);
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

// SAFETY (all): where AVX2 and FMA were detected, and as the algorithms ask.

#[target_feature(enable = "avx2,fma")]
pub(in crate::kernels) unsafe fn dense_relu(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    y: &mut [f32],
) {
    unsafe { dense::relu::<Halves, 1, 6>(layer, points, x, y) }
}

#[target_feature(enable = "avx2,fma")]
pub(in crate::kernels) unsafe fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    unsafe { dense::max::<Halves, ARG, 1, 6>(layer, points, x, first, max, argmax) }
}

#[target_feature(enable = "avx2,fma")]
pub(in crate::kernels) unsafe fn dense_max_near(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    max: &mut [f32],
) {
    unsafe { pruned::max::<Halves, 1, 4>(layer, points, x, max) }
}

#[target_feature(enable = "avx2,fma")]
pub(in crate::kernels) unsafe fn gemv(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
) {
    unsafe { dense::gemv::<Halves, 4>(layer, start, from, x, y) }
}
