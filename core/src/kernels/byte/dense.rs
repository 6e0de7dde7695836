//! Dense layers of codes: blocks of `P` panels by `N` points, whose sums stay in registers.
//!
//! # Safety
//! For every function: as [`Sums`] requires; panels must be the layer's,
//! and slices must have the lengths that [`crate::kernels::Isa`] checks.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::vector::Sums;
use crate::dims::{PANEL, QUAD};
use crate::kernels::byte::portable::{ROW_BITS, row_mark};
use crate::layer::Codes;
use core::ops::Range;

/// Points in the blocks after the last whole one; panels, in products with a single vector.
const FEW: usize = 4;

/// Sums of `P` panels, whose columns start at `weights`, with `N` rows of `inputs` codes, which `row` locates.
#[inline(always)]
pub(super) unsafe fn sums<V: Sums, const P: usize, const N: usize, const EIGHT: bool>(
    inputs: usize,
    weights: [*const i8; P],
    row: impl Fn(usize) -> *const u8,
) -> [[V; P]; N] {
    // SAFETY: the caller guarantees `inputs` columns of each panel and as many codes of each row, whole groups of four.
    unsafe {
        let mut sum = [[V::zero(); P]; N];
        let whole = if V::BY_SIXTEEN { inputs / 16 * 16 } else { 0 };
        for k in (0..whole).step_by(16) {
            let mut x = [V::load_sixteen::<EIGHT>(row(0).add(k)); N];
            for n in 1..N {
                x[n] = V::load_sixteen::<EIGHT>(row(n).add(k));
            }
            // Unrolled by hand: the compiler must know which group it is.
            add_quad::<V, P, N, 0>(&mut sum, weights, k, |n| x[n]);
            add_quad::<V, P, N, 1>(&mut sum, weights, k + QUAD, |n| x[n]);
            add_quad::<V, P, N, 2>(&mut sum, weights, k + 2 * QUAD, |n| x[n]);
            add_quad::<V, P, N, 3>(&mut sum, weights, k + 3 * QUAD, |n| x[n]);
        }
        for k in (whole..inputs).step_by(QUAD) {
            add_quad::<V, P, N, 0>(&mut sum, weights, k, |n| {
                V::load_four::<EIGHT>(row(n).add(k))
            });
        }
        let mut total = [[V::splat(0); P]; N];
        for n in 0..N {
            for p in 0..P {
                total[n][p] = V::total(sum[n][p]);
            }
        }
        total
    }
}

/// Adds the products with inputs `k` to `k + 3`: group `WHICH` of the loaded codes `x` of each row.
#[inline(always)]
unsafe fn add_quad<V: Sums, const P: usize, const N: usize, const WHICH: i32>(
    sum: &mut [[V::Partial; P]; N],
    weights: [*const i8; P],
    k: usize,
    x: impl Fn(usize) -> V::Codes,
) {
    // SAFETY: as the caller guarantees.
    unsafe {
        let mut w = [V::load_weights(weights[0].add(k * PANEL)); P];
        for p in 1..P {
            w[p] = V::load_weights(weights[p].add(k * PANEL));
        }
        for n in 0..N {
            let x = x(n);
            for p in 0..P {
                sum[n][p] = V::add_products::<WHICH>(sum[n][p], w[p], x);
            }
        }
    }
}

/// Start of a panel's columns.
#[inline(always)]
unsafe fn weights_of(layer: &Codes<'_>, panel: usize) -> *const i8 {
    let weights = layer.panels().as_ptr();
    // SAFETY: the caller guarantees the panel.
    unsafe { weights.add(panel * layer.inputs() * PANEL) }
}

/// Sums of `P` panels from `panel` on with `N` rows at `x`.
#[inline(always)]
pub(super) unsafe fn layer_sums<V: Sums, const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    x: *const u8,
) -> [[V; P]; N] {
    let inputs = layer.inputs();
    let mut weights = [layer.panels().as_ptr(); P];
    // SAFETY: the caller guarantees the panels and rows.
    unsafe {
        for p in 0..P {
            weights[p] = weights_of(layer, panel + p);
        }
        sums::<V, P, N, true>(inputs, weights, |n| x.add(n * inputs))
    }
}

/// See [`crate::kernels::byte::portable::dense_codes_max`]; `first` is the number of the first row.
#[inline(always)]
pub(in crate::kernels) unsafe fn max<V: Sums, const MARK: bool, const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    first: usize,
    max: &mut [i32],
) {
    let points = x.len() / layer.inputs();
    if points == 0 {
        return;
    }
    let (x, max) = (x.as_ptr(), max.as_mut_ptr());
    let mut panel = panels.start;
    while panel < panels.end {
        // SAFETY: these panels are asked for.
        panel += unsafe {
            if panel + P <= panels.end {
                max_of_panels::<V, MARK, P, N>(layer, panel, points, x, first, max)
            } else {
                max_of_panels::<V, MARK, 1, 1>(layer, panel, points, x, first, max)
            }
        };
    }
}

#[inline(always)]
unsafe fn max_of_panels<V: Sums, const MARK: bool, const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    points: usize,
    x: *const u8,
    first: usize,
    max: *mut i32,
) -> usize {
    // SAFETY: blocks cover `P` panels from `panel` on, and the points at `x`.
    unsafe {
        let mut best = [V::splat(i32::MIN); P];
        let mut n = 0;
        while n < points {
            let x = x.add(n * layer.inputs());
            let row = first + n;
            n += match points - n {
                left if left >= N => raise::<V, MARK, P, N>(layer, panel, x, row, &mut best),
                FEW.. => raise::<V, MARK, P, FEW>(layer, panel, x, row, &mut best),
                _ => raise::<V, MARK, P, 1>(layer, panel, x, row, &mut best),
            };
        }
        for p in 0..P {
            let mut sign_correction =
                V::sign_correction(layer.inputs(), weights_of(layer, panel + p));
            if MARK {
                sign_correction = sign_correction.shift_left::<{ ROW_BITS as i32 }>();
            }
            let max = max.add((panel + p) * PANEL);
            best[p].add(sign_correction).max(V::load(max)).store(max);
        }
    }
    P
}

/// Raises the maxima of `P` panels to the sums of the `N` rows at `x`, numbered from `row`.
#[inline(always)]
unsafe fn raise<V: Sums, const MARK: bool, const P: usize, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    x: *const u8,
    row: usize,
    best: &mut [V; P],
) -> usize {
    // SAFETY: the caller guarantees the panels and rows.
    unsafe {
        let sums = layer_sums::<V, P, N>(layer, panel, x);
        for p in 0..P {
            for n in 0..N {
                best[p] = best[p].max(marked::<V, MARK>(sums[n][p], row + n));
            }
        }
    }
    N
}

/// See [`crate::kernels::byte::portable::marked`].
#[inline(always)]
pub(in crate::kernels) unsafe fn marked<V: Sums, const MARK: bool>(sum: V, row: usize) -> V {
    if !MARK {
        return sum;
    }
    // SAFETY: as the caller guarantees.
    unsafe {
        let shifted = sum.shift_left::<{ ROW_BITS as i32 }>();
        shifted.add(V::splat(row_mark(row)))
    }
}

/// See [`crate::kernels::byte::portable::dense_codes`].
#[inline(always)]
pub(in crate::kernels) unsafe fn codes<V: Sums, const N: usize>(
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
            let sign_correction = V::sign_correction(layer.inputs(), weights_of(layer, panel));
            let start = V::load(bias.as_ptr().add(panel * PANEL)).add(sign_correction);
            let requantise = V::load(requantise.as_ptr().add(panel * PANEL).cast());
            let mut n = 0;
            while n < points {
                let x = x.as_ptr().add(n * layer.inputs());
                let y = y.as_mut_ptr().add(n * layer.outputs() + panel * PANEL);
                n += match points - n {
                    left if left >= N => put::<V, N>(layer, panel, start, requantise, x, y),
                    FEW.. => put::<V, FEW>(layer, panel, start, requantise, x, y),
                    _ => put::<V, 1>(layer, panel, start, requantise, x, y),
                };
            }
        }
    }
}

/// Writes the codes of one panel and `N` rows.
#[inline(always)]
unsafe fn put<V: Sums, const N: usize>(
    layer: &Codes<'_>,
    panel: usize,
    start: V,
    requantise: V,
    x: *const u8,
    y: *mut u8,
) -> usize {
    // SAFETY: the caller guarantees the rows.
    unsafe {
        let sums = layer_sums::<V, 1, N>(layer, panel, x);
        for n in 0..N {
            let sum = sums[n][0].add(start);
            sum.store_codes(requantise, y.add(n * layer.outputs()));
        }
    }
    N
}

/// See [`crate::kernels::byte::portable::gemv_codes`]; `P` panels at a time.
#[inline(always)]
pub(in crate::kernels) unsafe fn gemv<V: Sums, const P: usize>(
    layer: &Codes<'_>,
    columns: Range<usize>,
    planes: [&[u8]; 2],
    y: &mut [i32],
) {
    let panels = layer.outputs() / PANEL;
    let mut panel = 0;
    while panel < panels {
        // SAFETY: these panels are there.
        panel += unsafe {
            match panels - panel {
                left if left >= P => gemv_panels::<V, P>(layer, &columns, planes, y, panel),
                FEW.. => gemv_panels::<V, FEW>(layer, &columns, planes, y, panel),
                _ => gemv_panels::<V, 1>(layer, &columns, planes, y, panel),
            }
        };
    }
}

#[inline(always)]
unsafe fn gemv_panels<V: Sums, const P: usize>(
    layer: &Codes<'_>,
    columns: &Range<usize>,
    planes: [&[u8]; 2],
    y: &mut [i32],
    panel: usize,
) -> usize {
    let mut weights = [layer.panels().as_ptr(); P];
    // SAFETY: the caller guarantees `P` panels from `panel` on, in `y` too, and planes as long as `columns`, which exist.
    unsafe {
        for p in 0..P {
            weights[p] = weights_of(layer, panel + p).add(columns.start * PANEL);
        }
        let row = |n: usize| planes[n].as_ptr();
        let [high, low] = sums::<V, P, 2, false>(columns.len(), weights, row);
        for p in 0..P {
            let y = y.as_mut_ptr().add((panel + p) * PANEL);
            let sum = high[p].shift_left::<6>().add(low[p]);
            sum.add(V::load(y)).store(y);
        }
    }
    P
}
