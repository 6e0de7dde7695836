//! A registration in slices, for control loops whose period is shorter than a step.
//!
//! A step looks at every point of a cloud: 150 million instructions for 1024 points on a Cortex-M7. A slice
//! looks at as many as there is time for. What is done between two slices is the caller's; the steps and
//! poses are the same to the bit, however they are sliced.
//!
//! ```
//! # use reagent_core::{Error, Frame, Pose, Registrar, Registration};
//! # fn control() {}
//! # fn registered(registrar: &mut Registrar<'_, '_>, seen: &[[f32; 3]], model: &[[f32; 3]]) -> Result<Pose, Error> {
//! let mut registration = Registration::new();
//! registrar.begin_in(&mut registration, seen, model, Frame::of(model)?, Pose::IDENTITY)?;
//! while registration.steps() < 10 {
//!     registrar.advance(&mut registration, 16); // 16 points of either cloud, or a head
//!     control(); // what cannot wait
//! }
//! # Ok(registration.target_from_source())
//! # }
//! ```

use super::{Frame, Registrar, Registration, Step};
use crate::cloud::Cloud;
use crate::error::Error;
use crate::pose::Pose;

impl Registrar<'_, '_> {
    /// As [`Registrar::start_in`], but the target is embedded by the slices that follow; only the clouds are
    /// looked through here.
    ///
    /// # Errors
    /// As [`Registrar::start_in`].
    pub fn begin_in<'c>(
        &mut self,
        registration: &mut Registration<'c>,
        source: &'c [[f32; 3]],
        target: &'c [[f32; 3]],
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        let (source, target) = (Cloud::F32(source), Cloud::F32(target));
        self.begin_clouds(registration, source, target, frame, initial)
    }

    /// As [`Registrar::begin_in`], of clouds in either format: on a grid they take half of the memory.
    ///
    /// # Errors
    /// As [`Registrar::start_in`].
    pub fn begin_clouds<'c>(
        &mut self,
        registration: &mut Registration<'c>,
        source: Cloud<'c>,
        target: Cloud<'c>,
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        registration.begin(source, target, frame, initial)?;
        registration.unseen = target;
        self.put_in_order(target, &mut registration.order);
        Ok(())
    }

    /// The next slice of work: embeds at most `points` points (but at least one) of the target and then, in each
    /// step, of the source; when all were seen, one of the two heads takes them in, which is as much work as
    /// about 9 points are, or 17 where it looks both ways. `Some` when that was a step.
    ///
    /// If another registration used the registrar meanwhile, the cloud under way is embedded anew.
    pub fn advance(&mut self, registration: &mut Registration<'_>, points: usize) -> Option<Step> {
        let of_target = !registration.unseen.is_empty();
        let cloud = if of_target {
            registration.unseen
        } else {
            registration.source
        };
        let begins = registration.seen == 0 && registration.heads == 0;
        if begins || registration.turn != self.scratch.turn {
            registration.seen = 0;
            registration.heads = 0;
            registration.turn = self.scratch.begin();
        }
        let (seen, points) = (registration.seen, points.max(1));
        if seen < cloud.len() {
            if of_target {
                let end = seen.saturating_add(points).min(cloud.len());
                let view = registration.target_view();
                self.embed_cloud(cloud, &registration.order, seen..end, false, &view);
                registration.seen = end;
            } else {
                self.look(registration, points);
            }
            return None;
        }
        if of_target {
            self.finish_target(registration);
            registration.unseen = Cloud::EMPTY;
            registration.seen = 0;
            return None;
        }
        let head = registration.heads;
        if head == 0 {
            self.finish_source(registration);
        }
        registration.heads = 1 - head.min(1);
        if head > 0 {
            registration.seen = 0;
        }
        let logits = self.logits(registration, head);
        if head == 0 {
            registration.logits_t = logits;
            return None;
        }
        Some(registration.act(&self.policy, registration.logits_t, logits))
    }
}

#[cfg(all(test, feature = "pretrained"))]
mod tests {
    use crate::golden::clouds;
    use crate::kernels::Isa;
    use crate::net::Scratch;
    use crate::{Frame, Policy, Pose, Registrar, Registration};

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
            let expected = [(); 3].map(|()| registrar.step(&mut whole));

            let [mut sliced, mut other] = [Registration::new(), Registration::new()];
            for registration in [&mut sliced, &mut other] {
                registrar
                    .begin_in(registration, &source, &target, frame, Pose::IDENTITY)
                    .expect("two clouds");
            }
            let mut slices = 0;
            for expected in expected {
                let step = loop {
                    slices += 1;
                    if let Some(step) = registrar.advance(&mut sliced, 1 + slices * 7 % 50) {
                        break step;
                    }
                    // Another registration in the same memory costs time, no bit.
                    if slices % 10 == 3 {
                        registrar.advance(&mut other, 20);
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
            .begin_in(
                &mut registration,
                &source,
                &target,
                Frame::IDENTITY,
                Pose::IDENTITY,
            )
            .expect("two clouds");
        let expected = registrar.step(&mut registration);
        registrar.advance(&mut registration, 9);
        let refused = registrar.begin_in(
            &mut registration,
            &source,
            &target[..2],
            Frame::IDENTITY,
            Pose::IDENTITY,
        );
        assert!(refused.is_err());
        assert_eq!(registration.steps(), 1);
        let mut again = Registration::new();
        registrar
            .begin_in(
                &mut again,
                &source,
                &target,
                Frame::IDENTITY,
                Pose::IDENTITY,
            )
            .expect("two clouds");
        assert_eq!(registrar.step(&mut again), expected);
    }
}
