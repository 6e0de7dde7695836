//! The policy heads in f32.

use super::{Feature, FloatScratch, Head};
use crate::dims::{HEAD, LOGITS, PANEL, PANELS_TOGETHER, padded};
use crate::kernels::Isa;

/// A target's share of a head's first layer, bias included; a smaller network fills only its outputs.
pub type TargetHalf = [f32; HEAD[0]];

/// Computes a target's share of a head's first layer: `b + W[:, F..] φ(Y)`, with `F` features (1024 in the paper).
pub fn target_half(isa: Isa, head: &Head<'_>, target: &Feature, half: &mut TargetHalf) {
    let [fc1, _, _] = &head.layers;
    let features = fc1.inputs() / 2;
    if let Some(target) = target.get(..features) {
        isa.gemv(fc1, fc1.bias(), features, target, half);
    }
}

/// One registration of several that share a pass over a head's weights.
#[derive(Debug)]
pub struct HeadInput<'a> {
    /// Feature of the registration's target.
    pub target: &'a Feature,
    /// The target's share of this head's first layer, if it is cached.
    pub half: Option<&'a TargetHalf>,
    /// Scratch in which the source was embedded.
    pub scratch: &'a mut FloatScratch,
    /// Receives logits, axis-major: of (source, target), then of (target, source) if there is a second place.
    pub ways: &'a mut [[f32; LOGITS]],
}

/// Computes one head's logits for the sources embedded last. It applies some panels of a layer at a time: their weights come
/// from memory for the first lane and way, and from the cache for the others.
pub fn logits(isa: Isa, head: &Head<'_>, lanes: &mut [HeadInput<'_>]) {
    let [fc1, fc2, out] = &head.layers;
    let features = fc1.inputs() / 2;
    for (first, part) in fc1.parts() {
        for lane in lanes.iter_mut() {
            let (source, hidden) = lane.scratch.parts();
            let outputs = first..first + part.outputs();
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
                    isa.gemv(&part, part.bias(), features, y, &mut start);
                    &start
                });
                isa.gemv(&part, start, 0, x, head1);
                relu(head1);
            }
        }
    }
    for (first, part) in fc2.parts() {
        for lane in lanes.iter_mut() {
            let (_, hidden) = lane.scratch.parts();
            for [head1, head2] in hidden.into_iter().take(lane.ways.len()) {
                let (Some(x), Some(head2)) = (
                    head1.get(..fc2.inputs()),
                    head2.get_mut(first..first + part.outputs()),
                ) else {
                    continue;
                };
                isa.gemv(&part, part.bias(), 0, x, head2);
                relu(head2);
            }
        }
    }
    for lane in lanes {
        let (_, hidden) = lane.scratch.parts();
        for (logits, [_, head2]) in lane.ways.iter_mut().zip(hidden) {
            let mut padded_logits = [0.0; padded(LOGITS)];
            if let Some(x) = head2.get(..out.inputs()) {
                isa.gemv(out, out.bias(), 0, x, &mut padded_logits);
            }
            for (logit, value) in logits.iter_mut().zip(padded_logits) {
                *logit = value;
            }
        }
    }
}

fn relu(values: &mut [f32]) {
    for v in values {
        *v = v.max(0.0);
    }
}
