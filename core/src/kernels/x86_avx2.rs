//! AVX2 + FMA kernels: one panel of 16 outputs in two halves, by 6 points in 12 accumulators.
//!
//! The same conditions hold as for the AVX-512 kernels, with AVX2 and FMA detected.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use crate::dims::PANEL;
use crate::layer::Dense;
use core::arch::x86_64::*;

/// Points of one block.
const POINTS: usize = 6;
/// Outputs in one register.
const LANES: usize = 8;

/// `start + W x` for one panel at `weights` and `N` rows of `inputs` values at `x`, `stride` apart.
#[target_feature(enable = "avx2,fma")]
#[inline]
unsafe fn block<const N: usize>(
    weights: *const f32,
    start: *const f32,
    inputs: usize,
    x: *const f32,
) -> [[__m256; 2]; N] {
    // SAFETY: the caller guarantees one panel at `weights`, PANEL values at `start`, `N` rows at `x`.
    unsafe {
        let start = [_mm256_loadu_ps(start), _mm256_loadu_ps(start.add(LANES))];
        let mut sum = [start; N];
        for k in 0..inputs {
            let low = _mm256_loadu_ps(weights.add(k * PANEL));
            let high = _mm256_loadu_ps(weights.add(k * PANEL + LANES));
            for n in 0..N {
                let value = _mm256_set1_ps(*x.add(n * inputs + k));
                sum[n][0] = _mm256_fmadd_ps(low, value, sum[n][0]);
                sum[n][1] = _mm256_fmadd_ps(high, value, sum[n][1]);
            }
        }
        sum
    }
}

#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn dense_relu(layer: &Dense<'_>, points: usize, x: &[f32], y: &mut [f32]) {
    let stride = layer.width();
    // SAFETY: panels and rows stay within what the caller guarantees.
    unsafe {
        for panel in 0..stride / PANEL {
            let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
            let bias = layer.bias().as_ptr().add(panel * PANEL);
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let y = y.as_mut_ptr().add(n * stride + panel * PANEL);
                n += if points - n >= POINTS {
                    relu_rows::<POINTS>(block(weights, bias, layer.inputs(), x), stride, y)
                } else {
                    relu_rows::<1>(block(weights, bias, layer.inputs(), x), stride, y)
                };
            }
        }
    }
}

#[target_feature(enable = "avx2,fma")]
#[inline]
unsafe fn relu_rows<const N: usize>(sum: [[__m256; 2]; N], stride: usize, y: *mut f32) -> usize {
    for (n, halves) in sum.into_iter().enumerate() {
        for (half, value) in halves.into_iter().enumerate() {
            // SAFETY: the caller guarantees `N` rows of `stride` values at `y`.
            unsafe {
                let value = _mm256_max_ps(value, _mm256_setzero_ps());
                _mm256_storeu_ps(y.add(n * stride + half * LANES), value);
            }
        }
    }
    N
}

#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    // SAFETY: panels and rows stay within what the caller guarantees; `argmax` is used where `ARG`.
    unsafe {
        for panel in 0..layer.bias().len() / PANEL {
            let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
            let bias = layer.bias().as_ptr().add(panel * PANEL);
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
                    max_rows::<ARG, POINTS>(block(weights, bias, layer.inputs(), x), row, max, arg)
                } else {
                    max_rows::<ARG, 1>(block(weights, bias, layer.inputs(), x), row, max, arg)
                };
            }
        }
    }
}

#[target_feature(enable = "avx2,fma")]
#[inline]
unsafe fn max_rows<const ARG: bool, const N: usize>(
    sum: [[__m256; 2]; N],
    row: u32,
    max: *mut f32,
    arg: *mut u32,
) -> usize {
    for half in 0..2 {
        // SAFETY: the caller guarantees PANEL values at `max`, and at `arg` where `ARG`.
        unsafe {
            let mut best = _mm256_loadu_ps(max.add(half * LANES));
            if ARG {
                let at = arg.add(half * LANES).cast::<__m256i>();
                let mut index = _mm256_castsi256_ps(_mm256_loadu_si256(at));
                for (n, halves) in sum.iter().enumerate() {
                    let higher = _mm256_cmp_ps::<_CMP_GT_OQ>(halves[half], best);
                    best = _mm256_blendv_ps(best, halves[half], higher);
                    let here = _mm256_set1_epi32((row + n as u32) as i32);
                    index = _mm256_blendv_ps(index, _mm256_castsi256_ps(here), higher);
                }
                _mm256_storeu_si256(at, _mm256_castps_si256(index));
            } else {
                for halves in &sum {
                    best = _mm256_max_ps(best, halves[half]);
                }
            }
            _mm256_storeu_ps(max.add(half * LANES), best);
        }
    }
    N
}

#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn gemv(layer: &Dense<'_>, start: &[f32], from: usize, x: &[f32], y: &mut [f32]) {
    let panels = layer.width() / PANEL;
    // SAFETY: panels 0..panels of columns from..from + len(x) exist, and `start` and `y` hold
    // `panels * PANEL` values, as the caller guarantees.
    unsafe {
        let mut panel = 0;
        while panel < panels {
            panel += if panel + 4 <= panels {
                gemv_panels::<4>(layer, start, from, x, y, panel)
            } else {
                gemv_panels::<1>(layer, start, from, x, y, panel)
            };
        }
    }
}

#[target_feature(enable = "avx2,fma")]
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
        let mut sum = [[_mm256_setzero_ps(); 2]; P];
        let mut weights = [layer.panels().as_ptr(); P];
        for p in 0..P {
            let start = start.as_ptr().add((panel + p) * PANEL);
            sum[p] = [_mm256_loadu_ps(start), _mm256_loadu_ps(start.add(LANES))];
            weights[p] = weights[p].add(((panel + p) * layer.inputs() + from) * PANEL);
        }
        for (k, &value) in x.iter().enumerate() {
            let value = _mm256_set1_ps(value);
            for p in 0..P {
                for half in 0..2 {
                    let w = _mm256_loadu_ps(weights[p].add(k * PANEL + half * LANES));
                    sum[p][half] = _mm256_fmadd_ps(w, value, sum[p][half]);
                }
            }
        }
        for p in 0..P {
            let y = y.as_mut_ptr().add((panel + p) * PANEL);
            _mm256_storeu_ps(y, sum[p][0]);
            _mm256_storeu_ps(y.add(LANES), sum[p][1]);
        }
    }
    P
}
