//! NEON: sixteen values in four registers. Every target that this file is compiled for has it, so nothing is detected.
#![allow(unsafe_code, clippy::needless_range_loop)]

use crate::kernels::float::vector::Vector;
use crate::kernels::float::{dense, pruned};
use crate::layer::Dense;
use core::arch::aarch64::*;

/// Values in one register.
const LANES: usize = 4;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Quarters([float32x4_t; 4]);

// SAFETY (all): as `Vector` asks.
impl Vector for Quarters {
    type Rows = [uint32x4_t; 4];
    type Inputs = float32x4_t;
    const INPUTS: usize = LANES;

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Quarters([unsafe { vdupq_n_f32(value) }; 4])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        Quarters(core::array::from_fn(|q| unsafe {
            vld1q_f32(from.add(q * LANES))
        }))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        for q in 0..4 {
            unsafe { vst1q_f32(to.add(q * LANES), self.0[q]) }
        }
    }

    #[inline(always)]
    unsafe fn load_rows(from: *const u32) -> Self::Rows {
        core::array::from_fn(|q| unsafe { vld1q_u32(from.add(q * LANES)) })
    }

    #[inline(always)]
    unsafe fn store_rows(rows: Self::Rows, to: *mut u32) {
        for q in 0..4 {
            unsafe { vst1q_u32(to.add(q * LANES), rows[q]) }
        }
    }

    #[inline(always)]
    unsafe fn add_product(mut self, a: Self, b: Self) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vfmaq_f32(self.0[q], a.0[q], b.0[q]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn max(mut self, other: Self) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vmaxq_f32(self.0[q], other.0[q]) };
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
        for q in 0..4 {
            unsafe {
                let higher = vcgtq_f32(sum.0[q], self.0[q]);
                self.0[q] = vbslq_f32(higher, sum.0[q], self.0[q]);
                rows[q] = vbslq_u32(higher, vdupq_n_u32(row), rows[q]);
            }
        }
        (self, rows)
    }

    #[inline(always)]
    unsafe fn load_inputs(from: *const f32) -> float32x4_t {
        unsafe { vld1q_f32(from) }
    }

    #[inline(always)]
    unsafe fn add_input<const WHICH: i32>(mut self, w: Self, x: float32x4_t) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vfmaq_laneq_f32::<WHICH>(self.0[q], w.0[q], x) };
        }
        self
    }

    #[inline(always)]
    unsafe fn extreme(mut self, high: Self, low: Self) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vbslq_f32(vcltzq_f32(self.0[q]), low.0[q], high.0[q]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn exceeds(self, other: Self) -> u16 {
        let mut mask = 0;
        for q in 0..4 {
            // Not "less or equal", so that NaN counts as above.
            let above = unsafe { vmvnq_u32(vcleq_f32(self.0[q], other.0[q])) };
            let bits = unsafe { vld1q_u32([1, 2, 4, 8].as_ptr()) };
            mask |= (unsafe { vaddvq_u32(vandq_u32(above, bits)) } as u16) << (q * LANES);
        }
        mask
    }

    #[inline(always)]
    unsafe fn raise(self, max: &mut f32) {
        let [a, b, c, d] = self.0;
        let most = unsafe { vmaxvq_f32(vmaxq_f32(vmaxq_f32(a, b), vmaxq_f32(c, d))) };
        *max = if most > *max { most } else { *max };
    }
}

// SAFETY (all): as the algorithms ask.

pub(in crate::kernels) unsafe fn dense_relu(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    y: &mut [f32],
) {
    unsafe { dense::relu::<Quarters, 1, 4>(layer, points, x, y) }
}

pub(in crate::kernels) unsafe fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    unsafe { dense::max::<Quarters, ARG, 1, 4>(layer, points, x, first, max, argmax) }
}

pub(in crate::kernels) unsafe fn dense_max_near(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    max: &mut [f32],
) {
    unsafe { pruned::max::<Quarters, 1, 4>(layer, points, x, max) }
}

pub(in crate::kernels) unsafe fn gemv(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
) {
    unsafe { dense::gemv::<Quarters, 1>(layer, start, from, x, y) }
}
