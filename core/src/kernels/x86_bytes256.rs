//! Integer layers and the int8 search in 256-bit registers, 16 outputs by 4 points, written once for two
//! dot products of four bytes: AVX-VNNI's, and one that AVX2 puts together from products of 16 bits.
//!
//! The same conditions hold as for the AVX-512 kernels.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use core::arch::x86_64::*;

/// Outputs in one register.
const LANES: usize = 8;

/// `sum + Σ x w` over four bytes a lane, `x` unsigned, without saturation.
#[target_feature(enable = "avx2")]
#[inline]
fn dot_avx2(sum: __m256i, x: __m256i, w: __m256i) -> __m256i {
    let even_x = _mm256_and_si256(x, _mm256_set1_epi16(0xff));
    let even_w = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(w));
    let odd_x = _mm256_srli_epi16::<8>(x);
    let odd_w = _mm256_srai_epi16::<8>(w);
    let sum = _mm256_add_epi32(sum, _mm256_madd_epi16(even_x, even_w));
    _mm256_add_epi32(sum, _mm256_madd_epi16(odd_x, odd_w))
}

#[target_feature(enable = "avx2,avxvnni")]
#[inline]
fn dot_avx_vnni(sum: __m256i, x: __m256i, w: __m256i) -> __m256i {
    _mm256_dpbusd_avx_epi32(sum, x, w)
}

macro_rules! kernels {
    ($module:ident, $features:literal, $dot:ident) => {
        pub(super) mod $module {
            use super::super::bytes::{ROW_BITS, row_mark};
            use super::super::search::{GROUPS, NONE, PLACE, PanelBest, merge};
            use super::{LANES, $dot};
            use crate::dims::PANEL;
            use crate::layer::Codes;
            use crate::layer::Requantise;
            use core::arch::x86_64::*;
            use core::ops::Range;

            /// Bytes of one group of four inputs in a panel.
            const QUAD: usize = 4 * PANEL;
            /// Points of one block.
            const POINTS: usize = 4;

            /// Sums of one panel at `weights` and `N` rows at `x`.
            #[target_feature(enable = $features)]
            #[inline]
            unsafe fn sums<const N: usize>(
                inputs: usize,
                weights: *const i8,
                x: *const u8,
            ) -> [[__m256i; 2]; N] {
                // SAFETY: the caller guarantees one panel at `weights` and `N` rows at `x`.
                unsafe {
                    let mut sum = [[_mm256_setzero_si256(); 2]; N];
                    for k in 0..inputs / 4 {
                        let w: [__m256i; 2] = core::array::from_fn(|half| {
                            _mm256_loadu_si256(weights.add(k * QUAD + half * QUAD / 2).cast())
                        });
                        for n in 0..N {
                            let quad = x.add(n * inputs + 4 * k).cast::<i32>();
                            let quad = _mm256_set1_epi32(quad.read_unaligned());
                            for half in 0..2 {
                                sum[n][half] = $dot(sum[n][half], quad, w[half]);
                            }
                        }
                    }
                    sum
                }
            }

            /// As [`super::super::search::portable`].
            #[target_feature(enable = $features)]
            #[allow(clippy::too_many_arguments)]
            pub(in super::super) unsafe fn search(
                layer: &Codes<'_>,
                points: Range<usize>,
                panels: Range<usize>,
                codes: &[u8],
                scales: &[f32],
                best: &mut [f32],
                winner: &mut [u32],
            ) {
                // SAFETY: blocks cover the given panels and points only.
                unsafe {
                    for panel in panels {
                        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
                        let mut tile = NONE;
                        let mut n = points.start;
                        while n < points.end {
                            let x = codes.as_ptr().add(n * layer.inputs());
                            let scales = scales.as_ptr().add(n);
                            let place = n - points.start;
                            n += if points.end - n >= POINTS {
                                let sum = sums::<POINTS>(layer.inputs(), weights, x);
                                take(sum, n, place, scales, &mut tile)
                            } else {
                                let sum = sums::<1>(layer.inputs(), weights, x);
                                take(sum, n, place, scales, &mut tile)
                            };
                        }
                        merge(&tile, points.start, panel, layer.outputs(), best, winner);
                    }
                }
            }

            #[target_feature(enable = $features)]
            #[inline]
            unsafe fn take<const N: usize>(
                sum: [[__m256i; 2]; N],
                first: usize,
                place: usize,
                scales: *const f32,
                best: &mut PanelBest,
            ) -> usize {
                let kept = _mm256_castsi256_ps(_mm256_set1_epi32(!PLACE as i32));
                for n in 0..N {
                    let place = _mm256_castsi256_ps(_mm256_set1_epi32((place + n) as i32));
                    let best = best[(first + n) % GROUPS].as_mut_ptr();
                    // SAFETY: the caller guarantees `N` scales; `best` holds one panel.
                    unsafe {
                        let scale = _mm256_set1_ps(*scales.add(n));
                        for half in 0..2 {
                            let best = best.add(half * LANES);
                            let score = _mm256_mul_ps(_mm256_cvtepi32_ps(sum[n][half]), scale);
                            let score = _mm256_or_ps(_mm256_and_ps(score, kept), place);
                            _mm256_storeu_ps(best, _mm256_max_ps(score, _mm256_loadu_ps(best)));
                        }
                    }
                }
                N
            }

            /// As [`super::super::bytes::dense_codes_max`].
            #[target_feature(enable = $features)]
            pub(in super::super) unsafe fn dense_codes_max<const MARK: bool>(
                layer: &Codes<'_>,
                panels: Range<usize>,
                x: &[u8],
                max: &mut [i32],
            ) {
                let points = x.len() / layer.inputs();
                // SAFETY: blocks cover the given panels and whole rows of `x` only.
                unsafe {
                    for panel in panels {
                        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
                        let max = max.as_mut_ptr().add(panel * PANEL);
                        let mut n = 0;
                        while n < points {
                            let x = x.as_ptr().add(n * layer.inputs());
                            n += if points - n >= POINTS {
                                let sum = sums::<POINTS>(layer.inputs(), weights, x);
                                raise::<_, MARK>(sum, n, max)
                            } else {
                                let sum = sums::<1>(layer.inputs(), weights, x);
                                raise::<_, MARK>(sum, n, max)
                            };
                        }
                    }
                }
            }

            #[target_feature(enable = $features)]
            #[inline]
            unsafe fn raise<const N: usize, const MARK: bool>(
                sum: [[__m256i; 2]; N],
                first: usize,
                max: *mut i32,
            ) -> usize {
                for half in 0..2 {
                    // SAFETY: the caller guarantees one panel at `max`.
                    unsafe {
                        let max = max.add(half * LANES).cast::<__m256i>();
                        let mut best = _mm256_loadu_si256(max);
                        for (n, halves) in sum.iter().enumerate() {
                            let mut sum = halves[half];
                            if MARK {
                                let mark = _mm256_set1_epi32(row_mark(first + n));
                                let shifted = _mm256_slli_epi32::<{ ROW_BITS as i32 }>(sum);
                                sum = _mm256_or_si256(shifted, mark);
                            }
                            best = _mm256_max_epi32(best, sum);
                        }
                        _mm256_storeu_si256(max, best);
                    }
                }
                N
            }

            /// As [`super::super::bytes::dense_codes`].
            #[target_feature(enable = $features)]
            pub(in super::super) unsafe fn dense_codes(
                layer: &Codes<'_>,
                bias: &[i32],
                requantise: &[u32],
                x: &[u8],
                y: &mut [u8],
            ) {
                let points = (x.len() / layer.inputs()).min(y.len() / layer.outputs());
                // SAFETY: blocks cover whole panels and whole rows of `x` and `y` only.
                unsafe {
                    for panel in 0..layer.outputs() / PANEL {
                        let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
                        let bias = &bias[panel * PANEL..(panel + 1) * PANEL];
                        let factors = &requantise[panel * PANEL..(panel + 1) * PANEL];
                        let mut n = 0;
                        while n < points {
                            let x = x.as_ptr().add(n * layer.inputs());
                            let y = &mut y[n * layer.outputs() + panel * PANEL..];
                            n += if points - n >= POINTS {
                                let sum = sums::<POINTS>(layer.inputs(), weights, x);
                                put(layer.outputs(), sum, bias, factors, y)
                            } else {
                                let sum = sums::<1>(layer.inputs(), weights, x);
                                put(layer.outputs(), sum, bias, factors, y)
                            };
                        }
                    }
                }
            }

            #[target_feature(enable = $features)]
            #[inline]
            fn put<const N: usize>(
                outputs: usize,
                sum: [[__m256i; 2]; N],
                bias: &[i32],
                factors: &[u32],
                y: &mut [u8],
            ) -> usize {
                for (n, halves) in sum.into_iter().enumerate() {
                    let mut sums = [0i32; PANEL];
                    // SAFETY: two registers fill the panel.
                    unsafe {
                        _mm256_storeu_si256(sums.as_mut_ptr().cast(), halves[0]);
                        _mm256_storeu_si256(sums.as_mut_ptr().add(LANES).cast(), halves[1]);
                    }
                    let y = &mut y[n * outputs..n * outputs + PANEL];
                    for (((y, s), b), r) in y.iter_mut().zip(sums).zip(bias).zip(factors) {
                        *y = Requantise(*r).apply_32(s + b, 255) as u8;
                    }
                }
                N
            }

            /// As [`super::super::bytes::gemv_codes`].
            #[target_feature(enable = $features)]
            pub(in super::super) unsafe fn gemv_codes(
                layer: &Codes<'_>,
                columns: Range<usize>,
                [high, low]: [&[u8]; 2],
                y: &mut [i32],
            ) {
                let inputs = columns.len();
                for (panel, y) in y.as_chunks_mut::<PANEL>().0.iter_mut().enumerate() {
                    // SAFETY: the caller guarantees panels of `layer.inputs()` columns, which hold
                    // `columns`, and planes as long as those.
                    unsafe {
                        let at = (panel * layer.inputs() + columns.start) * PANEL;
                        let weights = layer.panels().as_ptr().add(at);
                        let [high] = sums::<1>(inputs, weights, high.as_ptr());
                        let [low] = sums::<1>(inputs, weights, low.as_ptr());
                        for half in 0..2 {
                            let y = y.as_mut_ptr().add(half * LANES).cast::<__m256i>();
                            let sum = _mm256_slli_epi32::<6>(high[half]);
                            let sum = _mm256_add_epi32(sum, low[half]);
                            let sum = _mm256_add_epi32(sum, _mm256_loadu_si256(y));
                            _mm256_storeu_si256(y, sum);
                        }
                    }
                }
            }
        }
    };
}

kernels!(avx2, "avx2", dot_avx2);
kernels!(avx_vnni, "avx2,avxvnni", dot_avx_vnni);
