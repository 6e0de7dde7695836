//! Bytes with simd128 of WebAssembly: sixteen sums in four registers, by 16-bit products.
#![allow(unsafe_code, clippy::needless_range_loop)]

use crate::dims::QUAD;
use crate::kernels::byte::dense;
use crate::kernels::byte::vector::Sums;
use crate::layer::{Codes, Requantise};
use core::arch::wasm32::*;
use core::ops::Range;

/// Values in one register.
const LANES: usize = 4;
/// Points in one block.
const POINTS: usize = 2;

#[derive(Clone, Copy)]
pub(in crate::kernels) struct Quarters([v128; 4]);

// SAFETY (all): as `Sums` asks; simd128 is part of the target.
impl Sums for Quarters {
    type Partial = Self;
    type Weights = [v128; 4];
    /// Even and odd codes, in 16 bits.
    type Codes = [v128; 2];

    #[inline(always)]
    unsafe fn zero() -> Self {
        Quarters([i32x4_splat(0); 4])
    }

    #[inline(always)]
    unsafe fn load_weights(from: *const i8) -> [v128; 4] {
        core::array::from_fn(|q| unsafe { v128_load(from.add(q * QUAD * LANES).cast()) })
    }

    #[inline(always)]
    unsafe fn load_four<const EIGHT: bool>(from: *const u8) -> [v128; 2] {
        let four = i32x4_splat(unsafe { from.cast::<i32>().read_unaligned() });
        [v128_and(four, i16x8_splat(0xff)), u16x8_shr(four, 8)]
    }

    #[inline(always)]
    unsafe fn add_products<const WHICH: i32>(
        mut sum: Self,
        w: [v128; 4],
        [even, odd]: [v128; 2],
    ) -> Self {
        for q in 0..4 {
            let even = i32x4_dot_i16x8(i16x8_shr(i16x8_shl(w[q], 8), 8), even);
            let odd = i32x4_dot_i16x8(i16x8_shr(w[q], 8), odd);
            sum.0[q] = i32x4_add(sum.0[q], i32x4_add(even, odd));
        }
        sum
    }

    #[inline(always)]
    unsafe fn total(sum: Self) -> Self {
        sum
    }

    #[inline(always)]
    unsafe fn splat(value: i32) -> Self {
        Quarters([i32x4_splat(value); 4])
    }

    #[inline(always)]
    unsafe fn load(from: *const i32) -> Self {
        Quarters(core::array::from_fn(|q| unsafe {
            v128_load(from.add(q * LANES).cast())
        }))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut i32) {
        for q in 0..4 {
            unsafe { v128_store(to.add(q * LANES).cast(), self.0[q]) }
        }
    }

    #[inline(always)]
    unsafe fn add(mut self, other: Self) -> Self {
        for q in 0..4 {
            self.0[q] = i32x4_add(self.0[q], other.0[q]);
        }
        self
    }

    #[inline(always)]
    unsafe fn max(mut self, other: Self) -> Self {
        for q in 0..4 {
            self.0[q] = i32x4_max(self.0[q], other.0[q]);
        }
        self
    }

    #[inline(always)]
    unsafe fn shift_left<const BITS: i32>(mut self) -> Self {
        for q in 0..4 {
            self.0[q] = i32x4_shl(self.0[q], BITS as u32);
        }
        self
    }

    /// One by one: each has its own shift, which simd128 lacks.
    #[inline(always)]
    unsafe fn store_codes(self, requantise: Self, to: *mut u8) {
        let (mut sums, mut by) = ([0i32; 16], [0i32; 16]);
        unsafe {
            self.store(sums.as_mut_ptr());
            requantise.store(by.as_mut_ptr());
            for (lane, (sum, by)) in sums.into_iter().zip(by).enumerate() {
                let code = Requantise(by as u32).apply_32(sum, 255);
                to.add(lane).write(code as u8);
            }
        }
    }
}

// SAFETY (all): as the algorithms ask.

pub(in crate::kernels) unsafe fn dense_codes_max<const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    unsafe { dense::max::<Quarters, MARK, 1, POINTS>(layer, panels, x, 0, max) }
}

pub(in crate::kernels) unsafe fn dense_codes(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    unsafe { dense::codes::<Quarters, POINTS>(layer, bias, requantise, x, y) }
}

pub(in crate::kernels) unsafe fn gemv_codes(
    layer: &Codes<'_>,
    columns: Range<usize>,
    planes: [&[u8]; 2],
    y: &mut [i32],
) {
    unsafe { dense::gemv::<Quarters, 1>(layer, columns, planes, y) }
}
