//! NEON kernels in f32: 16 outputs by 4 points in 16 accumulators, with fused multiply-add.
//!
//! NEON is part of every target that this file is compiled for, so nothing has to be detected. Every
//! function must only be called with `points` rows in `x` (and `y`), `max`/`argmax`/`start`/`y` at least
//! as long as `layer.bias()`, and a layer whose arrays have their padded lengths; [`super::Isa`] checks it.
#![allow(unsafe_code, clippy::needless_range_loop)]

use crate::dims::PANEL;
use crate::layer::Dense;
use core::arch::aarch64::*;

/// Outputs in one register.
const LANES: usize = 4;
/// Registers of one panel.
const QUARTERS: usize = PANEL / LANES;
/// Points of one block.
const POINTS: usize = 4;

/// Sums of one panel.
type Sums = [float32x4_t; QUARTERS];

#[inline(always)]
unsafe fn load(from: *const f32) -> Sums {
    // SAFETY: the caller guarantees one panel of values.
    core::array::from_fn(|q| unsafe { vld1q_f32(from.add(q * LANES)) })
}

#[inline(always)]
unsafe fn store(to: *mut f32, values: Sums) {
    for (q, value) in values.into_iter().enumerate() {
        // SAFETY: the caller guarantees room for one panel.
        unsafe { vst1q_f32(to.add(q * LANES), value) }
    }
}

/// `start + W x` for one panel whose columns start at `weights`, and `N` rows of `inputs` values that
/// start `stride` apart at `x`.
#[inline(always)]
unsafe fn block<const N: usize>(
    weights: *const f32,
    start: Sums,
    inputs: usize,
    x: *const f32,
    stride: usize,
) -> [Sums; N] {
    // SAFETY: the caller guarantees `inputs` columns of one panel and `N` rows of `inputs` values.
    unsafe {
        let mut sum = [start; N];
        let whole = inputs / LANES * LANES;
        for k in (0..whole).step_by(LANES) {
            let values: [float32x4_t; N] =
                core::array::from_fn(|n| vld1q_f32(x.add(n * stride + k)));
            macro_rules! column {
                ($lane:literal) => {
                    let w = load(weights.add((k + $lane) * PANEL));
                    for n in 0..N {
                        for q in 0..QUARTERS {
                            sum[n][q] = vfmaq_laneq_f32::<$lane>(sum[n][q], w[q], values[n]);
                        }
                    }
                };
            }
            column!(0);
            column!(1);
            column!(2);
            column!(3);
        }
        for k in whole..inputs {
            let w = load(weights.add(k * PANEL));
            for n in 0..N {
                let value = *x.add(n * stride + k);
                for q in 0..QUARTERS {
                    sum[n][q] = vfmaq_n_f32(sum[n][q], w[q], value);
                }
            }
        }
        sum
    }
}

pub(super) unsafe fn dense_relu(layer: &Dense<'_>, points: usize, x: &[f32], y: &mut [f32]) {
    let stride = layer.width();
    // SAFETY: blocks cover whole panels and rows 0..points only, which the caller guarantees.
    unsafe {
        for panel in 0..stride / PANEL {
            let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
            let bias = load(layer.bias().as_ptr().add(panel * PANEL));
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let y = y.as_mut_ptr().add(n * stride + panel * PANEL);
                n += if points - n >= POINTS {
                    relu_rows::<POINTS>(layer, weights, bias, x, y)
                } else {
                    relu_rows::<1>(layer, weights, bias, x, y)
                };
            }
        }
    }
}

#[inline(always)]
unsafe fn relu_rows<const N: usize>(
    layer: &Dense<'_>,
    weights: *const f32,
    bias: Sums,
    x: *const f32,
    y: *mut f32,
) -> usize {
    // SAFETY: as the caller guarantees; `y` points at row 0 of the panel.
    unsafe {
        let sums = block::<N>(weights, bias, layer.inputs(), x, layer.inputs());
        for (n, sum) in sums.into_iter().enumerate() {
            let positive = sum.map(|s| vmaxq_f32(s, vdupq_n_f32(0.0)));
            store(y.add(n * layer.width()), positive);
        }
    }
    N
}

pub(super) unsafe fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    // SAFETY: blocks cover whole panels and rows 0..points only; `argmax` is used where `ARG`.
    unsafe {
        for panel in 0..layer.bias().len() / PANEL {
            let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
            let bias = load(layer.bias().as_ptr().add(panel * PANEL));
            let max = max.as_mut_ptr().add(panel * PANEL);
            let arg = if ARG {
                argmax.as_mut_ptr().add(panel * PANEL)
            } else {
                core::ptr::null_mut()
            };
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let row = first + n as u32;
                n += if points - n >= POINTS {
                    let sums = block::<POINTS>(weights, bias, layer.inputs(), x, layer.inputs());
                    max_rows::<ARG, POINTS>(sums, row, max, arg)
                } else {
                    let sums = block::<1>(weights, bias, layer.inputs(), x, layer.inputs());
                    max_rows::<ARG, 1>(sums, row, max, arg)
                };
            }
        }
    }
}

#[inline(always)]
unsafe fn max_rows<const ARG: bool, const N: usize>(
    sums: [Sums; N],
    row: u32,
    max: *mut f32,
    arg: *mut u32,
) -> usize {
    for q in 0..QUARTERS {
        // SAFETY: the caller guarantees one panel at `max`, and at `arg` where `ARG`.
        unsafe {
            let mut best = vld1q_f32(max.add(q * LANES));
            if ARG {
                let mut index = vld1q_u32(arg.add(q * LANES));
                for (n, sum) in sums.iter().enumerate() {
                    let higher = vcgtq_f32(sum[q], best);
                    best = vbslq_f32(higher, sum[q], best);
                    index = vbslq_u32(higher, vdupq_n_u32(row + n as u32), index);
                }
                vst1q_u32(arg.add(q * LANES), index);
            } else {
                for sum in &sums {
                    best = vmaxq_f32(best, sum[q]);
                }
            }
            vst1q_f32(max.add(q * LANES), best);
        }
    }
    N
}

pub(super) unsafe fn gemv(layer: &Dense<'_>, start: &[f32], from: usize, x: &[f32], y: &mut [f32]) {
    for panel in 0..layer.bias().len() / PANEL {
        // SAFETY: columns from..from + len(x) of the panel exist, and `start` and `y` hold it, as the
        // caller guarantees.
        unsafe {
            let column = panel * layer.inputs() + from;
            let weights = layer.panels().as_ptr().add(column * PANEL);
            let start = load(start.as_ptr().add(panel * PANEL));
            let [sum] = block::<1>(weights, start, x.len(), x.as_ptr(), 0);
            store(y.as_mut_ptr().add(panel * PANEL), sum);
        }
    }
}
