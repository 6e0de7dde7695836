//! The agent's embedding during training: the forward pass runs on core's kernels, the gradient is written by hand.
//! The heads are in [`crate::learn::heads`].
//!
//! The max-pool passes gradient only through the arg-max (critical) point of each channel. The backward pass
//! therefore recomputes the hidden layers of those few hundred points and touches no others. Sums over a mini-batch
//! run over a fixed number of shards in a fixed order, so that results do not depend on the number of threads.

use crate::dataset::Point;
use crate::learn::matmul::{matrix, product};
use crate::learn::nn::{PackedEmbedding, Parameters};
use ndarray::ArrayView2;
use rayon::prelude::*;
use reagent_core::dims::TILE;
use reagent_core::float::{SearchScratch, embed_argmax, embed_search};
use reagent_core::kernels::{GROUPS, Isa};
use reagent_core::layer::Dense;
use reagent_core::view::View;
use std::borrow::Cow;

/// A cloud as the network sees it.
#[derive(Clone, Debug)]
pub struct Seen<'a> {
    /// Points as stored: all of a cloud's, or those that the policy looks at.
    pub points: Cow<'a, [Point]>,
    /// The view under which the network sees them.
    pub view: View,
}

/// Global features of several clouds, with their critical points.
#[derive(Clone, Debug, Default)]
pub struct Features {
    /// `[clouds, F]`.
    pub values: Vec<f32>,
    /// Index of the point that gave each value, `[clouds, F]`.
    pub critical: Vec<u32>,
}

impl Features {
    /// Appends the features of further clouds.
    pub fn extend(&mut self, further: &Features) {
        self.values.extend_from_slice(&further.values);
        self.critical.extend_from_slice(&further.critical);
    }
}

/// Embeds clouds with core's kernels, keeping the critical points.
pub fn embed(packed: &PackedEmbedding, width: usize, clouds: &[Seen<'_>], out: &mut Features) {
    let isa = Isa::best();
    let layers = packed.view();
    let search = packed.search_view();
    out.values.resize(clouds.len() * width, 0.0);
    out.critical.resize(clouds.len() * width, 0);
    out.values
        .par_chunks_mut(width)
        .zip(out.critical.par_chunks_mut(width))
        .zip(clouds)
        .for_each_init(
            || EmbedMemory::new(&layers),
            |memory, ((values, critical), cloud)| {
                let Seen { points, view } = cloud;
                let Some(last) = &search else {
                    let hidden = memory.hidden.each_mut().map(Vec::as_mut_slice);
                    embed_argmax(isa, &layers, points, view, hidden, values, critical);
                    return;
                };
                let scratch = memory.for_search(points.len(), last.codes.inputs(), width);
                embed_search(isa, &layers, last, points, view, scratch, values, critical);
            },
        );
}

/// Memory in which one thread embeds clouds.
struct EmbedMemory {
    /// Width of the last hidden layer.
    width: usize,
    hidden: [Vec<f32>; 2],
    kept: Vec<f32>,
    codes: Vec<u8>,
    scales: Vec<f32>,
    best: Vec<f32>,
    winner: Vec<u32>,
}

impl EmbedMemory {
    fn new(layers: &[Dense<'_>]) -> Self {
        let widest = hidden_widths(layers).max().unwrap_or(0);
        EmbedMemory {
            width: hidden_widths(layers).last().unwrap_or(0),
            hidden: [vec![0.0; TILE * widest], vec![0.0; TILE * widest]],
            kept: Vec::new(),
            codes: Vec::new(),
            scales: Vec::new(),
            best: Vec::new(),
            winner: Vec::new(),
        }
    }

    fn for_search(&mut self, points: usize, stride: usize, features: usize) -> SearchScratch<'_> {
        self.kept.resize(points * self.width, 0.0);
        self.codes.resize(points * stride, 0);
        self.scales.resize(points, 0.0);
        self.best.resize(GROUPS * features, 0.0);
        self.winner.resize(GROUPS * features, 0);
        SearchScratch {
            hidden: self.hidden.each_mut().map(Vec::as_mut_slice),
            kept: &mut self.kept,
            codes: &mut self.codes,
            scales: &mut self.scales,
            best: &mut self.best,
            winner: &mut self.winner,
        }
    }
}

/// Output widths of all layers but the last.
fn hidden_widths(layers: &[Dense<'_>]) -> impl Iterator<Item = usize> {
    layers
        .iter()
        .rev()
        .skip(1)
        .rev()
        .map(|layer| layer.outputs())
}

pub(crate) fn relu_backward(activation: &[f32], gradient: &mut [f32]) {
    for (g, &a) in gradient.iter_mut().zip(activation) {
        *g = if a > 0.0 { *g } else { 0.0 };
    }
}

/// Shards over which gradients of the embedding are summed.
const SHARDS: usize = 16;

/// Gradient of the embedding's parameters, given the gradients of the clouds' features.
///
/// # Shapes
/// `features` are those of `clouds`; `feature_gradients [clouds, F]`. The embedding's layers of `gradient` are
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
    let layers = packed.view();
    let end = gradient.layers[layers.len() - 1].bias.end;
    let shard = clouds.len().div_ceil(SHARDS).max(1);
    let sums: Vec<Vec<f32>> = clouds
        .par_chunks(shard)
        .zip(features.critical.par_chunks(shard * width))
        .zip(feature_gradients.par_chunks(shard * width))
        .map(|((clouds, critical), gradients)| {
            let mut sum = vec![0.0; end];
            let mut work = CriticalPoints::new(&layers);
            let rows = critical
                .chunks_exact(width)
                .zip(gradients.chunks_exact(width));
            for (cloud, (critical, gradient)) in clouds.iter().zip(rows) {
                work.backward(&layers, parameters, cloud, critical, gradient, &mut sum);
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

/// Working memory for the critical points of one cloud: those that won a channel of the max-pool.
struct CriticalPoints {
    /// Slot of each point of the cloud, `u32::MAX` where it won nothing.
    slot: Vec<u32>,
    /// Slot of each channel's winner.
    rows: Vec<u32>,
    /// The winning points as seen, `[slots, 3]`.
    points: Vec<Point>,
    /// Activations of each hidden layer.
    hidden: Vec<Hidden>,
}

/// One hidden layer at the winning points.
struct Hidden {
    width: usize,
    /// `[slots, width]`.
    values: Vec<f32>,
    /// `[slots, width]`.
    gradient: Vec<f32>,
}

impl CriticalPoints {
    fn new(layers: &[Dense<'_>]) -> Self {
        let hidden = hidden_widths(layers).map(|width| Hidden {
            width,
            values: Vec::new(),
            gradient: Vec::new(),
        });
        CriticalPoints {
            slot: Vec::new(),
            rows: Vec::new(),
            points: Vec::new(),
            hidden: hidden.collect(),
        }
    }

    /// Gathers the winning points and runs the hidden layers on them.
    fn forward(&mut self, layers: &[Dense<'_>], cloud: &Seen<'_>, critical: &[u32]) {
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
        let isa = Isa::best();
        let mut x = self.points.as_flattened();
        for (layer, hidden) in layers.iter().zip(&mut self.hidden) {
            for buffer in [&mut hidden.values, &mut hidden.gradient] {
                buffer.clear();
                buffer.resize(self.points.len() * hidden.width, 0.0);
            }
            isa.dense_relu(layer, x, &mut hidden.values);
            x = &hidden.values;
        }
    }

    /// Adds one cloud's gradient to `sum`, laid out as the embedding's layers.
    fn backward(
        &mut self,
        layers: &[Dense<'_>],
        parameters: &Parameters,
        cloud: &Seen<'_>,
        critical: &[u32],
        feature_gradient: &[f32],
        sum: &mut [f32],
    ) {
        self.forward(layers, cloud, critical);
        let last = layers.len() - 1;
        let top = self.hidden.last_mut().expect("two or more layers");

        // Last layer: each channel has one winning point.
        let layer = &parameters.layers[last];
        let (weight_sum, bias_sum) =
            sum[layer.weight.start..layer.bias.end].split_at_mut(layer.weight.len());
        self.rows.clear();
        self.rows
            .extend(critical.iter().map(|&point| self.slot[point as usize]));
        Isa::best().max_backward(
            top.width,
            &self.rows,
            feature_gradient,
            (&top.values, parameters.weight(last)),
            (weight_sum, &mut top.gradient),
        );
        for (bias, g) in bias_sum.iter_mut().zip(feature_gradient) {
            *bias += g;
        }

        // Hidden layers: dense over the winning points.
        let n = self.points.len();
        for i in (0..last).rev() {
            let (below, here) = self.hidden.split_at_mut(i);
            let here = &mut here[0];
            relu_backward(&here.values, &mut here.gradient);
            let gradient = matrix(&here.gradient, n, here.width);
            let Some(below) = below.last_mut() else {
                accumulate(parameters, i, sum, gradient, self.points.as_flattened());
                break;
            };
            accumulate(parameters, i, sum, gradient, &below.values);
            let weight = matrix(parameters.weight(i), here.width, below.width);
            product(&mut below.gradient, gradient, weight, 0.0);
        }
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
