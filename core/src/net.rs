//! Embedding and policy heads, written once over the kernels of the machine.

use crate::dims::{EMBED, FEATURES, HEAD, LOGITS, PANEL, PANELS_TOGETHER, TILE, padded};
use crate::kernels::{Codes, Isa};
use crate::numbers::Numbers;
use crate::pose::Pose;
use crate::quant::QuantScratch;
use crate::weights::{Dense, Embedding, Head, Network};
use glam::Vec3;

/// A global feature vector, one value a channel; as many as the network has features.
pub type Feature = [f32; FEATURES];

/// Hidden activations of the points embedded together.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// First hidden layer, `[TILE, 64]`.
    hidden1: [f32; TILE * EMBED[0]],
    /// Second hidden layer, `[TILE, 128]`.
    hidden2: [f32; TILE * EMBED[1]],
}

/// Working memory of a network in f32.
#[derive(Clone, Debug)]
pub struct FloatScratch {
    /// For the embedding.
    pub(crate) tiles: Tiles,
    /// Global feature of the cloud embedded last.
    pub(crate) feature: Feature,
    /// First hidden layer of a head.
    head1: [f32; HEAD[0]],
    /// Second hidden layer of a head.
    head2: [f32; HEAD[1]],
}

// The tiles are free while the heads run: the hidden layers of the second way have room there.
const _: () = assert!(TILE * EMBED[1] >= HEAD[0] && TILE * EMBED[0] >= HEAD[1]);

impl FloatScratch {
    fn zero() -> Self {
        FloatScratch {
            tiles: Tiles {
                hidden1: [0.0; TILE * EMBED[0]],
                hidden2: [0.0; TILE * EMBED[1]],
            },
            feature: [0.0; FEATURES],
            head1: [0.0; HEAD[0]],
            head2: [0.0; HEAD[1]],
        }
    }

    /// The source's feature, and a head's hidden layers for either way.
    fn parts(&mut self) -> (&Feature, [[&mut [f32]; 2]; 2]) {
        let Tiles { hidden1, hidden2 } = &mut self.tiles;
        let ways = [
            [&mut self.head1[..], &mut self.head2[..]],
            [&mut hidden2[..], &mut hidden1[..]],
        ];
        (&self.feature, ways)
    }

    /// The critical point of each channel, if [`embed`] has kept them: where the heads come later.
    pub(crate) fn winners(&self) -> &[u16] {
        bytemuck::cast_slice(&self.head1)
    }
}

/// Working memory of one network evaluation; the caller owns it.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// One of the number formats at a time, in the same place.
    memory: Numbers<FloatScratch, QuantScratch>,
    /// Counts the clouds whose embedding has begun here: the memory belongs to the last one.
    generation: u32,
}

impl Scratch {
    /// Zeroed working memory.
    pub const fn new() -> Self {
        Scratch {
            memory: Numbers::Int8(QuantScratch::ZERO),
            generation: 0,
        }
    }

    /// Makes it ready for the first points of a cloud; the new generation.
    pub(crate) fn claim(&mut self, network: &Network<'_>) -> u32 {
        match network {
            Numbers::Int8(_) => self.integers().clear(),
            Numbers::F32(_) => self.floats().feature.fill(f32::NEG_INFINITY),
        }
        self.generation = self.generation.wrapping_add(1);
        self.generation
    }

    /// The generation of the cloud whose embedding began last.
    pub(crate) fn generation(&self) -> u32 {
        self.generation
    }

    /// The memory of a network in f32; zeroed where it was that of another.
    pub(crate) fn floats(&mut self) -> &mut FloatScratch {
        self.memory.floats(FloatScratch::zero)
    }

    /// The memory of a network in integers; zeroed where it was that of another.
    pub(crate) fn integers(&mut self) -> &mut QuantScratch {
        self.memory.integers(|| QuantScratch::ZERO)
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

/// How a stored cloud is seen: `x' = R (x - origin) + t`. A pose and a normalisation are one such
/// map, so no transformed copy of a cloud is ever stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Point that becomes the translation; the cloud's centroid in the disentangled form.
    pub origin: Vec3,
    /// Rotation (times a scale) and translation.
    pub map: Pose,
}

impl View {
    /// The cloud as it is stored.
    pub const IDENTITY: View = View {
        origin: Vec3::ZERO,
        map: Pose::IDENTITY,
    };

    /// Where a stored point appears.
    #[inline(always)]
    pub fn see(&self, point: [f32; 3]) -> [f32; 3] {
        self.map
            .apply(Vec3::from_array(point) - self.origin)
            .to_array()
    }
}

/// Takes points into the global feature: max over points of the pointwise embedding (no ReLU on the last
/// layer). Before the first points of a cloud, the feature is -infinity everywhere. Where the points count from `first`,
/// keeps the critical point of each channel ([`FloatScratch::winners`]).
///
/// # Shapes
/// `points [N, 3]`, as many features as the embedding gives, the rest left alone.
pub(crate) fn embed(
    isa: Isa,
    embedding: &Embedding<'_>,
    points: &[[f32; 3]],
    first: Option<usize>,
    view: &View,
    scratch: &mut FloatScratch,
) {
    let [_, _, last] = &embedding.layers;
    let FloatScratch {
        tiles: Tiles { hidden1, hidden2 },
        feature,
        head1,
        ..
    } = scratch;
    let Some(feature) = feature.get_mut(..last.outputs) else {
        return;
    };
    let winners: &mut [u16] = bytemuck::cast_slice_mut(head1);
    let packed = embedding.packed_for(isa);
    embed_tiles(
        isa,
        &embedding.layers,
        points,
        view,
        [hidden1, hidden2],
        |last, x, at| match (first, &packed) {
            (Some(first), _) => winners_of(isa, last, x, first as u32 + at, feature, winners),
            (None, Some(packed)) => isa.dense_max_packed(packed, x, feature),
            (None, None) => isa.dense_max_near(last, x, feature),
        },
    );
}

/// Takes rows, which count from `first`, into maxima, and keeps where they were raised.
fn winners_of(
    isa: Isa,
    last: &Dense<'_>,
    x: &[f32],
    first: u32,
    feature: &mut [f32],
    winners: &mut [u16],
) {
    for (output, part) in parts(last) {
        let outputs = output..output + part.outputs;
        let (Some(feature), Some(winners)) =
            (feature.get_mut(outputs.clone()), winners.get_mut(outputs))
        else {
            return;
        };
        let mut argmax = [u32::MAX; PANELS_TOGETHER * PANEL];
        isa.dense_argmax(&part, x, first, feature, &mut argmax);
        for (winner, point) in winners.iter_mut().zip(argmax) {
            if point != u32::MAX {
                *winner = point as u16;
            }
        }
    }
}

/// Takes all points of a cloud into the global feature, and keeps for each channel the index of the first point
/// that reaches the maximum (the critical point): the only one through which a gradient flows.
///
/// Any stack of two or more layers, so that a trainer may use other shapes than the deployed one;
/// fewer give the feature of an empty cloud.
///
/// # Shapes
/// `points [N, 3]`, `hidden` twice at least `[TILE, widest hidden layer]` (padded), `feature` and
/// `argmax [F]`, with `F` a multiple of [`crate::dims::PANEL`].
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

/// The last layer as the search for critical points takes it.
#[derive(Clone, Copy, Debug)]
pub struct SearchLayer<'a> {
    /// Its weights in 8 bits, in which the search is made.
    pub codes: Codes<'a>,
    /// Its weights, row-major `[outputs, inputs]`, for the winners.
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
    /// The points that reach them, `[GROUPS, F]`.
    pub winner: &'a mut [u32],
}

/// As [`embed_argmax`], with the critical points searched for in 8 bits and the features of the points
/// found computed in f32: exact features of almost always the right points (see
/// [`Isa::search`]). Features and critical points from the hidden layer on are the same on every kernel.
///
/// Arrays of other lengths than in [`SearchScratch`] give the feature of an empty cloud.
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
    let stride = last.codes.inputs;
    embed_tiles(isa, layers, points, view, hidden, |layer, x, first| {
        let first = first as usize;
        let width = layer.inputs;
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
    isa.winners(layer.inputs, last.rows, layer.bias, kept, winner, feature);
    for (index, &found) in argmax.iter_mut().zip(winner.iter()) {
        *index = found;
    }
}

/// Hidden layers tile by tile, ping-pong between two buffers; `last` gets the last layer, its inputs
/// and the index of the tile's first point.
fn embed_tiles(
    isa: Isa,
    layers: &[Dense<'_>],
    points: &[[f32; 3]],
    view: &View,
    hidden: [&mut [f32]; 2],
    mut last: impl FnMut(&Dense<'_>, &[f32], u32),
) {
    let [first_layer, middle @ .., last_layer] = layers else {
        return;
    };
    let [mut from, mut to] = hidden;
    let mut tile = [[0.0; 3]; TILE];
    let mut first = 0u32;
    for chunk in points.chunks(TILE) {
        let n = chunk.len();
        for (seen, &point) in tile.iter_mut().zip(chunk) {
            *seen = view.see(point);
        }
        let mut width = padded(first_layer.outputs);
        let (Some(x), Some(h)) = (tile.get(..n), from.get_mut(..n * width)) else {
            return;
        };
        isa.dense_relu(first_layer, x.as_flattened(), h);
        for layer in middle {
            let next = padded(layer.outputs);
            let (Some(x), Some(h)) = (from.get(..n * width), to.get_mut(..n * next)) else {
                return;
            };
            isa.dense_relu(layer, x, h);
            core::mem::swap(&mut from, &mut to);
            width = next;
        }
        let Some(x) = from.get(..n * width) else {
            return;
        };
        last(last_layer, x, first);
        first += n as u32;
        if !middle.len().is_multiple_of(2) {
            core::mem::swap(&mut from, &mut to);
        }
    }
}

/// What a target adds to the first layer of a head, bias included; as much of it as the layer has outputs.
pub type TargetHalf = [f32; HEAD[0]];

/// What a target adds to the first layer of a head: `b + W[:, 1024..] φ(Y)`.
pub fn target_half(isa: Isa, head: &Head<'_>, target: &Feature, half: &mut TargetHalf) {
    let [fc1, _, _] = &head.layers;
    let features = fc1.inputs / 2;
    if let Some(target) = target.get(..features) {
        isa.gemv(fc1, fc1.bias, features, target, half);
    }
}

/// One registration in a pass over the weights of a head.
#[derive(Debug)]
pub struct Lane<'a> {
    /// Feature of its target.
    pub target: &'a Feature,
    /// What the target adds to this head, if it is known.
    pub half: Option<&'a TargetHalf>,
    /// Where its source has been embedded.
    pub scratch: &'a mut FloatScratch,
    /// What comes out, axis-major: of (source, target), and of (target, source) if there is a second place.
    pub ways: &'a mut [[f32; LOGITS]],
}

/// Logits of one head for the sources embedded last. Some panels of a layer are taken at a time: their weights come
/// from memory for the first lane and way, and from the cache for the others.
pub fn logits(isa: Isa, head: &Head<'_>, lanes: &mut [Lane<'_>]) {
    let [fc1, fc2, out] = &head.layers;
    let features = fc1.inputs / 2;
    for (first, part) in parts(fc1) {
        for lane in lanes.iter_mut() {
            let (source, hidden) = lane.scratch.parts();
            let outputs = first..first + part.outputs;
            let known = lane.half.and_then(|half| half.get(outputs.clone()));
            let orders = [(source, lane.target, known), (lane.target, source, None)];
            for ((x, y, known), [head1, _]) in orders.into_iter().zip(hidden).take(lane.ways.len())
            {
                let (Some(x), Some(y), Some(head1)) = (
                    x.get(..features),
                    y.get(..features),
                    head1.get_mut(outputs.clone()),
                ) else {
                    continue;
                };
                let mut start = [0.0; PANELS_TOGETHER * PANEL];
                let start = known.unwrap_or_else(|| {
                    isa.gemv(&part, part.bias, features, y, &mut start);
                    &start
                });
                isa.gemv(&part, start, 0, x, head1);
                relu(head1);
            }
        }
    }
    for (first, part) in parts(fc2) {
        for lane in lanes.iter_mut() {
            let (_, hidden) = lane.scratch.parts();
            for [head1, head2] in hidden.into_iter().take(lane.ways.len()) {
                let (Some(x), Some(head2)) = (
                    head1.get(..fc2.inputs),
                    head2.get_mut(first..first + part.outputs),
                ) else {
                    continue;
                };
                isa.gemv(&part, part.bias, 0, x, head2);
                relu(head2);
            }
        }
    }
    for lane in lanes {
        let (_, hidden) = lane.scratch.parts();
        for (logits, [_, head2]) in lane.ways.iter_mut().zip(hidden) {
            let mut padded_logits = [0.0; padded(LOGITS)];
            if let Some(x) = head2.get(..out.inputs) {
                isa.gemv(out, out.bias, 0, x, &mut padded_logits);
            }
            for (logit, value) in logits.iter_mut().zip(padded_logits) {
                *logit = value;
            }
        }
    }
}

/// Some panels of a layer at a time, each part with its first output.
fn parts<'a>(layer: &Dense<'a>) -> impl Iterator<Item = (usize, Dense<'a>)> {
    let inputs = layer.inputs;
    let outputs = PANELS_TOGETHER * PANEL;
    let panels = layer.panels.chunks((inputs * outputs).max(1));
    let parts = panels.zip(layer.bias.chunks(outputs));
    parts.enumerate().map(move |(i, (panels, bias))| {
        let part = Dense {
            inputs,
            outputs: bias.len(),
            panels,
            bias,
        };
        (i * outputs, part)
    })
}

fn relu(values: &mut [f32]) {
    for v in values {
        *v = v.max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::pack_panels;

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
                let mut y = vec![0.0; points.len() * layer.outputs];
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
