//! Embedding and policy heads, written once over the kernels of the machine.

use crate::dims::{EMBED, FEATURES, HEAD, LOGITS, TILE, padded};
use crate::kernels::Isa;
use crate::pose::Pose;
use crate::weights::{Embedding, Head, Policy};
use glam::Vec3;

/// A global feature vector, one value a channel.
pub type Feature = [f32; FEATURES];

/// Hidden activations of the points embedded together.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// First hidden layer, `[TILE, 64]`.
    hidden1: [f32; TILE * EMBED[0]],
    /// Second hidden layer, `[TILE, 128]`.
    hidden2: [f32; TILE * EMBED[1]],
}

/// Working memory of one network evaluation; the caller owns it.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// For the embedding.
    pub(crate) tiles: Tiles,
    /// Global feature of the cloud embedded last.
    pub(crate) feature: Feature,
    /// First hidden layer of a head.
    head1: [f32; HEAD[0]],
    /// Second hidden layer of a head.
    head2: [f32; HEAD[1]],
}

impl Scratch {
    /// Zeroed working memory.
    pub const fn new() -> Self {
        Scratch {
            tiles: Tiles {
                hidden1: [0.0; TILE * EMBED[0]],
                hidden2: [0.0; TILE * EMBED[1]],
            },
            feature: [0.0; FEATURES],
            head1: [0.0; HEAD[0]],
            head2: [0.0; HEAD[1]],
        }
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

/// The global feature: max over points of the pointwise embedding (no ReLU on the last layer).
///
/// # Shapes
/// `points [N, 3]`, `feature [1024]`. An empty cloud gives -infinity everywhere.
pub fn embed(
    isa: Isa,
    embedding: &Embedding<'_>,
    points: &[[f32; 3]],
    view: &View,
    tiles: &mut Tiles,
    feature: &mut Feature,
) {
    feature.fill(f32::NEG_INFINITY);
    let Tiles { hidden1, hidden2 } = tiles;
    embed_tiles(
        isa,
        embedding,
        points,
        view,
        hidden1,
        hidden2,
        |l3, x, _| {
            isa.dense_max(l3, x, feature);
        },
    );
}

/// As [`embed`], and keeps for each channel the index of the first point that reaches the maximum
/// (the critical point): the only one through which a gradient flows.
///
/// Sizes come from the layers, so that a trainer may use other shapes than the deployed one.
///
/// # Shapes
/// `points [N, 3]`, `hidden1 [TILE * H1]`, `hidden2 [TILE * H2]`, `feature [F]`, `argmax [F]`,
/// with `F` a multiple of [`crate::dims::PANEL`].
#[allow(clippy::too_many_arguments)]
pub fn embed_argmax(
    isa: Isa,
    embedding: &Embedding<'_>,
    points: &[[f32; 3]],
    view: &View,
    hidden1: &mut [f32],
    hidden2: &mut [f32],
    feature: &mut [f32],
    argmax: &mut [u32],
) {
    feature.fill(f32::NEG_INFINITY);
    argmax.fill(0);
    embed_tiles(
        isa,
        embedding,
        points,
        view,
        hidden1,
        hidden2,
        |l3, x, first| {
            isa.dense_argmax(l3, x, first, feature, argmax);
        },
    );
}

fn embed_tiles(
    isa: Isa,
    embedding: &Embedding<'_>,
    points: &[[f32; 3]],
    view: &View,
    hidden1: &mut [f32],
    hidden2: &mut [f32],
    mut last: impl FnMut(&crate::weights::Dense<'_>, &[f32], u32),
) {
    let [l1, l2, l3] = &embedding.layers;
    let mut tile = [[0.0; 3]; TILE];
    let mut first = 0u32;
    for chunk in points.chunks(TILE) {
        let n = chunk.len();
        for (seen, &point) in tile.iter_mut().zip(chunk) {
            *seen = view.see(point);
        }
        let (Some(x), Some(h1), Some(h2)) = (
            tile.get(..n),
            hidden1.get_mut(..n * padded(l1.outputs)),
            hidden2.get_mut(..n * padded(l2.outputs)),
        ) else {
            return;
        };
        isa.dense_relu(l1, x.as_flattened(), h1);
        isa.dense_relu(l2, h1, h2);
        last(l3, h2, first);
        first += n as u32;
    }
}

/// The part of a head's first layer that the target's feature determines, bias included: constant
/// over a registration.
pub type TargetHalf = [f32; HEAD[0]];

/// First half of the heads for a target: `b + W[:, 1024..] φ(Y)` for both heads.
pub fn target_halves(isa: Isa, policy: &Policy<'_>, target: &Feature) -> [TargetHalf; 2] {
    [&policy.translation, &policy.rotation].map(|head| {
        let [fc1, _, _] = &head.layers;
        let mut half = [0.0; HEAD[0]];
        isa.gemv(fc1, fc1.bias, FEATURES, target, &mut half);
        half
    })
}

/// Logits of one head, `[33]`, axis-major, for the source feature in `scratch`.
pub fn logits(
    isa: Isa,
    head: &Head<'_>,
    target_half: &TargetHalf,
    scratch: &mut Scratch,
) -> [f32; LOGITS] {
    let [fc1, fc2, out] = &head.layers;
    isa.gemv(fc1, target_half, 0, &scratch.feature, &mut scratch.head1);
    relu(&mut scratch.head1);
    isa.gemv(fc2, fc2.bias, 0, &scratch.head1, &mut scratch.head2);
    relu(&mut scratch.head2);
    let mut padded_logits = [0.0; padded(LOGITS)];
    isa.gemv(out, out.bias, 0, &scratch.head2, &mut padded_logits);
    core::array::from_fn(|i| padded_logits.get(i).copied().unwrap_or(0.0))
}

fn relu(values: &mut [f32]) {
    for v in values {
        *v = v.max(0.0);
    }
}
