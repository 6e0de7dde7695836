//! The embedding for a trainer, with the critical point of each channel, through which gradients flow.

use super::embed_tiles;
use crate::kernels::Isa;
use crate::layer::{Codes, Dense};
use crate::view::View;

/// Embeds all points of a cloud into the global feature, and gives for each channel the index of the first point that reaches
/// the maximum (the critical point): the only one through which a gradient flows.
///
/// Takes any stack of two or more layers, so that a trainer may use other shapes than the deployed one. Fewer layers give the
/// feature of an empty cloud.
///
/// # Shapes
/// `points [N, 3]`; each `hidden` at least `[TILE, widest hidden layer]` (padded); `feature` and `argmax [F]`, with `F` a
/// multiple of [`crate::dims::PANEL`].
pub fn embed_argmax(
    isa: Isa,
    layers: &[Dense<'_>],
    points: &[[f32; 3]],
    view: &View,
    hidden: [&mut [f32]; 2],
    feature: &mut [f32],
    argmax: &mut [u32],
) {
    feature.fill(f32::NEG_INFINITY);
    argmax.fill(0);
    embed_tiles(isa, layers, points, view, hidden, |last, x, first| {
        isa.dense_argmax(last, x, first, feature, argmax);
    });
}

/// The last layer in the form that the search for critical points needs.
#[derive(Clone, Copy, Debug)]
pub struct SearchLayer<'a> {
    /// The weights in 8 bits, for the search.
    pub codes: Codes<'a>,
    /// The weights in f32, row-major `[outputs, inputs]`, for the winners.
    pub rows: &'a [f32],
}

/// Working memory of [`embed_search`] for `N` points, a last hidden layer of width `H` and `F`
/// features.
#[derive(Debug)]
pub struct SearchScratch<'a> {
    /// As in [`embed_argmax`].
    pub hidden: [&'a mut [f32]; 2],
    /// Last hidden layer, `[N, H]`.
    pub kept: &'a mut [f32],
    /// The same in 8 bits, `[N, padded_codes(H)]`.
    pub codes: &'a mut [u8],
    /// Scale of each row of codes, `[N]`.
    pub scales: &'a mut [f32],
    /// Highest scores, `[GROUPS, F]`.
    pub best: &'a mut [f32],
    /// The points that reach these scores, `[GROUPS, F]`.
    pub winner: &'a mut [u32],
}

/// As [`embed_argmax`], but searches for the critical points in 8 bits and computes the features of the points found in f32:
/// exact features of almost always the right points (see [`Isa::search`]). From the hidden layer on, features and critical
/// points are the same on every kernel.
///
/// Arrays of other lengths than [`SearchScratch`] states give the feature of an empty cloud.
#[allow(clippy::too_many_arguments)]
pub fn embed_search(
    isa: Isa,
    layers: &[Dense<'_>],
    last: &SearchLayer<'_>,
    points: &[[f32; 3]],
    view: &View,
    scratch: SearchScratch<'_>,
    feature: &mut [f32],
    argmax: &mut [u32],
) {
    feature.fill(f32::NEG_INFINITY);
    argmax.fill(0);
    let SearchScratch {
        hidden,
        kept,
        codes,
        scales,
        best,
        winner,
    } = scratch;
    let stride = last.codes.inputs();
    embed_tiles(isa, layers, points, view, hidden, |layer, x, first| {
        let first = first as usize;
        let width = layer.inputs();
        let n = x.len() / width.max(1);
        let (Some(kept), Some(codes), Some(scales)) = (
            kept.get_mut(first * width..(first + n) * width),
            codes.get_mut(first * stride..(first + n) * stride),
            scales.get_mut(first..first + n),
        ) else {
            return;
        };
        kept.copy_from_slice(x);
        isa.quantise_rows(width, x, codes, scales);
    });
    let Some(layer) = layers.last() else { return };
    isa.search(&last.codes, codes, scales, best, winner);
    isa.winners(
        layer.inputs(),
        last.rows,
        layer.bias(),
        kept,
        winner,
        feature,
    );
    for (index, &found) in argmax.iter_mut().zip(winner.iter()) {
        *index = found;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dims::TILE;
    use crate::layer::pack_panels;

    fn numbers(n: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        let next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        core::iter::repeat_with(next).take(n).collect()
    }

    #[test]
    fn stacks_of_any_depth_are_embedded_layer_by_layer() {
        let points: Vec<[f32; 3]> = numbers(300, 1).as_chunks().0.to_vec();
        for widths in [&[16][..], &[32, 48], &[16, 64, 32], &[64, 16, 32, 48]] {
            let mut inputs = 3;
            let mut arrays = Vec::new();
            for (i, &outputs) in widths.iter().chain(&[80]).enumerate() {
                let matrix = numbers(inputs * outputs, 2 + i as u32);
                let mut panels = vec![0.0; matrix.len()];
                pack_panels(inputs, outputs, &matrix, &mut panels);
                arrays.push((inputs, outputs, panels, numbers(outputs, 20 + i as u32)));
                inputs = outputs;
            }
            let layers: Vec<Dense<'_>> = arrays
                .iter()
                .map(|(i, o, panels, bias)| Dense::new(*i, *o, panels, bias).expect("whole panels"))
                .collect();

            let mut x = points.as_flattened().to_vec();
            let (last, hidden) = layers.split_last().expect("layers");
            for layer in hidden {
                let mut y = vec![0.0; points.len() * layer.outputs()];
                Isa::PORTABLE.dense_relu(layer, &x, &mut y);
                x = y;
            }
            let (mut expected, mut winners) = ([f32::NEG_INFINITY; 80], [0; 80]);
            Isa::PORTABLE.dense_argmax(last, &x, 0, &mut expected, &mut winners);

            let mut buffers = [vec![0.0; TILE * 64], vec![0.0; TILE * 64]];
            let buffers = buffers.each_mut().map(Vec::as_mut_slice);
            let (mut feature, mut argmax) = ([0.0; 80], [0; 80]);
            embed_argmax(
                Isa::PORTABLE,
                &layers,
                &points,
                &View::IDENTITY,
                buffers,
                &mut feature,
                &mut argmax,
            );
            assert_eq!((feature, argmax), (expected, winners), "{widths:?}");
        }
    }
}
