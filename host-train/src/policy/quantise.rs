//! Quantisation of a trained network to 8-bit integers: ranges from calibration pairs, then the arrays of number
//! format 1 (see [`reagent_core::quant`]).

use super::WeightFile;
use crate::dataset::pairs::PairSet;
use crate::learn::agent::{Features, Seen, embed};
use crate::learn::env::{Accumulation, Problem};
use crate::learn::heads::Activations;
use crate::learn::nn::{PackedEmbedding, Parameters, Search};
use rayon::prelude::*;
use reagent_core::dims::{LAYERS, LOGITS, PANEL, STEPS, padded};
use reagent_core::kernels::Isa;
use reagent_core::layer::{Requantise, pack_panels};
use reagent_core::net::Scratch;
use reagent_core::quant::{CODE_MAX, WIDE_MAX};
use reagent_core::sight::Sight;
use reagent_core::view::View;
use reagent_core::weights::{FORMAT_INT8, Offsets, offsets};
use reagent_core::{Action, Decision, Frame, Pose, Registrar, Shape};
use std::borrow::Cow;

/// Headroom of the heads' hidden layers above the calibrated range; their 13 bits can afford it.
const HEAD_ROOM: f32 = 1.5;
/// Bits of a requantisation factor in the embedding, so that products fit 32 bits.
const EMBEDDING_BITS: u32 = 9;
/// Bits of a requantisation factor elsewhere.
const HEAD_BITS: u32 = 15;
/// Smallest range of a channel, relative to the largest of its layer.
const LEAST_RANGE: f32 = 0.02;

/// Largest activation of each channel.
#[derive(Clone, Debug)]
pub(crate) struct Ranges {
    /// Hidden layers of the embedding.
    hidden: [Vec<f32>; 2],
    /// Largest magnitude of any feature.
    feature: f32,
    /// Hidden layers of the translation and rotation head.
    heads: [[Vec<f32>; 2]; 2],
}

impl Ranges {
    /// Measures the activations while the network registers pairs with the most likely steps, which roam farther
    /// than those that policies take.
    pub(crate) fn calibrate(parameters: &Parameters, pairs: &PairSet, sight: Sight) -> Ranges {
        let width = parameters.shape.features();
        let packed = PackedEmbedding::with_search(parameters, Search::F32);
        let [w1, w2, _] = parameters.shape.embed;
        let [h1, h2] = parameters.shape.head;
        let mut ranges = Ranges {
            hidden: [vec![0.0; w1], vec![0.0; w2]],
            feature: 0.0,
            heads: [(); 2].map(|()| [vec![0.0; h1], vec![0.0; h2]]),
        };
        let samples = pairs.samples();
        let problems: Vec<Problem> = samples.map(|pair| Problem::seen(sight, pair)).collect();
        let targets: Vec<Seen<'_>> = problems
            .iter()
            .map(|problem| Seen {
                points: Cow::Borrowed(&problem.chosen),
                view: View::IDENTITY,
            })
            .collect();
        let (mut target, mut source) = (Features::default(), Features::default());
        let mut activations = Activations::default();
        embed(&packed, width, &targets, &mut target);
        ranges.see_clouds(&packed, &targets);
        ranges.see_features(&target);
        let rows: Vec<usize> = (0..problems.len()).collect();
        let mut poses = vec![Pose::IDENTITY; problems.len()];
        for _ in 0..STEPS {
            let seen: Vec<Seen<'_>> = problems
                .iter()
                .zip(&poses)
                .map(|(problem, pose)| {
                    let view = Accumulation::Global.view(problem.centroid, pose);
                    Seen {
                        points: problem.looked_at(&view),
                        view,
                    }
                })
                .collect();
            embed(&packed, width, &seen, &mut source);
            ranges.see_clouds(&packed, &seen);
            ranges.see_features(&source);
            activations.forward(parameters, (&source, &rows), (&target, &rows));
            ranges.see_heads(&activations);
            for (b, pose) in poses.iter_mut().enumerate() {
                let [translation, rotation] = [0, 1].map(|head| {
                    let all = &activations.heads[head].logits;
                    let logits = std::array::from_fn(|i| all[i * rows.len() + b]);
                    Decision::MostLikely.steps(&logits)
                });
                let action = Action {
                    translation,
                    rotation,
                };
                *pose = Accumulation::Global.step(pose, action);
            }
        }
        ranges.widen();
        ranges
    }

    fn see_clouds(&mut self, packed: &PackedEmbedding, clouds: &[Seen<'_>]) {
        let isa = Isa::best();
        let layers = packed.view();
        for cloud in clouds {
            let mut x: Vec<f32> = cloud
                .points
                .iter()
                .flat_map(|&p| cloud.view.see(p))
                .collect();
            for (layer, range) in layers.iter().zip(&mut self.hidden) {
                let mut y = vec![0.0; cloud.points.len() * layer.outputs()];
                isa.dense_relu(layer, &x, &mut y);
                for row in y.chunks_exact(layer.outputs()) {
                    for (range, &value) in range.iter_mut().zip(row) {
                        *range = range.max(value);
                    }
                }
                x = y;
            }
        }
    }

    fn see_heads(&mut self, activations: &Activations) {
        for (ranges, hidden) in self.heads.iter_mut().zip(activations.hidden()) {
            for (range, hidden) in ranges.iter_mut().zip(hidden) {
                for (range, row) in range.iter_mut().zip(hidden.chunks_exact(activations.batch)) {
                    *range = row.iter().fold(*range, |m, &v| m.max(v));
                }
            }
        }
    }

    fn see_features(&mut self, features: &Features) {
        let largest = features.values.iter().map(|v| v.abs());
        self.feature = largest.fold(self.feature, f32::max);
    }

    /// Gives every channel a range, and headroom where it is cheap.
    fn widen(&mut self) {
        self.feature = (self.feature * 1.1).max(1e-6);
        for head in self.heads.as_flattened_mut() {
            for range in head.iter_mut() {
                *range *= HEAD_ROOM;
            }
        }
        for layer in self.hidden.iter_mut().chain(self.heads.as_flattened_mut()) {
            let largest = layer.iter().fold(1e-6f32, |m, &v| m.max(v));
            for range in layer {
                *range = range.max(LEAST_RANGE * largest);
            }
        }
    }
}

/// Mean error of each logit of `integers` along the poses that `exact` reaches. It is the effect of rounded weights
/// that all states share, and it flips the actions of a source that is nearly in place.
pub(crate) fn logit_errors(
    exact: &WeightFile,
    integers: &WeightFile,
    pairs: &PairSet,
) -> [[f64; LOGITS]; 2] {
    let errors: Vec<[[f64; LOGITS]; 2]> = pairs
        .source
        .par_iter()
        .zip(&pairs.target)
        .map(|(source, target)| {
            let mut sum = [[0.0; LOGITS]; 2];
            let mut scratch = [(); 2].map(|()| Box::new(Scratch::new()));
            let [exact_scratch, scratch] = &mut scratch;
            let mut exact = Registrar::new(exact.policy(), exact_scratch);
            let mut integers = Registrar::new(integers.policy(), scratch);
            let Ok(mut way) = exact.start(source, target, Frame::IDENTITY, Pose::IDENTITY) else {
                return sum;
            };
            for _ in 0..STEPS {
                let pose = way.target_from_source();
                let Ok(mut here) = integers.start(source, target, Frame::IDENTITY, pose) else {
                    return sum;
                };
                let (Ok(found), Ok(expected)) = (integers.step(&mut here), exact.step(&mut way))
                else {
                    return sum;
                };
                let heads = [
                    (found.logits_t, expected.logits_t),
                    (found.logits_r, expected.logits_r),
                ];
                for (sum, (found, expected)) in sum.iter_mut().zip(heads) {
                    for (sum, (f, e)) in sum.iter_mut().zip(found.iter().zip(expected)) {
                        *sum += f64::from(f - e);
                    }
                }
            }
            sum
        })
        .collect();
    let count = (errors.len() * STEPS).max(1) as f64;
    std::array::from_fn(|head| {
        std::array::from_fn(|i| errors.iter().map(|e| e[head][i]).sum::<f64>() / count)
    })
}

/// One layer in integers: `real output = sum * unit`.
struct IntegerLayer {
    /// Row-major `[outputs, inputs]`.
    codes: Vec<i8>,
    /// Biases, in units of the sum.
    bias: Vec<f64>,
    /// Real value of one unit of each output's sum.
    unit: Vec<f64>,
}

/// Quantises `W x + b` for inputs that are codes, input `j` in units of `step[j]`.
fn integer_layer(parameters: &Parameters, i: usize, step: &[f64]) -> IntegerLayer {
    let layer = &parameters.layers[i];
    let mut out = IntegerLayer {
        codes: Vec::with_capacity(layer.weight.len()),
        bias: Vec::with_capacity(layer.outputs),
        unit: Vec::with_capacity(layer.outputs),
    };
    let rows = parameters.weight(i).chunks_exact(layer.inputs);
    for (row, &bias) in rows.zip(parameters.bias(i)) {
        let folded: Vec<f64> = row
            .iter()
            .zip(step)
            .map(|(&w, step)| f64::from(w) * step)
            .collect();
        let largest = folded.iter().fold(0.0f64, |m, w| m.max(w.abs()));
        // A bias far above what the weights reach must still fit.
        let unit = (largest / 127.0)
            .max(f64::from(bias).abs() / 1e8)
            .max(1e-30);
        let codes = folded.iter().map(|w| (w / unit).round_ties_even() as i8);
        out.codes.extend(codes);
        out.bias.push(f64::from(bias) / unit);
        out.unit.push(unit);
    }
    out
}

/// Requantises each output to codes with a given largest value. Returns the factors and the real value of one code.
fn requantise(unit: &[f64], range: &[f32], most: i32, bits: u32) -> (Vec<u32>, Vec<f64>) {
    unit.iter()
        .zip(range)
        .map(|(unit, &range)| {
            let wanted = unit * f64::from(most) / f64::from(range);
            let (factor, is) = Requantise::nearest(wanted, bits);
            (factor.0, unit / is)
        })
        .unzip()
}

/// Writes the arrays of number format 1 into a file's bytes.
pub(crate) fn write_arrays(
    shape: &Shape,
    parameters: &Parameters,
    ranges: &Ranges,
    logit_errors: &[[f64; LOGITS]; 2],
    bytes: &mut [u8],
) {
    let mut file = File {
        layers: shape.layers(),
        offsets: offsets(shape, FORMAT_INT8),
        bytes,
    };
    // Layer 1 in units of one code.
    let [range1, range2] = &ranges.hidden;
    let step1: Vec<f64> = range1
        .iter()
        .map(|&range| f64::from(range) / f64::from(CODE_MAX))
        .collect();
    let (inputs, outputs) = file.layers[0];
    let to_codes = |values: &[f32], per: usize| -> Vec<f32> {
        let steps = step1.iter().flat_map(|s| std::iter::repeat_n(s, per));
        values
            .iter()
            .zip(steps)
            .map(|(&v, step)| (f64::from(v) / step) as f32)
            .collect()
    };
    let mut panels = vec![0.0; inputs * padded(outputs)];
    let weight = to_codes(parameters.weight(0), inputs);
    pack_panels(inputs, outputs, &weight, &mut panels);
    let (weight_at, bias_at) = file.offsets[0];
    file.put(weight_at, &panels);
    file.put(bias_at, &to_codes(parameters.bias(0), 1));

    let hidden = integer_layer(parameters, 1, &step1);
    let (factors, step2) = requantise(&hidden.unit, range2, CODE_MAX, EMBEDDING_BITS);
    file.write_layer(1, &hidden, &factors);

    let features = integer_layer(parameters, 2, &step2);
    let range = vec![ranges.feature; shape.features()];
    let (factors, step3) = requantise(&features.unit, &range, WIDE_MAX / 2, EMBEDDING_BITS);
    file.write_layer(2, &features, &factors);

    let state_step = [step3.as_slice(), step3.as_slice()].concat();
    let heads = parameters.shape.heads().into_iter().zip(&ranges.heads);
    for ((first, ranges), errors) in heads.zip(logit_errors) {
        let mut fc1 = integer_layer(parameters, first, &state_step);
        for (bias, row) in fc1.bias.iter_mut().zip(fc1.codes.chunks(shape.state())) {
            // Feature codes count from 4096.
            *bias -= 4096.0 * row.iter().map(|&w| f64::from(w)).sum::<f64>();
        }
        let (factors, step) = requantise(&fc1.unit, &ranges[0], WIDE_MAX, HEAD_BITS);
        file.write_layer(first, &fc1, &factors);
        let fc2 = integer_layer(parameters, first + 1, &step);
        let (factors, step) = requantise(&fc2.unit, &ranges[1], WIDE_MAX, HEAD_BITS);
        file.write_layer(first + 1, &fc2, &factors);
        let mut out = integer_layer(parameters, first + 2, &step);
        for ((bias, unit), error) in out.bias.iter_mut().zip(&out.unit).zip(errors) {
            *bias -= error / unit;
        }
        let scales: Vec<u32> = out.unit.iter().map(|&u| (u as f32).to_bits()).collect();
        file.write_layer(first + 2, &out, &scales);
    }
}

/// A file of number format 1 that is being written.
struct File<'a> {
    layers: [(usize, usize); LAYERS],
    offsets: Offsets,
    bytes: &'a mut [u8],
}

impl File<'_> {
    fn write_layer(&mut self, i: usize, layer: &IntegerLayer, factors: &[u32]) {
        let (inputs, outputs) = self.layers[i];
        let width = padded(outputs);
        let mut panels = vec![0i8; inputs * width];
        for (o, row) in layer.codes.chunks_exact(inputs).enumerate() {
            for (k, &code) in row.iter().enumerate() {
                let quad = o / PANEL * (inputs / 4) + k / 4;
                panels[(quad * PANEL + o % PANEL) * 4 + k % 4] = code;
            }
        }
        let bias: Vec<i32> = layer
            .bias
            .iter()
            .map(|b| b.round_ties_even() as i32)
            .collect();
        let (weight_at, bias_at) = self.offsets[i];
        self.put(weight_at, &panels);
        self.put(bias_at, &bias[..outputs]);
        self.put(bias_at + 4 * width, factors);
    }

    fn put<T: bytemuck::NoUninit>(&mut self, at: usize, values: &[T]) {
        let raw = bytemuck::cast_slice(values);
        self.bytes[at..at + raw.len()].copy_from_slice(raw);
    }
}
