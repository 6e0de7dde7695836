//! The policy heads in f32.

use super::{Feature, FloatScratch, Head};
use crate::dims::{HEAD, LOGITS, PANEL, PANELS_TOGETHER, padded};
use crate::kernels::Isa;

/// What a target adds to the first layer of a head, bias included; as much of it as the layer has outputs.
pub type TargetHalf = [f32; HEAD[0]];

/// What a target adds to the first layer of a head: `b + W[:, 1024..] φ(Y)`.
pub fn target_half(isa: Isa, head: &Head<'_>, target: &Feature, half: &mut TargetHalf) {
    let [fc1, _, _] = &head.layers;
    let features = fc1.inputs() / 2;
    if let Some(target) = target.get(..features) {
        isa.gemv(fc1, fc1.bias(), features, target, half);
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
