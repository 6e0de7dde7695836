//! The heads of registrations in step: their weights are read once for all of them, and for both ways.

use super::{Registration, TargetFeature};
use crate::decision::both_ways;
use crate::dims::LOGITS;
use crate::kernels::Isa;
use crate::net::{self, Memory, Scratch};
use crate::quant;
use crate::weights::{Network, Policy};

/// Logits of a head, translation or rotation, for the sources that are embedded.
pub(super) fn logits<const N: usize>(
    isa: Isa,
    policy: &Policy<'_>,
    head: usize,
    scratch: &mut [Scratch; N],
    registrations: &[Registration<'_>; N],
) -> [[f32; LOGITS]; N] {
    let mut all = registrations.each_ref().map(|registration| Looked {
        ways: [[0.0; LOGITS]; 2],
        count: policy.decision.ways(registration.steps),
    });
    let places = scratch.iter_mut().zip(registrations).zip(&mut all);
    let places = places.filter(|((_, registration), _)| registration.has_begun());
    // Memory or a target of another number format: a registration that another registrar started, which takes no
    // step here.
    match &policy.network {
        Network::F32(network) => {
            let mut lanes: heapless::Vec<net::Lane<'_>, N> = heapless::Vec::new();
            for ((scratch, registration), looked) in places {
                if let Memory::F32(scratch) = &mut scratch.memory
                    && let TargetFeature::F32(target, halves) = &registration.target
                {
                    let (half, ways) = (halves.get(head), looked.places());
                    // There is room for all.
                    lanes
                        .push(net::Lane {
                            target,
                            half,
                            scratch,
                            ways,
                        })
                        .ok();
                }
            }
            if let Some(head) = [&network.translation, &network.rotation].get(head) {
                net::logits(isa, head, &mut lanes);
            }
        }
        Network::Int8(network) => {
            let mut lanes: heapless::Vec<quant::Lane<'_>, N> = heapless::Vec::new();
            for ((scratch, registration), looked) in places {
                if let Memory::Int8(scratch) = &mut scratch.memory
                    && let TargetFeature::Int8(target, sums) = &registration.target
                {
                    let (sums, ways) = (sums.get(head), looked.places());
                    // There is room for all.
                    lanes
                        .push(quant::Lane {
                            target,
                            sums,
                            scratch,
                            ways,
                        })
                        .ok();
                }
            }
            if let Some(head) = network.heads.get(head) {
                quant::logits(isa, head, &mut lanes);
            }
        }
    }
    all.map(|looked| looked.logits())
}

/// What a head says of one registration.
struct Looked {
    ways: [[f32; LOGITS]; 2],
    count: usize,
}

impl Looked {
    fn places(&mut self) -> &mut [[f32; LOGITS]] {
        self.ways.get_mut(..self.count).unwrap_or_default()
    }

    fn logits(self) -> [f32; LOGITS] {
        let [forth, back] = self.ways;
        match self.count {
            1 => forth,
            _ => both_ways(&forth, &back),
        }
    }
}
