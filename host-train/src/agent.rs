//! The agent's embedding during training: forward on core's kernels, and the gradient by hand. The heads
//! are in [`crate::heads`].
//!
//! The max-pool passes gradient only
//! through the arg-max (critical) point of each channel, so the backward pass recomputes the hidden
//! layers of those few hundred points and touches no others. Sums over a mini-batch are made over a
//! fixed number of shards in a fixed order: results do not depend on the number of threads.

use crate::dataset::Point;
use crate::matmul::{matrix, product};
use crate::nn::{PackedEmbedding, Parameters};
use ndarray::ArrayView2;
use rayon::prelude::*;
use reagent_core::dims::TILE;
use reagent_core::kernels::Isa;
use reagent_core::net::{View, embed_argmax};
use reagent_core::weights::Embedding;

/// A cloud as the network sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Stored points.
    pub points: &'a [Point],
    /// Where they appear.
    pub view: View,
}

/// Global features of several clouds with their critical points.
#[derive(Clone, Debug, Default)]
pub struct Features {
    /// `[clouds, F]`.
    pub values: Vec<f32>,
    /// Index of the point that gave each value, `[clouds, F]`.
    pub critical: Vec<u32>,
}

/// Embeds clouds with core's kernel, keeping the critical points.
pub fn embed(packed: &PackedEmbedding, width: usize, clouds: &[Seen<'_>], out: &mut Features) {
    let isa = Isa::best();
    let embedding = packed.view();
    let [l1, l2, _] = &embedding.layers;
    out.values.resize(clouds.len() * width, 0.0);
    out.critical.resize(clouds.len() * width, 0);
    out.values
        .par_chunks_mut(width)
        .zip(out.critical.par_chunks_mut(width))
        .zip(clouds)
        .for_each_init(
            || (vec![0.0; TILE * l1.outputs], vec![0.0; TILE * l2.outputs]),
            |(h1, h2), ((values, critical), cloud)| {
                embed_argmax(
                    isa,
                    &embedding,
                    cloud.points,
                    &cloud.view,
                    h1,
                    h2,
                    values,
                    critical,
                );
            },
        );
}

pub(crate) fn relu_backward(activation: &[f32], gradient: &mut [f32]) {
    for (g, &a) in gradient.iter_mut().zip(activation) {
        if a <= 0.0 {
            *g = 0.0;
        }
    }
}

/// Shards over which gradients of the embedding are summed.
const SHARDS: usize = 16;

/// Gradient of the embedding's parameters, for clouds with given gradients of their features.
///
/// # Shapes
/// `features` of `clouds`, `feature_gradients [clouds, F]`; the first three layers of `gradient` are
/// overwritten.
pub fn embedding_backward(
    packed: &PackedEmbedding,
    parameters: &Parameters,
    clouds: &[Seen<'_>],
    features: &Features,
    feature_gradients: &[f32],
    gradient: &mut Parameters,
) {
    let width = parameters.shape.features();
    let end = gradient.layers[2].bias.end;
    let embedding = packed.view();
    let shard = clouds.len().div_ceil(SHARDS).max(1);
    let sums: Vec<Vec<f32>> = clouds
        .par_chunks(shard)
        .zip(features.critical.par_chunks(shard * width))
        .zip(feature_gradients.par_chunks(shard * width))
        .map(|((clouds, critical), gradients)| {
            let mut sum = vec![0.0; end];
            let mut work = CriticalPoints::default();
            let rows = critical
                .chunks_exact(width)
                .zip(gradients.chunks_exact(width));
            for (cloud, (critical, gradient)) in clouds.iter().zip(rows) {
                work.backward(&embedding, parameters, cloud, critical, gradient, &mut sum);
            }
            sum
        })
        .collect();
    let total = &mut gradient.values[..end];
    total.fill(0.0);
    for sum in &sums {
        for (t, s) in total.iter_mut().zip(sum) {
            *t += s;
        }
    }
}

/// Working memory for the points that won a channel of one cloud.
#[derive(Default)]
struct CriticalPoints {
    /// Slot of each point of the cloud, `u32::MAX` where it won nothing.
    slot: Vec<u32>,
    /// The winning points as seen, `[slots, 3]`.
    points: Vec<Point>,
    hidden1: Vec<f32>,
    hidden2: Vec<f32>,
    gradient1: Vec<f32>,
    gradient2: Vec<f32>,
}

impl CriticalPoints {
    /// Adds one cloud's gradient to `sum`, laid out as the first three layers.
    fn backward(
        &mut self,
        embedding: &Embedding<'_>,
        parameters: &Parameters,
        cloud: &Seen<'_>,
        critical: &[u32],
        feature_gradient: &[f32],
        sum: &mut [f32],
    ) {
        let isa = Isa::best();
        let [w1, w2, _] = parameters.shape.embed;
        self.slot.clear();
        self.slot.resize(cloud.points.len(), u32::MAX);
        self.points.clear();
        for &point in critical {
            let slot = &mut self.slot[point as usize];
            if *slot == u32::MAX {
                *slot = self.points.len() as u32;
                self.points
                    .push(cloud.view.see(cloud.points[point as usize]));
            }
        }
        let n = self.points.len();
        for (buffer, width) in [
            (&mut self.hidden1, w1),
            (&mut self.hidden2, w2),
            (&mut self.gradient1, w1),
            (&mut self.gradient2, w2),
        ] {
            buffer.clear();
            buffer.resize(n * width, 0.0);
        }
        let x = self.points.as_flattened();
        isa.dense_relu(&embedding.layers[0], x, &mut self.hidden1);
        isa.dense_relu(&embedding.layers[1], &self.hidden1, &mut self.hidden2);

        // Last layer: each channel has one winning point.
        let layer = &parameters.layers[2];
        let rows = parameters.weight(2).chunks_exact(w2);
        let (sum3, bias3) =
            sum[layer.weight.start..layer.bias.end].split_at_mut(layer.weight.len());
        for ((((&point, &g), weight), sum), bias) in critical
            .iter()
            .zip(feature_gradient)
            .zip(rows)
            .zip(sum3.chunks_exact_mut(w2))
            .zip(bias3)
        {
            let at = self.slot[point as usize] as usize * w2;
            let hidden = &self.hidden2[at..at + w2];
            let gradient = &mut self.gradient2[at..at + w2];
            for k in 0..w2 {
                sum[k] += g * hidden[k];
                gradient[k] += g * weight[k];
            }
            *bias += g;
        }
        relu_backward(&self.hidden2, &mut self.gradient2);
        let gradient2 = matrix(&self.gradient2, n, w2);
        accumulate(parameters, 1, sum, gradient2, &self.hidden1);
        product(
            &mut self.gradient1,
            gradient2,
            matrix(parameters.weight(1), w2, w1),
            0.0,
        );
        relu_backward(&self.hidden1, &mut self.gradient1);
        accumulate(parameters, 0, sum, matrix(&self.gradient1, n, w1), x);
    }
}

/// `sum += dyᵀ x` and its bias for layer `i`; `dy [points, outputs]`, `x [points, inputs]`.
fn accumulate(
    parameters: &Parameters,
    i: usize,
    sum: &mut [f32],
    dy: ArrayView2<'_, f32>,
    x: &[f32],
) {
    let layer = &parameters.layers[i];
    let x = matrix(x, dy.nrows(), layer.inputs);
    product(&mut sum[layer.weight.clone()], dy.t(), x, 1.0);
    let bias = &mut sum[layer.bias.clone()];
    for row in dy.rows() {
        for (b, g) in bias.iter_mut().zip(row) {
            *b += g;
        }
    }
}
