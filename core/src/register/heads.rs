//! The heads for several registrations in lockstep: their weights are read once for all of them, and for both ways.

use super::Registration;
use crate::decision::both_ways;
use crate::dims::LOGITS;
use crate::error::Error;
use crate::float;
use crate::kernels::Isa;
use crate::net::Scratch;
use crate::numbers::Numbers;
use crate::quant;
use crate::weights::Policy;

/// Index of the translation head.
pub(super) const TRANSLATION: usize = 0;
/// Index of the rotation head.
pub(super) const ROTATION: usize = 1;

/// Logits of a head for the embedded sources; [`Error::NotStarted`] for registrations that were not started with the policy.
pub(super) fn logits<const N: usize>(
    isa: Isa,
    policy: &Policy<'_>,
    head: usize,
    scratch: &mut [Scratch; N],
    registrations: &[Registration<'_>; N],
) -> [Result<[f32; LOGITS], Error>; N] {
    let mut all = registrations.each_ref().map(|registration| Looked {
        ways: [[0.0; LOGITS]; 2],
        count: policy.decision.ways(registration.steps),
        error: Some(Error::NotStarted),
    });
    let places = scratch.iter_mut().zip(registrations).zip(&mut all);
    let places = places.filter(|((_, registration), _)| registration.check(policy).is_ok());
    match &policy.network {
        Numbers::F32(network) => {
            let mut lanes: heapless::Vec<float::HeadInput<'_>, N> = heapless::Vec::new();
            for ((scratch, registration), looked) in places {
                if let Some(target) = registration.target.as_floats() {
                    let lane = float::HeadInput {
                        target: &target.feature,
                        half: target.halves.get(head),
                        scratch: scratch.floats(),
                        ways: looked.places(),
                    };
                    // The capacity is `N`.
                    lanes.push(lane).ok();
                }
            }
            if let Some(head) = [&network.translation, &network.rotation].get(head) {
                float::logits(isa, head, &mut lanes);
            }
        }
        Numbers::Int8(network) => {
            let mut lanes: heapless::Vec<quant::HeadInput<'_>, N> = heapless::Vec::new();
            for ((scratch, registration), looked) in places {
                if let Some(target) = registration.target.as_integers() {
                    let lane = quant::HeadInput {
                        target: &target.feature,
                        sums: target.sums.get(head),
                        scratch: scratch.integers(),
                        ways: looked.places(),
                    };
                    // The capacity is `N`.
                    lanes.push(lane).ok();
                }
            }
            if let Some(head) = network.heads.get(head) {
                quant::logits(isa, head, &mut lanes);
            }
        }
    }
    all.map(Looked::logits)
}

/// Output of a head for one registration.
struct Looked {
    ways: [[f32; LOGITS]; 2],
    count: usize,
    /// Why there is no output.
    error: Option<Error>,
}

impl Looked {
    /// Places for the logits, one for each way.
    fn places(&mut self) -> &mut [[f32; LOGITS]] {
        self.error = None;
        self.ways.get_mut(..self.count).unwrap_or_default()
    }

    fn logits(self) -> Result<[f32; LOGITS], Error> {
        let [forth, back] = self.ways;
        match (self.error, self.count) {
            (Some(error), _) => Err(error),
            (None, 1) => Ok(forth),
            (None, _) => Ok(both_ways(&forth, &back)),
        }
    }
}
