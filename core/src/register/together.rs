//! Several registrations in lockstep, for hosts: the heads' weights, which limit a single registration to the speed of memory,
//! are read once for all.

use super::{Registrar, Registration, Step, heads};
use crate::error::Error;
use crate::kernels::Isa;
use crate::net::Scratch;
use crate::weights::Policy;

/// Runs `N` registrations in lockstep with one policy on caller-owned working memory.
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

    /// Takes one step of each registration. In 8-bit integers, it is the step of [`Registrar::step`] to the bit. Partly sliced
    /// steps ([`Registrar::advance`]) begin anew.
    ///
    /// # Errors
    /// As [`Registrar::step`], for each registration. One that was never started costs nothing.
    pub fn step(&mut self, registrations: &mut [Registration<'_>; N]) -> [Result<Step, Error>; N] {
        let Team {
            isa,
            policy,
            scratch,
        } = self;
        for (scratch, registration) in scratch.iter_mut().zip(registrations.iter_mut()) {
            // The heads report the same errors.
            let mut registrar = Registrar::with_isa(*isa, *policy, scratch);
            registrar.observe(registration).ok();
        }
        let [translation, rotation] = [heads::TRANSLATION, heads::ROTATION]
            .map(|head| heads::logits(*isa, policy, head, scratch, registrations));
        let mut logits = translation.into_iter().zip(rotation);
        registrations.each_mut().map(|registration| {
            let (logits_t, logits_r) = logits.next().ok_or(Error::NotStarted)?;
            Ok(registration.act(policy, logits_t?, logits_r?))
        })
    }
}

#[cfg(all(test, feature = "pretrained", feature = "pretrained-int8"))]
mod tests {
    use super::*;
    use crate::dims::STEPS_ONE_WAY;
    use crate::golden::clouds;
    use crate::{Decision, Error, Frame, Pose};

    #[test]
    fn a_team_takes_the_steps_that_each_takes_alone() {
        let policies = [Policy::pretrained(), Policy::pretrained_int8()];
        let [source, target] = clouds();
        let sources = [&source[..], &source[..100], &target[..]];
        for policy in policies.map(|policy| policy.expect("a sound policy")) {
            let policy = Policy {
                decision: Decision::BothWays,
                rescan: 3,
                ..policy
            };
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
                for _ in 0..STEPS_ONE_WAY + 2 {
                    let steps = team.step(&mut registrations);
                    let alone = expected.each_mut().map(|r| registrar.step(r));
                    assert_eq!(steps, alone, "{}", isa.name());
                }
                let poses = registrations.each_ref().map(|r| r.target_from_source());
                assert_eq!(poses, expected.map(|r| r.target_from_source()));
            }
        }
    }

    #[test]
    fn a_place_that_was_refused_changes_nothing_for_the_others() {
        let policy = Policy {
            decision: Decision::BothWays,
            ..Policy::pretrained_int8().expect("a sound policy")
        };
        let [source, target] = clouds();
        let mut scratch = [(); 2].map(|()| Scratch::new());
        let mut team = Team::with_isa(Isa::best(), policy, &mut scratch);
        let mut registrations = [const { Registration::new() }; 2];
        let started: [Result<(), Error>; 2] = [0, 1].map(|lane| {
            let source = if lane == 0 { &[] } else { &source[..] };
            let mut registrar = team.lane(lane).expect("two lanes");
            let place = &mut registrations[lane];
            registrar.start_in(place, source, &target, Frame::IDENTITY, Pose::IDENTITY)
        });
        assert_eq!(started, [Err(Error::EmptyCloud), Ok(())]);
        let mut alone = Scratch::new();
        let mut registrar = Registrar::new(policy, &mut alone);
        let mut expected = registrar
            .start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)
            .expect("two clouds");
        for _ in 0..STEPS_ONE_WAY + 1 {
            let [refused, step] = team.step(&mut registrations);
            assert_eq!(refused, Err(Error::NotStarted));
            assert_eq!(step, registrar.step(&mut expected));
        }
    }

    #[test]
    fn one_that_copies_the_progress_of_another_sees_what_that_one_sees() {
        let [exact, integers] = [Policy::pretrained(), Policy::pretrained_int8()]
            .map(|policy| policy.expect("a sound policy"));
        let exact = Policy {
            decision: Decision::BothWays,
            ..exact
        };
        let [source, target] = clouds();
        let mut scratch = [(); 2].map(|()| Scratch::new());
        let [a, b] = &mut scratch;
        let mut registrar = Registrar::new(exact, a);
        let mut other = Registrar::new(integers, b);
        let start = |registrar: &mut Registrar<'_, '_>| {
            registrar
                .start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)
                .expect("two clouds")
        };
        let mut leader = start(&mut other);
        let mut follower = start(&mut registrar);
        for steps in 1..=STEPS_ONE_WAY + 2 {
            registrar.step(&mut follower).expect("started");
            registrar.step(&mut follower).expect("started");
            other.step(&mut leader).expect("started");
            follower.copy_progress_from(&leader);
            assert_eq!(follower.steps(), steps);
            assert_eq!(follower.outcome(), leader.outcome());
        }
        let mut again = start(&mut registrar);
        again.copy_progress_from(&leader);
        assert_eq!(registrar.step(&mut follower), registrar.step(&mut again));
    }
}
