//! Several registrations in step, on hosts: the heads' weights, which one registration reads as fast as
//! memory gives them, are read once for all.

use super::{Registrar, Registration, Step, TargetState};
use crate::dims::LOGITS;
use crate::kernels::Isa;
use crate::net::{self, Memory, Scratch};
use crate::quant;
use crate::weights::{Network, Policy};

/// Runs `N` registrations in step with one policy on caller-owned working memory.
#[derive(Debug)]
pub struct Team<'w, 's, const N: usize> {
    isa: Isa,
    policy: Policy<'w>,
    scratch: &'s mut [Scratch; N],
}

impl<'w, 's, const N: usize> Team<'w, 's, N> {
    /// A team on given kernels.
    pub fn with_isa(isa: Isa, policy: Policy<'w>, scratch: &'s mut [Scratch; N]) -> Self {
        Team {
            isa,
            policy,
            scratch,
        }
    }

    /// The registrar of one lane, to start a registration with.
    pub fn lane(&mut self, lane: usize) -> Option<Registrar<'w, '_>> {
        let scratch = self.scratch.get_mut(lane)?;
        Some(Registrar::with_isa(self.isa, self.policy, scratch))
    }

    /// One step of each registration, as [`Registrar::step`] takes it: in 8-bit integers to the bit. Slices of
    /// a step that were under way ([`Registrar::advance`]) begin anew.
    pub fn step(&mut self, registrations: &mut [Registration<'_>; N]) -> [Step; N] {
        for (scratch, registration) in self.scratch.iter_mut().zip(registrations.iter_mut()) {
            Registrar::with_isa(self.isa, self.policy, scratch).observe(registration);
        }
        let decision = self.policy.decision;
        let mut translation = self.logits(registrations, 0).into_iter();
        let mut rotation = self.logits(registrations, 1).into_iter();
        registrations.each_mut().map(|registration| {
            let mut next = || Some([translation.next()?, rotation.next()?]);
            let [logits_t, logits_r] = next().unwrap_or([[0.0; LOGITS]; 2]);
            registration.act(decision, logits_t, logits_r)
        })
    }

    /// Logits of a head, translation or rotation, for the sources that are embedded.
    fn logits(&mut self, registrations: &[Registration<'_>; N], head: usize) -> [[f32; LOGITS]; N] {
        let mut all = [[0.0; LOGITS]; N];
        let lanes = self.scratch.iter_mut().zip(registrations).zip(&mut all);
        match &self.policy.network {
            Network::F32(network) => {
                let mut lanes: heapless::Vec<net::Lane<'_>, N> = lanes
                    .filter_map(|((scratch, registration), logits)| {
                        let Memory::F32(scratch) = &mut scratch.memory else {
                            return None;
                        };
                        let TargetState::F32(halves) = &registration.target else {
                            return None;
                        };
                        let target = halves.get(head)?;
                        Some(net::Lane {
                            target,
                            scratch,
                            logits,
                        })
                    })
                    .collect();
                if let Some(head) = [&network.translation, &network.rotation].get(head) {
                    net::logits(self.isa, head, &mut lanes);
                }
            }
            Network::Int8(network) => {
                let mut lanes: heapless::Vec<quant::Lane<'_>, N> = lanes
                    .filter_map(|((scratch, registration), logits)| {
                        let Memory::Int8(scratch) = &mut scratch.memory else {
                            return None;
                        };
                        let TargetState::Int8(sums) = &registration.target else {
                            return None;
                        };
                        let target = sums.get(head)?;
                        Some(quant::Lane {
                            target,
                            scratch,
                            logits,
                        })
                    })
                    .collect();
                if let Some(head) = network.heads.get(head) {
                    quant::logits(self.isa, head, &mut lanes);
                }
            }
        }
        all
    }
}

#[cfg(all(test, feature = "pretrained"))]
mod tests {
    use super::*;
    use crate::golden::clouds;
    use crate::{Frame, Pose};

    #[test]
    fn a_team_takes_the_steps_that_each_takes_alone() {
        let policy = Policy::pretrained().expect("a sound policy");
        let [source, target] = clouds();
        let sources = [&source[..], &source[..100], &target[..]];
        for isa in Isa::all() {
            let mut scratch = [(); 3].map(|()| Scratch::new());
            let mut team = Team::with_isa(isa, policy, &mut scratch);
            let mut registrations = [0, 1, 2].map(|lane| {
                let mut registrar = team.lane(lane).expect("three lanes");
                registrar
                    .start(sources[lane], &target, Frame::IDENTITY, Pose::IDENTITY)
                    .expect("two clouds")
            });
            let mut alone = Scratch::new();
            let mut registrar = Registrar::with_isa(isa, policy, &mut alone);
            let mut expected = sources.map(|source| {
                registrar
                    .start(source, &target, Frame::IDENTITY, Pose::IDENTITY)
                    .expect("two clouds")
            });
            for _ in 0..4 {
                let steps = team.step(&mut registrations);
                assert_eq!(steps, expected.each_mut().map(|r| registrar.step(r)));
            }
        }
    }
}
