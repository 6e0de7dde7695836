//! The policy heads in integers.

use super::{Feature, QuantScratch, Wide};
use crate::dims::{HEAD, LOGITS, PANELS_TOGETHER};
use crate::kernels::Isa;
use crate::layer::{QuantLayer, Requantise};

/// A target's share of a head's first layer, bias included; a smaller network fills only its outputs.
pub type TargetSums = [i32; HEAD[0]];

/// Computes a target's share of a head's first layer.
pub fn target_sums(
    isa: Isa,
    [fc1, _, _]: &[QuantLayer<'_>; 3],
    target: &Feature,
    sums: &mut TargetSums,
) {
    let features = fc1.codes().inputs() / 2;
    let Some(sums) = sums.get_mut(..fc1.codes().outputs()) else {
        return;
    };
    for (sum, &bias) in sums.iter_mut().zip(fc1.bias()) {
        *sum = bias;
    }
    isa.gemv_codes(fc1.codes(), features, target.planes(features), sums);
}

/// One registration of several that share a pass over a head's weights.
#[derive(Debug)]
pub struct HeadInput<'a> {
    /// Feature of the registration's target.
    pub target: &'a Feature,
    /// The target's share of this head's first layer, if it is cached.
    pub sums: Option<&'a TargetSums>,
    /// Scratch in which the source was embedded.
    pub scratch: &'a mut QuantScratch,
    /// Receives logits, axis-major: of (source, target), then of (target, source) if there is a second place.
    pub ways: &'a mut [[f32; LOGITS]],
}

/// One way of a lane: the two features in order, sums, and the hidden layers.
struct Way<'a> {
    features: [&'a Feature; 2],
    /// The share of the second feature, if it is cached.
    known: Option<&'a TargetSums>,
    sums: &'a mut [i32; HEAD[0]],
    head1: &'a mut Wide<{ HEAD[0] }>,
    head2: &'a mut Wide<{ HEAD[1] }>,
    logits: &'a mut [f32; LOGITS],
}

impl HeadInput<'_> {
    fn ways(&mut self) -> impl Iterator<Item = Way<'_>> {
        let scratch = &mut *self.scratch;
        let source = &scratch.feature;
        let orders = [
            ([source, self.target], self.sums),
            ([self.target, source], None),
        ];
        // The maxima are the feature by now: sums take their memory, which keeps the stack small.
        let (sums, _) = scratch.max.as_chunks_mut();
        let memory = sums
            .iter_mut()
            .zip(&mut scratch.head1)
            .zip(&mut scratch.head2);
        let ways = orders.into_iter().zip(memory).zip(self.ways.iter_mut());
        ways.map(
            |(((features, known), ((sums, head1), head2)), logits)| Way {
                features,
                known,
                sums,
                head1,
                head2,
                logits,
            },
        )
    }
}

/// Computes one head's logits for the sources embedded last.
pub fn logits(isa: Isa, [fc1, fc2, out]: &[QuantLayer<'_>; 3], lanes: &mut [HeadInput<'_>]) {
    let width = fc1.codes().inputs() / 2;
    product(isa, fc1, lanes, |way| {
        let [first, second] = way.features.map(|feature| feature.planes(width));
        let second = way.known.is_none().then_some((width, second));
        Product {
            start: way.known,
            inputs: [Some((0, first)), second],
            sums: way.sums,
        }
    });
    for way in lanes.iter_mut().flat_map(HeadInput::ways) {
        let codes = way.sums.iter().zip(fc1.requantise());
        way.head1.set(codes.map(|(&s, &r)| Requantise(r).apply(s)));
    }
    product(isa, fc2, lanes, |way| Product {
        start: None,
        inputs: [Some((0, way.head1.planes(fc2.codes().inputs()))), None],
        sums: way.sums,
    });
    for way in lanes.iter_mut().flat_map(HeadInput::ways) {
        let codes = way.sums.iter().zip(fc2.requantise());
        way.head2.set(codes.map(|(&s, &r)| Requantise(r).apply(s)));
    }
    product(isa, out, lanes, |way| Product {
        start: None,
        inputs: [Some((0, way.head2.planes(out.codes().inputs()))), None],
        sums: way.sums,
    });
    for way in lanes.iter_mut().flat_map(HeadInput::ways) {
        let sums = way.sums.iter().zip(out.requantise());
        for (logit, (&sum, &scale)) in way.logits.iter_mut().zip(sums) {
            *logit = sum as f32 * f32::from_bits(scale);
        }
    }
}

/// First column of the inputs, and their codes in two planes.
type Inputs<'a> = (usize, [&'a [u8]; 2]);

/// `sums = start + W codes`.
struct Product<'a> {
    /// `None` for the bias.
    start: Option<&'a TargetSums>,
    inputs: [Option<Inputs<'a>>; 2],
    sums: &'a mut [i32; HEAD[0]],
}

/// Computes a product for each way of each lane, some panels at a time: weights come from memory for the first, and from the
/// cache for the others.
fn product(
    isa: Isa,
    layer: &QuantLayer<'_>,
    lanes: &mut [HeadInput<'_>],
    operands: impl for<'w> Fn(Way<'w>) -> Product<'w>,
) {
    for (first, part) in layer.codes().parts(PANELS_TOGETHER) {
        let outputs = first..first + part.outputs();
        for way in lanes.iter_mut().flat_map(HeadInput::ways) {
            let Product {
                start,
                inputs,
                sums,
            } = operands(way);
            let start = start.map_or(layer.bias(), |known| known);
            let (Some(sums), Some(start)) =
                (sums.get_mut(outputs.clone()), start.get(outputs.clone()))
            else {
                continue;
            };
            for (sum, &start) in sums.iter_mut().zip(start) {
                *sum = start;
            }
            for (from, planes) in inputs.into_iter().flatten() {
                isa.gemv_codes(&part, from, planes, sums);
            }
        }
    }
}
