//! Dense layers: blocks of `P` panels by `N` points, whose sums stay in registers.
//!
//! # Safety
//! For every function: as [`Vector`] requires; the layer's arrays have their padded lengths, `x` (and `y`) hold `points` rows,
//! and `max`, `argmax`, `start` and `y` are at least as long as the layer's bias. [`crate::kernels::Isa`] checks it.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::vector::Vector;
use crate::dims::PANEL;
use crate::layer::Dense;

/// Points in the blocks after the last whole one.
const FEW: usize = 4;

/// `start + W x` for `P` panels, whose columns start at `weights`, and `N` rows of `inputs` values at `x`.
#[inline(always)]
unsafe fn block<V: Vector, const P: usize, const N: usize>(
    weights: [*const f32; P],
    start: [V; P],
    inputs: usize,
    x: *const f32,
) -> [[V; P]; N] {
    // SAFETY: the caller guarantees `inputs` columns of each panel, and the rows.
    unsafe {
        let mut sum = [start; N];
        let whole = inputs / V::INPUTS * V::INPUTS;
        let mut k = 0;
        while k < whole {
            let w = load_column::<V, P>(weights, k);
            let mut values = [V::load_inputs(x.add(k)); N];
            for n in 0..N {
                values[n] = V::load_inputs(x.add(n * inputs + k));
                for p in 0..P {
                    sum[n][p] = sum[n][p].add_input::<0>(w[p], values[n]);
                }
            }
            // Unrolled by hand: the compiler must know which of the inputs it is.
            if V::INPUTS == 4 {
                add_column::<V, P, N, 1>(&mut sum, weights, k + 1, values);
                add_column::<V, P, N, 2>(&mut sum, weights, k + 2, values);
                add_column::<V, P, N, 3>(&mut sum, weights, k + 3, values);
            }
            k += V::INPUTS;
        }
        for k in whole..inputs {
            let w = load_column::<V, P>(weights, k);
            for n in 0..N {
                let value = V::splat(*x.add(n * inputs + k));
                for p in 0..P {
                    sum[n][p] = sum[n][p].add_product(w[p], value);
                }
            }
        }
        sum
    }
}

/// Loads column `k` of `P` panels.
#[inline(always)]
pub(super) unsafe fn load_column<V: Vector, const P: usize>(
    weights: [*const f32; P],
    k: usize,
) -> [V; P] {
    // SAFETY: the caller guarantees the column.
    unsafe {
        let mut w = [V::splat(0.0); P];
        for p in 0..P {
            w[p] = V::load(weights[p].add(k * PANEL));
        }
        w
    }
}

/// Adds the products with column `k`: input `WHICH` of those loaded together.
#[inline(always)]
unsafe fn add_column<V: Vector, const P: usize, const N: usize, const WHICH: i32>(
    sum: &mut [[V; P]; N],
    weights: [*const f32; P],
    k: usize,
    values: [V::Inputs; N],
) {
    // SAFETY: as the caller guarantees.
    unsafe {
        let w = load_column::<V, P>(weights, k);
        for n in 0..N {
            for p in 0..P {
                sum[n][p] = sum[n][p].add_input::<WHICH>(w[p], values[n]);
            }
        }
    }
}

/// `b + W x` for `P` panels from `panel` on.
#[inline(always)]
unsafe fn layer_block<V: Vector, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    inputs: usize,
    panel: usize,
    x: *const f32,
) -> [[V; P]; N] {
    // SAFETY: the caller guarantees the panels.
    unsafe {
        let (weights, start) = columns_and_bias(layer, inputs, panel);
        block(weights, start, inputs, x)
    }
}

/// Start of the columns of `P` panels from `panel` on, and their biases.
#[inline(always)]
pub(super) unsafe fn columns_and_bias<V: Vector, const P: usize>(
    layer: &Dense<'_>,
    inputs: usize,
    panel: usize,
) -> ([*const f32; P], [V; P]) {
    let mut weights = [layer.panels().as_ptr(); P];
    // SAFETY: the caller guarantees the panels.
    unsafe {
        let mut start = [V::splat(0.0); P];
        for p in 0..P {
            weights[p] = weights[p].add((panel + p) * inputs * PANEL);
            start[p] = V::load(layer.bias().as_ptr().add((panel + p) * PANEL));
        }
        (weights, start)
    }
}

/// Receives the sums of a layer.
trait Sink<V> {
    /// Receives the sums of `P` panels from `panel` on, for `N` rows from `row` on.
    unsafe fn take<const P: usize, const N: usize>(
        &self,
        panel: usize,
        row: usize,
        sum: [[V; P]; N],
    );
}

/// Computes all sums of a layer. If the compiler knows `inputs`, the distance between rows takes no register.
#[inline(always)]
unsafe fn for_each_block<V: Vector, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    inputs: usize,
    points: usize,
    x: &[f32],
    sink: &impl Sink<V>,
) {
    let panels = layer.width() / PANEL;
    let mut panel = 0;
    while panel < panels {
        let together = panel + P <= panels;
        let mut n = 0;
        while n < points {
            let left = points - n;
            // SAFETY: blocks cover panels 0..panels and rows 0..points only, which the caller guarantees.
            unsafe {
                let x = x.as_ptr().add(n * inputs);
                if !together {
                    sink.take(panel, n, layer_block::<V, 1, 1>(layer, inputs, panel, x));
                    n += 1;
                } else if left >= N {
                    sink.take(panel, n, layer_block::<V, P, N>(layer, inputs, panel, x));
                    n += N;
                } else if left >= FEW {
                    sink.take(panel, n, layer_block::<V, P, FEW>(layer, inputs, panel, x));
                    n += FEW;
                } else {
                    sink.take(panel, n, layer_block::<V, P, 1>(layer, inputs, panel, x));
                    n += 1;
                }
            }
        }
        panel += if together { P } else { 1 };
    }
}

/// Writes sums after a ReLU.
struct Relu {
    y: *mut f32,
    stride: usize,
}

impl<V: Vector> Sink<V> for Relu {
    #[inline(always)]
    unsafe fn take<const P: usize, const N: usize>(
        &self,
        panel: usize,
        row: usize,
        sum: [[V; P]; N],
    ) {
        // SAFETY: the caller guarantees the rows and panels.
        unsafe {
            let y = self.y.add(row * self.stride + panel * PANEL);
            for n in 0..N {
                for p in 0..P {
                    let value = sum[n][p].max(V::splat(0.0));
                    value.store(y.add(n * self.stride + p * PANEL));
                }
            }
        }
    }
}

/// See [`crate::kernels::Isa::dense_relu`].
#[inline(always)]
pub(in crate::kernels) unsafe fn relu<V: Vector, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    y: &mut [f32],
) {
    let relu = Relu {
        y: y.as_mut_ptr(),
        stride: layer.width(),
    };
    // SAFETY: as the caller guarantees.
    unsafe {
        match layer.inputs() {
            3 => for_each_block::<V, P, N>(layer, 3, points, x, &relu),
            64 => for_each_block::<V, P, N>(layer, 64, points, x, &relu),
            inputs => for_each_block::<V, P, N>(layer, inputs, points, x, &relu),
        }
    }
}

/// Raises maxima; with `ARG`, records the rows that raised them.
struct Max<const ARG: bool> {
    max: *mut f32,
    argmax: *mut u32,
    first: u32,
}

impl<V: Vector, const ARG: bool> Sink<V> for Max<ARG> {
    #[inline(always)]
    unsafe fn take<const P: usize, const N: usize>(
        &self,
        panel: usize,
        row: usize,
        sum: [[V; P]; N],
    ) {
        let row = self.first + row as u32;
        for p in 0..P {
            // SAFETY: the caller guarantees the panels; `argmax` is read where `ARG` alone.
            unsafe {
                let max = self.max.add((panel + p) * PANEL);
                let mut best = V::load(max);
                if ARG {
                    let argmax = self.argmax.add((panel + p) * PANEL);
                    let mut rows = V::load_rows(argmax);
                    for n in 0..N {
                        (best, rows) = best.keep_higher(rows, sum[n][p], row + n as u32);
                    }
                    V::store_rows(rows, argmax);
                } else {
                    for n in 0..N {
                        best = best.max(sum[n][p]);
                    }
                }
                best.store(max);
            }
        }
    }
}

/// See [`crate::kernels::Isa::dense_max`], or with `ARG`, [`crate::kernels::Isa::dense_argmax`].
#[inline(always)]
pub(in crate::kernels) unsafe fn max<V: Vector, const ARG: bool, const P: usize, const N: usize>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    let max = Max::<ARG> {
        max: max.as_mut_ptr(),
        argmax: argmax.as_mut_ptr(),
        first,
    };
    // SAFETY: as the caller guarantees.
    unsafe {
        match layer.inputs() {
            64 => for_each_block::<V, P, N>(layer, 64, points, x, &max),
            128 => for_each_block::<V, P, N>(layer, 128, points, x, &max),
            inputs => for_each_block::<V, P, N>(layer, inputs, points, x, &max),
        }
    }
}

/// See [`crate::kernels::Isa::gemv`]; `P` panels at a time.
#[inline(always)]
pub(in crate::kernels) unsafe fn gemv<V: Vector, const P: usize>(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
) {
    let panels = layer.width() / PANEL;
    let mut panel = 0;
    while panel < panels {
        // SAFETY: as the caller guarantees.
        unsafe {
            if panel + P <= panels {
                gemv_panels::<V, P>(layer, start, from, x, y, panel);
                panel += P;
            } else {
                gemv_panels::<V, 1>(layer, start, from, x, y, panel);
                panel += 1;
            }
        }
    }
}

#[inline(always)]
unsafe fn gemv_panels<V: Vector, const P: usize>(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
    panel: usize,
) {
    let mut weights = [layer.panels().as_ptr(); P];
    // SAFETY: columns from..from + len(x) of `P` panels from `panel` on exist, and `start` and `y` hold these panels, as
    // the caller guarantees.
    unsafe {
        let mut sum = [V::splat(0.0); P];
        for p in 0..P {
            weights[p] = weights[p].add(((panel + p) * layer.inputs() + from) * PANEL);
            sum[p] = V::load(start.as_ptr().add((panel + p) * PANEL));
        }
        let [sum] = block::<V, P, 1>(weights, sum, x.len(), x.as_ptr());
        for p in 0..P {
            sum[p].store(y.as_mut_ptr().add((panel + p) * PANEL));
        }
    }
}
