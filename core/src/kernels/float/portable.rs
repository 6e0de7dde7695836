//! Plain Rust kernels: the reference for all other kernels.

use crate::dims::PANEL;
use crate::layer::Dense;

type Lanes = [f32; PANEL];

/// `b + W x` for one panel of outputs and one row of inputs.
#[inline(always)]
fn panel_product(panel: &[f32], start: &[f32], x: &[f32]) -> Lanes {
    let mut sum = [0.0; PANEL];
    for (s, &b) in sum.iter_mut().zip(start) {
        *s = b;
    }
    for (&x, weights) in x.iter().zip(panel.chunks_exact(PANEL)) {
        for (s, &w) in sum.iter_mut().zip(weights) {
            *s += w * x;
        }
    }
    sum
}

pub(in crate::kernels) fn dense_relu(layer: &Dense<'_>, points: usize, x: &[f32], y: &mut [f32]) {
    let panel_len = (layer.inputs() * PANEL).max(1);
    let rows = x.chunks_exact(layer.inputs().max(1)).take(points);
    for (x, y) in rows.zip(y.chunks_exact_mut(layer.width().max(1))) {
        let panels = layer.panels().chunks_exact(panel_len);
        let outputs = y.chunks_exact_mut(PANEL);
        for ((panel, bias), y) in panels.zip(layer.bias().chunks_exact(PANEL)).zip(outputs) {
            let sum = panel_product(panel, bias, x);
            for (y, s) in y.iter_mut().zip(sum) {
                *y = s.max(0.0);
            }
        }
    }
}

pub(in crate::kernels) fn dense_max<const ARG: bool>(
    layer: &Dense<'_>,
    points: usize,
    x: &[f32],
    first: u32,
    max: &mut [f32],
    argmax: &mut [u32],
) {
    let panel_len = (layer.inputs() * PANEL).max(1);
    let panels = layer.panels().chunks_exact(panel_len);
    for (p, (panel, bias)) in panels.zip(layer.bias().chunks_exact(PANEL)).enumerate() {
        let Some(max) = max.get_mut(p * PANEL..(p + 1) * PANEL) else {
            return;
        };
        for (row, x) in x
            .chunks_exact(layer.inputs().max(1))
            .take(points)
            .enumerate()
        {
            let sum = panel_product(panel, bias, x);
            for (lane, (m, s)) in max.iter_mut().zip(sum).enumerate() {
                if s > *m {
                    *m = s;
                    if ARG && let Some(index) = argmax.get_mut(p * PANEL + lane) {
                        *index = first + row as u32;
                    }
                }
            }
        }
    }
}

pub(in crate::kernels) fn gemv(
    layer: &Dense<'_>,
    start: &[f32],
    from: usize,
    x: &[f32],
    y: &mut [f32],
) {
    let panel_len = (layer.inputs() * PANEL).max(1);
    let panels = layer.panels().chunks_exact(panel_len);
    let outputs = y.chunks_exact_mut(PANEL);
    for ((panel, start), y) in panels.zip(start.chunks_exact(PANEL)).zip(outputs) {
        let columns = panel.get(from * PANEL..).unwrap_or(&[]);
        let sum = panel_product(columns, start, x);
        for (y, s) in y.iter_mut().zip(sum) {
            *y = s;
        }
    }
}
