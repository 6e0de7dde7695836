//! AVX-512F kernels: 32 outputs by 12 points in 24 accumulators.
//!
//! Every function must only be called where AVX-512F was detected, with `points` rows in `x` (and
//! `y`), `max`/`argmax`/`start`/`y` at least as long as `layer.bias()`, and a layer whose arrays have
//! their padded lengths; [`super::Isa`] checks all of it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use crate::dims::PANEL;
use crate::layer::Dense;
use core::arch::x86_64::*;

/// Points of one block.
const POINTS: usize = 12;

/// `b + W x` for `P` panels (16 outputs each) and `N` rows starting at `x`. `INPUTS` is the layer's number of
/// inputs, or 0 for any: where the compiler knows how far rows are apart, no register holds it.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn block<const INPUTS: usize, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    panel: usize,
    x: *const f32,
) -> [[__m512; P]; N] {
    let inputs = if INPUTS > 0 { INPUTS } else { layer.inputs() };
    // SAFETY: the caller guarantees `P` panels from `panel` on and `N` rows of `inputs` values at `x`.
    unsafe {
        let bias = layer.bias().as_ptr().add(panel * PANEL);
        let start: [__m512; P] = core::array::from_fn(|p| _mm512_loadu_ps(bias.add(p * PANEL)));
        let mut sum = [start; N];
        let weights: [*const f32; P] =
            core::array::from_fn(|p| layer.panels().as_ptr().add((panel + p) * inputs * PANEL));
        for k in 0..inputs {
            let mut w = [_mm512_setzero_ps(); P];
            for p in 0..P {
                w[p] = _mm512_loadu_ps(weights[p].add(k * PANEL));
            }
            for n in 0..N {
                let value = _mm512_set1_ps(*x.add(n * inputs + k));
                for p in 0..P {
                    sum[n][p] = _mm512_fmadd_ps(w[p], value, sum[n][p]);
                }
            }
        }
        sum
    }
}

#[target_feature(enable = "avx512f")]
pub(super) unsafe fn dense_relu(layer: &Dense<'_>, points: usize, x: &[f32], y: &mut [f32]) {
    // SAFETY: as the caller guarantees.
    unsafe {
        match layer.inputs() {
            3 => relu_layer::<3>(layer, points, x, y),
            64 => relu_layer::<64>(layer, points, x, y),
            _ => relu_layer::<0>(layer, points, x, y),
        }
    }
}

#[target_feature(enable = "avx512f")]
unsafe fn relu_layer<const INPUTS: usize>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    y: &mut [f32],
) {
    let stride = layer.width();
    let panels = stride / PANEL;
    // SAFETY: blocks cover panels 0..panels and rows 0..points only, which the caller guarantees.
    unsafe {
        let mut panel = 0;
        while panel < panels {
            let two = panel + 2 <= panels;
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let y = y.as_mut_ptr().add(n * stride + panel * PANEL);
                n += match (two, points - n) {
                    (true, POINTS..) => relu_block::<INPUTS, 2, POINTS>(layer, panel, x, y),
                    (true, 4..) => relu_block::<INPUTS, 2, 4>(layer, panel, x, y),
                    (true, _) => relu_block::<INPUTS, 2, 1>(layer, panel, x, y),
                    (false, _) => relu_block::<INPUTS, 1, 1>(layer, panel, x, y),
                };
            }
            panel += if two { 2 } else { 1 };
        }
    }
}

#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn relu_block<const INPUTS: usize, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    panel: usize,
    x: *const f32,
    y: *mut f32,
) -> usize {
    // SAFETY: as the caller guarantees; `y` points at row 0, panel `panel`.
    unsafe {
        let sum = block::<INPUTS, P, N>(layer, panel, x);
        for n in 0..N {
            for p in 0..P {
                let value = _mm512_max_ps(sum[n][p], _mm512_setzero_ps());
                _mm512_storeu_ps(y.add(n * layer.width() + p * PANEL), value);
            }
        }
    }
    N
}

#[target_feature(enable = "avx512f")]
pub(super) unsafe fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    // SAFETY: as the caller guarantees.
    unsafe {
        match layer.inputs() {
            128 => max_layer::<ARG, 128>(layer, points, x, first, max, argmax),
            _ => max_layer::<ARG, 0>(layer, points, x, first, max, argmax),
        }
    }
}

#[target_feature(enable = "avx512f")]
unsafe fn max_layer<const ARG: bool, const INPUTS: usize>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    let panels = layer.width() / PANEL;
    // SAFETY: blocks cover panels 0..panels and rows 0..points only; `max`, and `argmax` where
    // `ARG`, hold `panels * PANEL` values.
    unsafe {
        let mut panel = 0;
        while panel < panels {
            let two = panel + 2 <= panels;
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
                n += match (two, points - n) {
                    (true, POINTS..) => {
                        max_block::<ARG, INPUTS, 2, POINTS>(layer, panel, x, row, max, arg)
                    }
                    (true, 4..) => max_block::<ARG, INPUTS, 2, 4>(layer, panel, x, row, max, arg),
                    (true, _) => max_block::<ARG, INPUTS, 2, 1>(layer, panel, x, row, max, arg),
                    (false, _) => max_block::<ARG, INPUTS, 1, 1>(layer, panel, x, row, max, arg),
                };
            }
            panel += if two { 2 } else { 1 };
        }
    }
}

#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn max_block<const ARG: bool, const INPUTS: usize, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    panel: usize,
    x: *const f32,
    row: u32,
    max: *mut f32,
    arg: *mut u32,
) -> usize {
    // SAFETY: as the caller guarantees; `max` and `arg` point at panel `panel`.
    unsafe {
        let sum = block::<INPUTS, P, N>(layer, panel, x);
        for p in 0..P {
            let mut best = _mm512_loadu_ps(max.add(p * PANEL));
            if ARG {
                let mut index = _mm512_loadu_si512(arg.add(p * PANEL).cast());
                for n in 0..N {
                    let higher = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(sum[n][p], best);
                    best = _mm512_mask_mov_ps(best, higher, sum[n][p]);
                    let here = _mm512_set1_epi32((row + n as u32) as i32);
                    index = _mm512_mask_mov_epi32(index, higher, here);
                }
                _mm512_storeu_si512(arg.add(p * PANEL).cast(), index);
            } else {
                for n in 0..N {
                    best = _mm512_max_ps(best, sum[n][p]);
                }
            }
            _mm512_storeu_ps(max.add(p * PANEL), best);
        }
    }
    N
}

#[target_feature(enable = "avx512f")]
pub(super) unsafe fn gemv(layer: &Dense<'_>, start: &[f32], from: usize, x: &[f32], y: &mut [f32]) {
    let panels = layer.width() / PANEL;
    // SAFETY: panels 0..panels of columns from..from + len(x) exist, and `start` and `y` hold
    // `panels * PANEL` values, as the caller guarantees.
    unsafe {
        let mut panel = 0;
        while panel < panels {
            panel += if panel + 8 <= panels {
                gemv_panels::<8>(layer, start, from, x, y, panel)
            } else {
                gemv_panels::<1>(layer, start, from, x, y, panel)
            };
        }
    }
}

#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn gemv_panels<const P: usize>(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
    panel: usize,
) -> usize {
    // SAFETY: as the caller guarantees, for `P` panels from `panel` on.
    unsafe {
        let start = start.as_ptr().add(panel * PANEL);
        let mut sum: [__m512; P] = core::array::from_fn(|p| _mm512_loadu_ps(start.add(p * PANEL)));
        let weights: [*const f32; P] = core::array::from_fn(|p| {
            let column = (panel + p) * layer.inputs() + from;
            layer.panels().as_ptr().add(column * PANEL)
        });
        for (k, &value) in x.iter().enumerate() {
            let value = _mm512_set1_ps(value);
            for p in 0..P {
                let w = _mm512_loadu_ps(weights[p].add(k * PANEL));
                sum[p] = _mm512_fmadd_ps(w, value, sum[p]);
            }
        }
        for p in 0..P {
            _mm512_storeu_ps(y.as_mut_ptr().add((panel + p) * PANEL), sum[p]);
        }
    }
    P
}
