//! Integer layers with NEON, 16 outputs by 4 or 2 points, written once for two dot products of four bytes:
//! `sdot` of Armv8.2, and one that plain NEON puts together from products of 16 bits.
//!
//! Both multiply signed bytes only, so activation codes are taken less 128, and `128 Σ w`, one value an
//! output, is added afterwards: the same integers as everywhere. `sdot` has no stable intrinsic and
//! stands in `asm!`.
//!
//! Every function must only be called with a whole layer and slices of the lengths that
//! [`super::Isa`] checks, and those of [`dot`] only where the instruction was detected.
#![allow(unsafe_code, clippy::needless_range_loop)]

use core::arch::aarch64::*;
use core::arch::asm;

/// `sum + Σ w x` of four bytes a lane; of `x` the four bytes of lane `LANE`.
#[inline(always)]
fn dot_sdot<const LANE: i32>(mut sum: int32x4_t, w: int8x16_t, x: int8x16_t) -> int32x4_t {
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

/// Sums of plain NEON, two halves of each: of the first two outputs of a register, then of the others.
type Halves = [int32x4_t; 2];

/// As [`dot_sdot`].
#[inline(always)]
fn dot_plain<const LANE: i32>([first, others]: Halves, w: int8x16_t, x: int8x16_t) -> Halves {
    // SAFETY: NEON is part of the target.
    unsafe {
        let x = vreinterpretq_s8_s32(vdupq_laneq_s32::<LANE>(vreinterpretq_s32_s8(x)));
        [
            vpadalq_s16(first, vmull_s8(vget_low_s8(w), vget_low_s8(x))),
            vpadalq_s16(others, vmull_high_s8(w, x)),
        ]
    }
}

#[inline(always)]
fn total_sdot(sum: int32x4_t) -> int32x4_t {
    sum
}

#[inline(always)]
fn total_plain([first, others]: Halves) -> int32x4_t {
    // SAFETY: NEON is part of the target.
    unsafe { vpaddq_s32(first, others) }
}

macro_rules! kernels {
    ($module:ident, $dot:ident, $total:ident, $zero:expr, $points:literal) => {
        pub(super) mod $module {
            use super::super::bytes::{ROW_BITS, row_mark};
            use super::{$dot, $total};
            use crate::dims::PANEL;
            use crate::layer::Codes;
            use core::arch::aarch64::*;
            use core::ops::Range;

            /// Bytes of one group of four inputs in a panel.
            const QUAD: usize = 4 * PANEL;
            /// Outputs in one register.
            const LANES: usize = 4;
            /// Registers of one panel.
            const QUARTERS: usize = PANEL / LANES;
            /// Points of one block.
            const POINTS: usize = $points;

            /// Sums of one panel.
            type Sums = [int32x4_t; QUARTERS];

            /// Sixteen codes as signed bytes: less 128 where `LESS_128`.
            #[inline(always)]
            unsafe fn signed<const LESS_128: bool>(codes: uint8x16_t) -> int8x16_t {
                let flip = if LESS_128 { 0x80 } else { 0 };
                // SAFETY: NEON is part of the target.
                unsafe { vreinterpretq_s8_u8(veorq_u8(codes, vdupq_n_u8(flip))) }
            }

            /// Sums of one panel at `weights` and the rows at `x`, of codes less 128 where `LESS_128`.
            #[inline(always)]
            unsafe fn sums<const N: usize, const LESS_128: bool>(
                inputs: usize,
                weights: *const i8,
                x: [*const u8; N],
            ) -> [Sums; N] {
                // SAFETY: the caller guarantees `inputs` columns of a panel at `weights` and as many
                // codes of each row, and a multiple of four inputs.
                unsafe {
                    let zero = vdupq_n_s32(0);
                    let mut sum = [[$zero(zero); QUARTERS]; N];
                    let whole = inputs / 16 * 16;
                    for k in (0..whole).step_by(16) {
                        let x: [int8x16_t; N] =
                            core::array::from_fn(|n| signed::<LESS_128>(vld1q_u8(x[n].add(k))));
                        macro_rules! quad {
                            ($lane:literal) => {
                                for q in 0..QUARTERS {
                                    let at = (k / 4 + $lane) * QUAD + q * 16;
                                    let w = vld1q_s8(weights.add(at));
                                    for n in 0..N {
                                        sum[n][q] = $dot::<$lane>(sum[n][q], w, x[n]);
                                    }
                                }
                            };
                        }
                        quad!(0);
                        quad!(1);
                        quad!(2);
                        quad!(3);
                    }
                    for k in (whole..inputs).step_by(4) {
                        for n in 0..N {
                            let four = x[n].add(k).cast::<u32>().read_unaligned();
                            let x = signed::<LESS_128>(vreinterpretq_u8_u32(vdupq_n_u32(four)));
                            for q in 0..QUARTERS {
                                let w = vld1q_s8(weights.add(k / 4 * QUAD + q * 16));
                                sum[n][q] = $dot::<0>(sum[n][q], w, x);
                            }
                        }
                    }
                    sum.map(|row| row.map($total))
                }
            }

            /// Starts of `N` rows of `inputs` codes.
            #[inline(always)]
            unsafe fn rows<const N: usize>(x: *const u8, inputs: usize) -> [*const u8; N] {
                // SAFETY: the caller guarantees `N` rows.
                core::array::from_fn(|n| unsafe { x.add(n * inputs) })
            }

            /// `-128 Σ w` of one panel: what sums of codes less 128 have too much.
            #[inline(always)]
            unsafe fn excess(inputs: usize, weights: *const i8) -> Sums {
                // SAFETY: as for `sums`.
                unsafe {
                    let zero = vdupq_n_s32(0);
                    let mut sum = [$zero(zero); QUARTERS];
                    for k in 0..inputs / 4 {
                        for q in 0..QUARTERS {
                            let w = vld1q_s8(weights.add(k * QUAD + q * 16));
                            sum[q] = $dot::<0>(sum[q], w, vdupq_n_s8(-128));
                        }
                    }
                    sum.map($total)
                }
            }

            /// As [`super::super::bytes::dense_codes_max`].
            pub(in super::super) unsafe fn dense_codes_max<const MARK: bool>(
                layer: &Codes<'_>,
                panels: Range<usize>,
                x: &[u8],
                max: &mut [i32],
            ) {
                let points = x.len() / layer.inputs();
                if points == 0 {
                    return;
                }
                for panel in panels {
                    // SAFETY: blocks cover the given panels and whole rows of `x` only.
                    unsafe {
                        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
                        let mut best = [vdupq_n_s32(i32::MIN); QUARTERS];
                        let mut n = 0;
                        while n < points {
                            let x = x.as_ptr().add(n * layer.inputs());
                            n += if points - n >= POINTS {
                                let x = rows::<POINTS>(x, layer.inputs());
                                let sums = sums::<POINTS, true>(layer.inputs(), weights, x);
                                raise::<_, MARK>(sums, n, &mut best)
                            } else {
                                let sums = sums::<1, true>(layer.inputs(), weights, [x]);
                                raise::<_, MARK>(sums, n, &mut best)
                            };
                        }
                        let excess = excess(layer.inputs(), weights);
                        for q in 0..QUARTERS {
                            let max = max.as_mut_ptr().add(panel * PANEL + q * LANES);
                            let excess = if MARK {
                                vshlq_n_s32::<{ ROW_BITS as i32 }>(excess[q])
                            } else {
                                excess[q]
                            };
                            let best = vsubq_s32(best[q], excess);
                            vst1q_s32(max, vmaxq_s32(best, vld1q_s32(max)));
                        }
                    }
                }
            }

            #[inline(always)]
            fn raise<const N: usize, const MARK: bool>(
                sums: [Sums; N],
                first: usize,
                best: &mut Sums,
            ) -> usize {
                for (n, sum) in sums.into_iter().enumerate() {
                    for (best, mut sum) in best.iter_mut().zip(sum) {
                        // SAFETY: NEON is part of the target.
                        unsafe {
                            if MARK {
                                let mark = vdupq_n_s32(row_mark(first + n));
                                sum = vorrq_s32(vshlq_n_s32::<{ ROW_BITS as i32 }>(sum), mark);
                            }
                            *best = vmaxq_s32(*best, sum);
                        }
                    }
                }
                N
            }

            /// As [`super::super::bytes::dense_codes`].
            pub(in super::super) unsafe fn dense_codes(
                layer: &Codes<'_>,
                bias: &[i32],
                requantise: &[u32],
                x: &[u8],
                y: &mut [u8],
            ) {
                let points = (x.len() / layer.inputs()).min(y.len() / layer.outputs());
                for panel in 0..layer.outputs() / PANEL {
                    // SAFETY: blocks cover whole panels and whole rows of `x` and `y` only.
                    unsafe {
                        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
                        let excess = excess(layer.inputs(), weights);
                        let bias = bias.as_ptr().add(panel * PANEL);
                        let start = core::array::from_fn(|q| {
                            vsubq_s32(vld1q_s32(bias.add(q * LANES)), excess[q])
                        });
                        let factors = requantise.as_ptr().add(panel * PANEL);
                        let mut n = 0;
                        while n < points {
                            let x = x.as_ptr().add(n * layer.inputs());
                            let y = y.as_mut_ptr().add(n * layer.outputs() + panel * PANEL);
                            n += if points - n >= POINTS {
                                let x = rows::<POINTS>(x, layer.inputs());
                                let sum = sums::<POINTS, true>(layer.inputs(), weights, x);
                                put(sum, start, factors, y, layer.outputs())
                            } else {
                                let sum = sums::<1, true>(layer.inputs(), weights, [x]);
                                put(sum, start, factors, y, layer.outputs())
                            };
                        }
                    }
                }
            }

            #[inline(always)]
            unsafe fn put<const N: usize>(
                sums: [Sums; N],
                start: Sums,
                factors: *const u32,
                y: *mut u8,
                stride: usize,
            ) -> usize {
                // SAFETY: the caller guarantees one panel of `factors` and `N` rows of codes at `y`.
                unsafe {
                    for (n, sum) in sums.into_iter().enumerate() {
                        let codes: [uint16x4_t; QUARTERS] = core::array::from_fn(|q| {
                            let r = vreinterpretq_s32_u32(vld1q_u32(factors.add(q * LANES)));
                            let (factor, shift) =
                                (vandq_s32(r, vdupq_n_s32(0xffff)), vshrq_n_s32::<16>(r));
                            let half = vshrq_n_s32::<1>(vshlq_s32(vdupq_n_s32(1), shift));
                            let product = vmulq_s32(vaddq_s32(sum[q], start[q]), factor);
                            vqmovun_s32(vshlq_s32(vaddq_s32(product, half), vnegq_s32(shift)))
                        });
                        for pair in 0..2 {
                            let codes = vcombine_u16(codes[2 * pair], codes[2 * pair + 1]);
                            vst1_u8(y.add(n * stride + 8 * pair), vqmovn_u16(codes));
                        }
                    }
                }
                N
            }

            /// As [`super::super::bytes::gemv_codes`]; codes of both planes are below 128.
            pub(in super::super) unsafe fn gemv_codes(
                layer: &Codes<'_>,
                columns: Range<usize>,
                [high, low]: [&[u8]; 2],
                y: &mut [i32],
            ) {
                let inputs = columns.len();
                for panel in 0..layer.outputs() / PANEL {
                    // SAFETY: the caller guarantees panels of `layer.inputs()` columns, which hold
                    // `columns`, planes as long as those, and all outputs in `y`.
                    unsafe {
                        let at = (panel * layer.inputs() + columns.start) * PANEL;
                        let weights = layer.panels().as_ptr().add(at);
                        let planes = [high.as_ptr(), low.as_ptr()];
                        let [high, low] = sums::<2, false>(inputs, weights, planes);
                        for q in 0..QUARTERS {
                            let y = y.as_mut_ptr().add(panel * PANEL + q * LANES);
                            let sum = vaddq_s32(vshlq_n_s32::<6>(high[q]), low[q]);
                            vst1q_s32(y, vaddq_s32(sum, vld1q_s32(y)));
                        }
                    }
                }
            }
        }
    };
}

kernels!(plain, dot_plain, total_plain, |zero| [zero; 2], 2);
kernels!(dot, dot_sdot, total_sdot, |zero| zero, 4);
