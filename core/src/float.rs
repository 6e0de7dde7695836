//! The network in f32 (number format 0), written once on top of the machine's kernels.

mod critical;
mod heads;

use crate::dims::{EMBED, FEATURES, HEAD, PANEL, PANELS_TOGETHER, TILE, padded};
use crate::kernels::{Isa, PackedDense};
use crate::layer::Dense;
use crate::view::View;

pub use critical::{SearchLayer, SearchScratch, embed_argmax, embed_search};
pub use heads::{HeadInput, TargetHalf, logits, target_half};

/// The pointwise embedding, in the paper 3 -> 64 -> 128 -> 1024, with ReLU after the first two layers only.
#[derive(Clone, Copy, Debug)]
pub struct Embedding<'a> {
    /// The three layers.
    pub layers: [Dense<'a>; 3],
    /// The last layer packed, if the caller gave memory for it ([`crate::Policy::with_packed`]).
    pub packed: Option<PackedDense<'a>>,
}

impl<'a> Embedding<'a> {
    /// The packed last layer, if it is faster on these kernels.
    pub(crate) fn packed_for(&self, isa: Isa) -> Option<PackedDense<'a>> {
        self.packed.filter(|packed| packed.is_fast(isa))
    }

    /// Whether it runs faster on an ordered cloud ([`Isa::dense_max_near`]).
    pub(crate) fn prunes(&self, isa: Isa) -> bool {
        let split = matches!(self.packed_for(isa), Some(PackedDense::Split(_)));
        isa.prunes_floats() && !split
    }
}

/// One policy head, in the paper 2048 -> 512 -> 256 -> 33, with ReLU after the first two layers only.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// The three layers.
    pub layers: [Dense<'a>; 3],
}

/// The network in number format 0.
#[derive(Clone, Copy, Debug)]
pub struct FloatNetwork<'a> {
    /// Cloud to global feature.
    pub embedding: Embedding<'a>,
    /// State to translation logits.
    pub translation: Head<'a>,
    /// State to rotation logits.
    pub rotation: Head<'a>,
}

/// A global feature vector, one value for each channel; a smaller network fills only the first channels.
pub type Feature = [f32; FEATURES];

/// Hidden activations of the points that are embedded together.
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

// While the heads run, the tiles are free: they hold the hidden layers of the second way.
const _: () = assert!(TILE * EMBED[1] >= HEAD[0] && TILE * EMBED[0] >= HEAD[1]);

impl FloatScratch {
    pub(crate) fn zero() -> Self {
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

    /// The source's feature, and a head's two hidden layers for each way.
    fn parts(&mut self) -> (&Feature, [[&mut [f32]; 2]; 2]) {
        let Tiles { hidden1, hidden2 } = &mut self.tiles;
        let ways = [
            [&mut self.head1[..], &mut self.head2[..]],
            [&mut hidden2[..], &mut hidden1[..]],
        ];
        (&self.feature, ways)
    }

    /// The critical point of each channel, if [`embed`] recorded them. They share memory with the heads' hidden layer.
    pub(crate) fn winners(&self) -> &[u16] {
        bytemuck::cast_slice(&self.head1)
    }
}

/// Folds points into the global feature: the maximum over points of the pointwise embedding (no ReLU on the last layer). Before
/// a cloud's first points, the feature must be -infinity everywhere. With `first`, the index of the first point, records the
/// critical point of each channel ([`FloatScratch::winners`]).
///
/// # Shapes
/// `points [N, 3]`; as many features as the embedding has, the rest is left alone.
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
    let Some(feature) = feature.get_mut(..last.outputs()) else {
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

/// Folds rows, numbered from `first`, into the maxima, and records which row raised each.
fn winners_of(
    isa: Isa,
    last: &Dense<'_>,
    x: &[f32],
    first: u32,
    feature: &mut [f32],
    winners: &mut [u16],
) {
    for (output, part) in last.parts() {
        let outputs = output..output + part.outputs();
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

/// Computes the hidden layers tile by tile, alternating between two buffers. `last` receives the last layer, its inputs and the
/// index of the tile's first point.
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
        let mut width = padded(first_layer.outputs());
        let (Some(x), Some(h)) = (tile.get(..n), from.get_mut(..n * width)) else {
            return;
        };
        isa.dense_relu(first_layer, x.as_flattened(), h);
        for layer in middle {
            let next = padded(layer.outputs());
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
