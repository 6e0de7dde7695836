//! The network's parameters as one flat vector and a table of layers.

use crate::random::{Purpose, stream};
use rand::RngExt;
use reagent_core::dims::{LOGITS, PANEL, padded};
use reagent_core::float::{FloatNetwork, SearchLayer};
use reagent_core::kernels::Isa;
use reagent_core::layer::{Codes, Dense, pack_codes, pack_panels, padded_codes};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;

/// Widths of the network's layers. The paper's ablations and compact networks are other values of this type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shape {
    /// Outputs of the embedding's first layer, of its last but one, and of its last; each a multiple of 16.
    pub embed: [usize; 3],
    /// Further layers as wide as the first, between it and the last but one; at most [`Shape::MOST_EXTRA`].
    #[serde(default)]
    pub extra: usize,
    /// Outputs of the two hidden layers of a head.
    pub head: [usize; 2],
}

impl fmt::Display for Shape {
    /// Widths of the embedding and of the heads, as `64-128-1024, heads 512-256`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second, last] = self.embed;
        for _ in 0..=self.extra {
            write!(f, "{first}-")?;
        }
        let [wide, narrow] = self.head;
        write!(f, "{second}-{last}, heads {wide}-{narrow}")
    }
}

impl Shape {
    /// The paper's network: 64-128-1024, heads 512-256-33, value head 512-256-1.
    pub const PAPER: Shape = Shape::of(reagent_core::Shape::FULL);
    /// The design table's alternative, a deeper embedding with narrower heads: 64-64-64-128-1024, heads
    /// 256-128-33. The paper gives no widths: these are PointNet's embedding and heads of half the width.
    pub const DEEP: Shape = Shape {
        embed: [64, 128, 1024],
        extra: 2,
        head: [256, 128],
    };
    /// A network of at most 256 KiB in 8-bit integers: 64-64-384, heads 128-64-33.
    pub const COMPACT: Shape = Shape::of(reagent_core::Shape::COMPACT);
    /// Bound of [`Shape::extra`].
    pub const MOST_EXTRA: usize = 5;

    /// The shape of a deployed network.
    const fn of(deployed: reagent_core::Shape) -> Shape {
        Shape {
            embed: deployed.embed,
            extra: 0,
            head: deployed.head,
        }
    }

    /// The corresponding shape of a deployed network, if robots run networks of this shape.
    pub fn deployed(&self) -> Option<reagent_core::Shape> {
        let Shape { embed, extra, head } = *self;
        let shape = reagent_core::Shape { embed, head };
        (extra == 0 && shape.is_runnable()).then_some(shape)
    }

    /// Length of one global feature.
    pub fn features(&self) -> usize {
        self.embed[2]
    }

    /// Number of layers in the embedding; they come first.
    pub fn embedding_layers(&self) -> usize {
        self.embed.len() + self.extra
    }

    /// Index of the first layer of the translation head and of the rotation head; two more follow each.
    pub fn heads(&self) -> [usize; 2] {
        [self.embedding_layers(), self.embedding_layers() + 3]
    }

    /// Index of the value head's first layer; its second one follows.
    pub fn value(&self) -> usize {
        self.embedding_layers() + 6
    }

    /// Whether a network of this shape can be built in bounded memory.
    pub fn is_sound(&self) -> bool {
        let widths = self.embed.iter().chain(&self.head);
        let fits = widths.clone().all(|&w| (1..=1 << 16).contains(&w));
        let panels = self.embed.iter().all(|w| w.is_multiple_of(PANEL));
        fits && panels && self.extra <= Self::MOST_EXTRA
    }

    /// `(name, inputs, outputs)` of every layer in order.
    fn table(&self) -> Vec<(&'static str, usize, usize)> {
        const EMBEDDING: [&str; 3 + Shape::MOST_EXTRA] = [
            "embed.conv1",
            "embed.conv2",
            "embed.conv3",
            "embed.conv4",
            "embed.conv5",
            "embed.conv6",
            "embed.conv7",
            "embed.conv8",
        ];
        let [e1, e2, features] = self.embed;
        let [h1, h2] = self.head;
        let mut widths = vec![3, e1];
        widths.extend((0..self.extra).map(|_| e1));
        widths.extend([e2, features]);
        let mut table: Vec<_> = EMBEDDING
            .into_iter()
            .zip(widths.windows(2))
            .map(|(name, width)| (name, width[0], width[1]))
            .collect();
        table.extend([
            ("head_t.fc1", 2 * features, h1),
            ("head_t.fc2", h1, h2),
            ("policy_t", h2, LOGITS),
            ("head_r.fc1", 2 * features, h1),
            ("head_r.fc2", h1, h2),
            ("policy_r", h2, LOGITS),
            ("value.fc1", 2 * h2, h2),
            ("value.fc2", h2, 1),
        ]);
        table
    }
}

/// Place of one dense layer in the flat vector.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Name as in the reference checkpoint, without `.weight` or `.bias`.
    pub name: &'static str,
    /// Length of the input.
    pub inputs: usize,
    /// Length of the output.
    pub outputs: usize,
    /// Row-major `[outputs, inputs]`.
    pub weight: Range<usize>,
    /// `[outputs]`; follows the weight directly.
    pub bias: Range<usize>,
}

/// All parameters of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Widths.
    pub shape: Shape,
    /// The place of each layer.
    pub layers: Vec<Layer>,
    /// The numbers.
    pub values: Vec<f32>,
}

impl Parameters {
    /// Parameters of a shape, all zero.
    pub fn zeros(shape: Shape) -> Self {
        let mut at = 0;
        let layers = shape
            .table()
            .into_iter()
            .map(|(name, inputs, outputs)| {
                let weight = at..at + inputs * outputs;
                let bias = weight.end..weight.end + outputs;
                at = bias.end;
                Layer {
                    name,
                    inputs,
                    outputs,
                    weight,
                    bias,
                }
            })
            .collect();
        Parameters {
            shape,
            layers,
            values: vec![0.0; at],
        }
    }

    /// Uniform in ±1/√inputs for weights and biases, as PyTorch initialises linear layers.
    pub fn random(shape: Shape, seed: u64) -> Self {
        let mut parameters = Self::zeros(shape);
        for (i, layer) in parameters.layers.iter().enumerate() {
            let bound = 1.0 / (layer.inputs as f32).sqrt();
            let mut rng = stream(seed, Purpose::Init, i as u64);
            for value in &mut parameters.values[layer.weight.start..layer.bias.end] {
                *value = rng.random_range(-bound..=bound);
            }
        }
        parameters
    }

    /// Parameters of a deployed f32 network; the value head, which is not deployed, is drawn from `seed`.
    pub fn from_network(shape: reagent_core::Shape, network: &FloatNetwork<'_>, seed: u64) -> Self {
        let mut parameters = Self::random(Shape::of(shape), seed);
        let dense = [
            network.embedding.layers,
            network.translation.layers,
            network.rotation.layers,
        ];
        for (layer, dense) in parameters.layers.iter().zip(dense.as_flattened()) {
            let weight = &mut parameters.values[layer.weight.clone()];
            for (row, values) in weight.chunks_exact_mut(layer.inputs).enumerate() {
                let panel = &dense.panels()[row / PANEL * layer.inputs * PANEL..];
                for (k, value) in values.iter_mut().enumerate() {
                    *value = panel[k * PANEL + row % PANEL];
                }
            }
            parameters.values[layer.bias.clone()].copy_from_slice(&dense.bias()[..layer.outputs]);
        }
        parameters
    }

    /// Weight matrix of layer `i`, row-major `[outputs, inputs]`.
    pub fn weight(&self, i: usize) -> &[f32] {
        &self.values[self.layers[i].weight.clone()]
    }

    /// Bias of layer `i`.
    pub fn bias(&self, i: usize) -> &[f32] {
        &self.values[self.layers[i].bias.clone()]
    }

    /// Weight matrix and bias of layer `i`, mutable: `(weight, bias)`.
    pub fn layer_mut(&mut self, i: usize) -> (&mut [f32], &mut [f32]) {
        let Layer { weight, bias, .. } = &self.layers[i];
        self.values[weight.start..bias.end].split_at_mut(weight.len())
    }
}

/// How training finds the points that reach a feature's maximum.
///
/// The trade-off was measured with the shipped policy on 32 noisy clouds of 1024 points and mini-batches from its own
/// roll-outs (Xeon with AVX-512 VNNI and AMX, one thread, CPU time). In 8 bits, 2.0 % of the features come from another
/// point than in f32, one whose value is close, so that features differ by 2.9e-4 in relative norm. The gradient of a
/// mini-batch has a cosine of 0.998 to 0.99998 with that of the f32 search (0.9957 to 0.9998 within the embedding), and
/// its norm agrees to 0.4 %: less than drawing other clouds changes. Embedding a cloud takes 0.43 ms instead of 1.6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Search {
    /// In 8 bits where the machine multiplies bytes faster than floats, in f32 elsewhere.
    #[default]
    Auto,
    /// In f32.
    F32,
    /// In 8 bits; the features of the points found are f32.
    Int8,
}

impl Search {
    fn in_bytes(self) -> bool {
        match self {
            Search::Auto => Isa::best().has_fast_bytes(),
            Search::F32 => false,
            Search::Int8 => true,
        }
    }
}

/// The embedding in the layout of core's kernels.
#[derive(Clone, Debug)]
pub struct PackedEmbedding {
    layers: Vec<PackedLayer>,
    /// The last layer row-major and as 8-bit codes, where the search for critical points is in 8 bits.
    search: Option<(Vec<f32>, Vec<i8>)>,
}

#[derive(Clone, Debug)]
struct PackedLayer {
    inputs: usize,
    outputs: usize,
    panels: Vec<f32>,
    bias: Vec<f32>,
}

impl PackedEmbedding {
    /// Packs the current parameters, with the search that is fastest on this machine.
    pub fn new(parameters: &Parameters) -> Self {
        Self::with_search(parameters, Search::Auto)
    }

    /// Packs the current parameters, with a given search for critical points.
    pub fn with_search(parameters: &Parameters, search: Search) -> Self {
        let layers = parameters.layers[..parameters.shape.embedding_layers()]
            .iter()
            .map(|layer| PackedLayer {
                inputs: layer.inputs,
                outputs: layer.outputs,
                panels: vec![0.0; layer.inputs * padded(layer.outputs)],
                bias: vec![0.0; padded(layer.outputs)],
            })
            .collect();
        let last = &parameters.layers[parameters.shape.embedding_layers() - 1];
        let search = search.in_bytes().then(|| {
            let codes = padded_codes(last.inputs) * padded(last.outputs);
            (vec![0.0; last.weight.len()], vec![0; codes])
        });
        let mut packed = PackedEmbedding { layers, search };
        packed.pack(parameters);
        packed
    }

    /// Repacks the current parameters.
    pub fn pack(&mut self, parameters: &Parameters) {
        for (i, layer) in self.layers.iter_mut().enumerate() {
            let weight = parameters.weight(i);
            pack_panels(layer.inputs, layer.outputs, weight, &mut layer.panels);
            layer.bias[..layer.outputs].copy_from_slice(parameters.bias(i));
        }
        if let Some((rows, codes)) = &mut self.search {
            let last = self.layers.len() - 1;
            rows.copy_from_slice(parameters.weight(last));
            pack_codes(self.layers[last].inputs, rows, codes);
        }
    }

    /// The last layer for core's 8-bit search; `None` where the search is in f32.
    pub fn search_view(&self) -> Option<SearchLayer<'_>> {
        let (rows, codes) = self.search.as_ref()?;
        let last = self.layers.last()?;
        let codes = Codes::new(padded_codes(last.inputs), last.outputs, codes)?;
        Some(SearchLayer { codes, rows })
    }

    /// The layers for core's kernels.
    pub fn view(&self) -> Vec<Dense<'_>> {
        self.layers
            .iter()
            .map(|layer| {
                Dense::new(layer.inputs, layer.outputs, &layer.panels, &layer.bias)
                    .expect("arrays were made with the padded lengths")
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_s_network_has_2650051_parameters() {
        assert_eq!(Parameters::zeros(Shape::PAPER).values.len(), 2_650_051);
    }
}
