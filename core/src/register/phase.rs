//! A registration in slices, for control loops whose period is shorter than a step.
//!
//! A step looks at every point of a cloud, which takes a microcontroller longer than a control loop may wait. A slice looks at
//! as many points as there is time for. Between slices, the caller does its own work. The steps and poses are the same to the
//! bit, however they are sliced.
//!
//! ```
//! # use reagent_core::{Cloud, Error, Frame, Pose, Registrar, Registration};
//! # fn control() {}
//! # fn registered(registrar: &mut Registrar<'_, '_>, seen: &[[f32; 3]], model: &[[f32; 3]]) -> Result<Pose, Error> {
//! let mut registration = Registration::new();
//! let (source, target) = (Cloud::F32(seen), Cloud::F32(model));
//! registrar.begin(&mut registration, source, target, Frame::of(model)?, Pose::IDENTITY)?;
//! while registration.steps() < 10 {
//!     registrar.advance(&mut registration, 16)?; // 16 points of either cloud, or a head
//!     control(); // what cannot wait
//! }
//! # Ok(registration.target_from_source())
//! # }
//! ```

use super::registration::Phase;
use super::{Registrar, Registration, Step, heads};
use crate::cloud::Cloud;
use crate::dims::LOGITS;
use crate::error::Error;
use crate::frame::Frame;
use crate::pose::Pose;

impl Registrar<'_, '_> {
    /// As [`Registrar::start_in`], but only checks the clouds and leaves the target's embedding to the slices that follow.
    /// Clouds on a grid take half the memory.
    ///
    /// # Errors
    /// As [`Registrar::start_in`].
    pub fn begin<'c>(
        &mut self,
        registration: &mut Registration<'c>,
        source: Cloud<'c>,
        target: Cloud<'c>,
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        registration.reset(&self.policy, source, target, frame, initial)
    }

    /// Does the next slice of work: embeds at most `points` points (at least one) of the target and then, in each step, of the
    /// source. Once all are in, a slice runs one of the two heads, which costs at most as many multiply-adds as 9 points, or 17
    /// if the policy looks both ways. Returns `Some` when that completes a step.
    ///
    /// If another registration used the registrar in between, the current cloud is embedded again from its start.
    ///
    /// # Errors
    /// [`Error::NotStarted`] for a registration that was not started, or was started with another policy.
    pub fn advance(
        &mut self,
        registration: &mut Registration<'_>,
        points: usize,
    ) -> Result<Option<Step>, Error> {
        registration.check(&self.policy)?;
        if registration.generation != self.scratch.generation() {
            registration.phase.restart();
        }
        if registration.phase.is_at_start() {
            registration.generation = self.scratch.claim(&self.policy.network);
        }
        let points = points.max(1);
        match registration.phase {
            Phase::Target { seen } if seen < registration.whole_target.len() => {
                let seen = self.look_at_target(registration, seen, points);
                registration.phase = Phase::Target { seen };
            }
            Phase::Target { .. } => {
                self.finish_target(registration);
                registration.phase = Phase::START;
            }
            Phase::Source { seen } if seen < registration.source.len() => {
                let seen = self.look(registration, seen, points);
                registration.phase = Phase::Source { seen };
            }
            Phase::Source { .. } => {
                self.finish_source(registration);
                let logits_t = self.logits(registration, heads::TRANSLATION)?;
                registration.phase = Phase::Head { logits_t };
            }
            Phase::Head { logits_t } => {
                let logits_r = self.logits(registration, heads::ROTATION)?;
                registration.phase = Phase::START;
                return Ok(Some(registration.act(&self.policy, logits_t, logits_r)));
            }
        }
        Ok(None)
    }

    /// Embeds the source under the current pose, and first the target if that is still to be done.
    pub(super) fn observe(&mut self, registration: &mut Registration<'_>) -> Result<(), Error> {
        registration.check(&self.policy)?;
        while registration.is_at_target() {
            self.advance(registration, usize::MAX)?;
        }
        registration.phase = Phase::START;
        registration.generation = self.scratch.claim(&self.policy.network);
        let seen = self.look(registration, 0, usize::MAX);
        registration.phase = Phase::Source { seen };
        self.finish_source(registration);
        Ok(())
    }

    /// Logits of a head for the embedded source.
    fn logits(
        &mut self,
        registration: &Registration<'_>,
        head: usize,
    ) -> Result<[f32; LOGITS], Error> {
        let scratch = core::array::from_mut(&mut *self.scratch);
        let registration = core::array::from_ref(registration);
        let [logits] = heads::logits(self.isa, &self.policy, head, scratch, registration);
        logits
    }
}

#[cfg(all(test, feature = "pretrained"))]
mod tests {
    use crate::golden::clouds;
    use crate::kernels::Isa;
    use crate::net::Scratch;
    use crate::{Cloud, Frame, Policy, Pose, Registrar, Registration};

    #[test]
    fn slices_of_any_size_take_the_same_steps() {
        let policy = Policy {
            rescan: 2,
            ..Policy::pretrained().expect("a sound policy")
        };
        let [source, target] = clouds();
        for isa in Isa::all() {
            let mut scratch = Scratch::new();
            let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
            let frame = Frame::of(&target).expect("a cloud");
            let mut whole = registrar
                .start(&source, &target, frame, Pose::IDENTITY)
                .expect("two clouds");
            let expected = [(); 3].map(|()| registrar.step(&mut whole).expect("started"));

            let [mut sliced, mut other] = [Registration::new(), Registration::new()];
            for registration in [&mut sliced, &mut other] {
                registrar
                    .begin(
                        registration,
                        Cloud::F32(&source),
                        Cloud::F32(&target),
                        frame,
                        Pose::IDENTITY,
                    )
                    .expect("two clouds");
            }
            let mut slices = 0;
            for expected in expected {
                let step = loop {
                    slices += 1;
                    if let Some(step) = registrar
                        .advance(&mut sliced, 1 + slices * 7 % 50)
                        .expect("started")
                    {
                        break step;
                    }
                    // Another registration in the same memory costs time but changes no bit.
                    if slices % 10 == 3 {
                        registrar.advance(&mut other, 20).expect("started");
                    }
                };
                assert_eq!(step, expected, "{}", isa.name());
            }
            assert!(slices > 20);
            assert_eq!(sliced.target_from_source(), whole.target_from_source());
        }
    }

    #[test]
    fn a_refused_begin_leaves_the_registration_as_it_was() {
        let policy = Policy::pretrained().expect("a sound policy");
        let [source, target] = clouds();
        let mut scratch = Scratch::new();
        let mut registrar = Registrar::new(policy, &mut scratch);
        let mut registration = Registration::new();
        registrar
            .begin(
                &mut registration,
                Cloud::F32(&source),
                Cloud::F32(&target),
                Frame::IDENTITY,
                Pose::IDENTITY,
            )
            .expect("two clouds");
        let expected = registrar.step(&mut registration);
        registrar.advance(&mut registration, 9).expect("started");
        let refused = registrar.begin(
            &mut registration,
            Cloud::F32(&source),
            Cloud::F32(&target[..2]),
            Frame::IDENTITY,
            Pose::IDENTITY,
        );
        assert!(refused.is_err());
        assert_eq!(registration.steps(), 1);
        let mut again = Registration::new();
        registrar
            .begin(
                &mut again,
                Cloud::F32(&source),
                Cloud::F32(&target),
                Frame::IDENTITY,
                Pose::IDENTITY,
            )
            .expect("two clouds");
        assert_eq!(registrar.step(&mut again), expected);
    }
}
