//! Bytes with NEON, sixteen sums in four registers: with `sdot` of Armv8.2 (`DOT`), or 16-bit products of plain NEON.
//!
//! Both multiply signed bytes only, so 128 is subtracted from codes of eight bits, and `128 Σ w`, one value for each output, is
//! added afterwards: the same integers as everywhere. `sdot` has no stable intrinsic, so it is in `asm!`.
#![allow(unsafe_code, clippy::needless_range_loop)]

use crate::dims::{PANEL, QUAD};
use crate::kernels::byte::dense;
use crate::kernels::byte::vector::Sums;
use crate::layer::Codes;
use core::arch::aarch64::*;
use core::arch::asm;
use core::ops::Range;

/// Values in one register.
const LANES: usize = 4;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Quarters<const DOT: bool>([int32x4_t; 4]);

/// `sum + Σ w x` over four bytes of each lane; `x` contributes the four bytes of lane `LANE`.
#[inline(always)]
fn sdot<const LANE: i32>(mut sum: int32x4_t, w: int8x16_t, x: int8x16_t) -> int32x4_t {
    // SAFETY: computes on registers only; called where the instruction was detected.
    unsafe {
        asm!(
            ".arch_extension dotprod",
            "sdot {sum:v}.4s, {w:v}.16b, {x:v}.4b[{lane}]",
            sum = inout(vreg) sum,
            w = in(vreg) w,
            x = in(vreg) x,
            lane = const LANE,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    sum
}

// SAFETY (all): as `Sums` asks; of `DOT` where `sdot` was detected.
impl<const DOT: bool> Sums for Quarters<DOT> {
    /// Plain NEON has two halves for each register: its first two outputs, then the others. `sdot` uses the first half only.
    type Partial = [[int32x4_t; 2]; 4];
    type Weights = [int8x16_t; 4];
    type Codes = int8x16_t;
    const BY_SIXTEEN: bool = true;

    #[inline(always)]
    unsafe fn zero() -> Self::Partial {
        [[unsafe { vdupq_n_s32(0) }; 2]; 4]
    }

    #[inline(always)]
    unsafe fn load_weights(from: *const i8) -> [int8x16_t; 4] {
        core::array::from_fn(|q| unsafe { vld1q_s8(from.add(q * QUAD * LANES)) })
    }

    #[inline(always)]
    unsafe fn load_sixteen<const EIGHT: bool>(from: *const u8) -> int8x16_t {
        unsafe { signed::<EIGHT>(vld1q_u8(from)) }
    }

    #[inline(always)]
    unsafe fn load_four<const EIGHT: bool>(from: *const u8) -> int8x16_t {
        unsafe {
            let four = from.cast::<u32>().read_unaligned();
            signed::<EIGHT>(vreinterpretq_u8_u32(vdupq_n_u32(four)))
        }
    }

    #[inline(always)]
    unsafe fn add_products<const WHICH: i32>(
        mut sum: Self::Partial,
        w: [int8x16_t; 4],
        x: int8x16_t,
    ) -> Self::Partial {
        for q in 0..4 {
            if DOT {
                sum[q][0] = sdot::<WHICH>(sum[q][0], w[q], x);
            } else {
                unsafe {
                    let x = vdupq_laneq_s32::<WHICH>(vreinterpretq_s32_s8(x));
                    let x = vreinterpretq_s8_s32(x);
                    let first = vmull_s8(vget_low_s8(w[q]), vget_low_s8(x));
                    sum[q][0] = vpadalq_s16(sum[q][0], first);
                    sum[q][1] = vpadalq_s16(sum[q][1], vmull_high_s8(w[q], x));
                }
            }
        }
        sum
    }

    #[inline(always)]
    unsafe fn total(sum: Self::Partial) -> Self {
        Quarters(sum.map(|[first, others]| {
            if DOT {
                first
            } else {
                unsafe { vpaddq_s32(first, others) }
            }
        }))
    }

    /// `128 Σ w` for each output.
    #[inline(always)]
    unsafe fn sign_correction(inputs: usize, weights: *const i8) -> Self {
        unsafe {
            let mut sum = Self::zero();
            for k in 0..inputs / QUAD {
                let w = Self::load_weights(weights.add(k * QUAD * PANEL));
                sum = Self::add_products::<0>(sum, w, vdupq_n_s8(1));
            }
            Self::total(sum).shift_left::<7>()
        }
    }

    #[inline(always)]
    unsafe fn splat(value: i32) -> Self {
        Quarters([unsafe { vdupq_n_s32(value) }; 4])
    }

    #[inline(always)]
    unsafe fn load(from: *const i32) -> Self {
        Quarters(core::array::from_fn(|q| unsafe {
            vld1q_s32(from.add(q * LANES))
        }))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut i32) {
        for q in 0..4 {
            unsafe { vst1q_s32(to.add(q * LANES), self.0[q]) }
        }
    }

    #[inline(always)]
    unsafe fn add(mut self, other: Self) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vaddq_s32(self.0[q], other.0[q]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn max(mut self, other: Self) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vmaxq_s32(self.0[q], other.0[q]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn shift_left<const BITS: i32>(mut self) -> Self {
        for q in 0..4 {
            self.0[q] = unsafe { vshlq_n_s32::<BITS>(self.0[q]) };
        }
        self
    }

    #[inline(always)]
    unsafe fn store_codes(self, requantise: Self, to: *mut u8) {
        unsafe {
            let codes: [uint16x4_t; 4] = core::array::from_fn(|q| {
                let r = requantise.0[q];
                let (factor, shift) = (vandq_s32(r, vdupq_n_s32(0xffff)), vshrq_n_s32::<16>(r));
                let half = vshrq_n_s32::<1>(vshlq_s32(vdupq_n_s32(1), shift));
                let product = vmulq_s32(self.0[q], factor);
                vqmovun_s32(vshlq_s32(vaddq_s32(product, half), vnegq_s32(shift)))
            });
            for pair in 0..2 {
                let codes = vcombine_u16(codes[2 * pair], codes[2 * pair + 1]);
                vst1_u8(to.add(8 * pair), vqmovn_u16(codes));
            }
        }
    }
}

/// Sixteen codes as signed bytes: minus 128 if they have `EIGHT` bits.
#[inline(always)]
unsafe fn signed<const EIGHT: bool>(codes: uint8x16_t) -> int8x16_t {
    let flip = if EIGHT { 0x80 } else { 0 };
    // SAFETY: NEON is part of the target.
    unsafe { vreinterpretq_s8_u8(veorq_u8(codes, vdupq_n_u8(flip))) }
}

// SAFETY (all): as the algorithms require; with `DOT`, `sdot` was detected. Plain NEON has twice the sums for each point.

pub(in crate::kernels) unsafe fn dense_codes_max<const DOT: bool, const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    unsafe {
        if DOT {
            dense::max::<Quarters<DOT>, MARK, 1, 4>(layer, panels, x, 0, max);
        } else {
            dense::max::<Quarters<DOT>, MARK, 1, 2>(layer, panels, x, 0, max);
        }
    }
}

pub(in crate::kernels) unsafe fn dense_codes<const DOT: bool>(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    unsafe {
        if DOT {
            dense::codes::<Quarters<DOT>, 4>(layer, bias, requantise, x, y);
        } else {
            dense::codes::<Quarters<DOT>, 2>(layer, bias, requantise, x, y);
        }
    }
}

pub(in crate::kernels) unsafe fn gemv_codes<const DOT: bool>(
    layer: &Codes<'_>,
    columns: Range<usize>,
    planes: [&[u8]; 2],
    y: &mut [i32],
) {
    unsafe { dense::gemv::<Quarters<DOT>, 1>(layer, columns, planes, y) }
}
