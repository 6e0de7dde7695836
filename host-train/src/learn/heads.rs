//! Policy heads and value head during training: the batched forward pass, and its gradient by hand.
//!
//! Activations are stored `[features, batch]`.

use crate::learn::agent::{Features, relu_backward};
use crate::learn::matmul::{matrix, product_parallel};
use crate::learn::nn::Parameters;

/// Activations of one head, each `[width, batch]`.
#[derive(Clone, Debug, Default)]
pub struct HeadActivations {
    hidden1: Vec<f32>,
    /// `[33, batch]`.
    pub logits: Vec<f32>,
}

/// Activations of both heads and of the value head for a batch of states.
#[derive(Clone, Debug, Default)]
pub struct Activations {
    /// States in the batch.
    pub batch: usize,
    /// `[2F, batch]`, source features first.
    state: Vec<f32>,
    /// Translation head, then rotation head.
    pub heads: [HeadActivations; 2],
    /// Second hidden layers of both heads, translation first, `[2 H2, batch]`: the value head's input.
    middle: Vec<f32>,
    value_hidden: Vec<f32>,
    /// Value estimates `[batch]` of the last [`Activations::estimate`].
    pub values: Vec<f32>,
    work: Gradients,
}

/// Gradients of hidden layers, `[width, batch]` each.
#[derive(Clone, Debug, Default)]
struct Gradients {
    hidden1: Vec<f32>,
    middle: Vec<f32>,
    value_hidden: Vec<f32>,
}

impl Activations {
    /// The hidden layers of both heads, `[width, batch]` each, translation first.
    pub fn hidden(&self) -> [[&[f32]; 2]; 2] {
        let (t, r) = self.middle.split_at(self.middle.len() / 2);
        let [head_t, head_r] = &self.heads;
        [[&head_t.hidden1, t], [&head_r.hidden1, r]]
    }

    /// Runs both policy heads on a batch of states. State `b` consists of row `sources[b]` of the source features
    /// and row `targets[b]` of the target features.
    pub fn forward(
        &mut self,
        parameters: &Parameters,
        sources: (&Features, &[usize]),
        targets: (&Features, &[usize]),
    ) {
        let width = parameters.shape.features();
        let batch = sources.1.len();
        self.batch = batch;
        self.state.resize(2 * width * batch, 0.0);
        for (half, (features, rows)) in [sources, targets].into_iter().enumerate() {
            for (b, &row) in rows.iter().enumerate() {
                let values = &features.values[row * width..(row + 1) * width];
                for (c, &value) in values.iter().enumerate() {
                    self.state[(half * width + c) * batch + b] = value;
                }
            }
        }
        let h2 = parameters.shape.head[1];
        self.middle.resize(2 * h2 * batch, 0.0);
        let middles = self.middle.chunks_exact_mut(h2 * batch);
        let heads = self.heads.iter_mut().zip(middles);
        for ((head, middle), first) in heads.zip(parameters.shape.heads()) {
            let size = |i: usize| parameters.layers[i].outputs * batch;
            head.hidden1.resize(size(first), 0.0);
            head.logits.resize(size(first + 2), 0.0);
            dense(parameters, first, &self.state, batch, &mut head.hidden1);
            relu(&mut head.hidden1);
            dense(parameters, first + 1, &head.hidden1, batch, middle);
            relu(middle);
            dense(parameters, first + 2, middle, batch, &mut head.logits);
        }
    }

    /// Runs the value head on the states of the last [`Activations::forward`] and writes [`Activations::values`].
    pub fn estimate(&mut self, parameters: &Parameters) {
        let (first, batch) = (parameters.shape.value(), self.batch);
        let hidden = &mut self.value_hidden;
        hidden.resize(parameters.layers[first].outputs * batch, 0.0);
        self.values.resize(batch, 0.0);
        dense(parameters, first, &self.middle, batch, hidden);
        relu(hidden);
        dense(parameters, first + 1, hidden, batch, &mut self.values);
    }

    /// Writes the gradient of all heads' parameters into `gradient`, and that of the state, `[2F, batch]`. Takes the
    /// gradients of the logits (translation, rotation; `[33, batch]` each) and of the values (`[batch]`), which flow on
    /// into both heads; `None` leaves the value head's gradient zero.
    pub fn backward(
        &mut self,
        parameters: &Parameters,
        logit_gradients: [&[f32]; 2],
        value_gradient: Option<&[f32]>,
        gradient: &mut Parameters,
        state_gradient: &mut Vec<f32>,
    ) {
        let (batch, shape) = (self.batch, parameters.shape);
        let work = &mut self.work;
        work.middle.resize(self.middle.len(), 0.0);
        let from_value = if let Some(values) = value_gradient {
            let first = shape.value();
            work.value_hidden.resize(self.value_hidden.len(), 0.0);
            let hidden = &mut work.value_hidden;
            dense_backward(gradient, first + 1, values, &self.value_hidden, batch);
            input_gradient(parameters, first + 1, values, batch, 0.0, hidden);
            relu_backward(&self.value_hidden, hidden);
            dense_backward(gradient, first, hidden, &self.middle, batch);
            input_gradient(parameters, first, hidden, batch, 0.0, &mut work.middle);
            1.0
        } else {
            let start = gradient.layers[shape.value()].weight.start;
            gradient.values[start..].fill(0.0);
            0.0
        };
        state_gradient.resize(self.state.len(), 0.0);
        let h2 = shape.head[1];
        let middles = work.middle.chunks_exact_mut(h2 * batch);
        let activations = self.middle.chunks_exact(h2 * batch);
        let heads = self.heads.iter().zip(middles.zip(activations));
        let mut keep = 0.0;
        for (((head, (hidden2, active2)), first), logits) in
            heads.zip(shape.heads()).zip(logit_gradients)
        {
            work.hidden1.resize(head.hidden1.len(), 0.0);
            let hidden1 = &mut work.hidden1;
            dense_backward(gradient, first + 2, logits, active2, batch);
            input_gradient(parameters, first + 2, logits, batch, from_value, hidden2);
            relu_backward(active2, hidden2);
            dense_backward(gradient, first + 1, hidden2, &head.hidden1, batch);
            input_gradient(parameters, first + 1, hidden2, batch, 0.0, hidden1);
            relu_backward(&head.hidden1, hidden1);
            dense_backward(gradient, first, hidden1, &self.state, batch);
            input_gradient(parameters, first, hidden1, batch, keep, state_gradient);
            keep = 1.0;
        }
    }
}

/// `y = W x + b`; `x [inputs, batch]`, `y [outputs, batch]`.
fn dense(parameters: &Parameters, i: usize, x: &[f32], batch: usize, y: &mut [f32]) {
    let layer = &parameters.layers[i];
    for (row, &bias) in y.chunks_exact_mut(batch).zip(parameters.bias(i)) {
        row.fill(bias);
    }
    let weight = matrix(parameters.weight(i), layer.outputs, layer.inputs);
    product_parallel(y, weight, matrix(x, layer.inputs, batch), 1.0);
}

fn relu(values: &mut [f32]) {
    for v in values {
        *v = v.max(0.0);
    }
}

/// `dW = dy xᵀ`, `db = Σ dy`.
fn dense_backward(gradient: &mut Parameters, i: usize, dy: &[f32], x: &[f32], batch: usize) {
    let (inputs, outputs) = (gradient.layers[i].inputs, gradient.layers[i].outputs);
    let (weight, bias) = gradient.layer_mut(i);
    product_parallel(
        weight,
        matrix(dy, outputs, batch),
        matrix(x, inputs, batch).t(),
        0.0,
    );
    for (b, row) in bias.iter_mut().zip(dy.chunks_exact(batch)) {
        *b = row.iter().sum();
    }
}

/// `dx = keep * dx + Wᵀ dy`.
fn input_gradient(
    parameters: &Parameters,
    i: usize,
    dy: &[f32],
    batch: usize,
    keep: f32,
    dx: &mut [f32],
) {
    let layer = &parameters.layers[i];
    let weight = matrix(parameters.weight(i), layer.outputs, layer.inputs);
    product_parallel(dx, weight.t(), matrix(dy, layer.outputs, batch), keep);
}
