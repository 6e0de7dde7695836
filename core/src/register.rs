//! A registration, step by step: observe, embed, decide, accumulate, verdict.
//!
//! - [`Registration`] is the state: the pose so far, and how its clouds are seen under it.
//! - [`Registrar`] takes its steps: `look` embeds points, `heads` turns features into logits, `phase` slices a step.
//! - [`Team`] steps several registrations together.

use crate::cloud::Cloud;
use crate::dims::LOGITS;
use crate::error::Error;
use crate::frame::Frame;
use crate::kernels::Isa;
use crate::net::Scratch;
use crate::pose::Pose;
use crate::steps::Action;
use crate::verdict::Verdict;
use crate::weights::Policy;

mod heads;
mod look;
mod phase;
mod registration;
mod target;
#[cfg(all(
    test,
    feature = "pretrained",
    feature = "pretrained-int8",
    feature = "pretrained-compact"
))]
mod tests;
mod together;

pub use registration::Registration;
pub use together::Team;

/// What the policy saw and did in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The action taken.
    pub action: Action,
    /// Translation logits, axis-major.
    pub logits_t: [f32; LOGITS],
    /// Rotation logits, axis-major.
    pub logits_r: [f32; LOGITS],
}

/// Result of a whole registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Plain rigid transform, in the clouds' own units.
    pub target_from_source: Pose,
    /// Steps taken.
    pub steps: usize,
    /// How the steps ended.
    pub verdict: Verdict,
}

/// Runs registrations with one policy on caller-owned working memory.
#[derive(Debug)]
pub struct Registrar<'w, 's> {
    isa: Isa,
    pub(crate) policy: Policy<'w>,
    scratch: &'s mut Scratch,
}

impl<'w, 's> Registrar<'w, 's> {
    /// A registrar on the fastest kernels of this machine.
    pub fn new(policy: Policy<'w>, scratch: &'s mut Scratch) -> Self {
        Self::with_isa(Isa::best(), policy, scratch)
    }

    /// A registrar on given kernels.
    pub fn with_isa(isa: Isa, policy: Policy<'w>, scratch: &'s mut Scratch) -> Self {
        Registrar {
            isa,
            policy,
            scratch,
        }
    }

    /// Checks both clouds and embeds the target, once for the whole registration.
    ///
    /// `initial` is a plain estimate of `target_from_source` in the clouds' own units.
    ///
    /// # Errors
    /// As [`Cloud::check`], [`Frame::checked`]; [`Error::BadPose`] for an `initial` that is not rigid.
    pub fn start<'c>(
        &mut self,
        source: &'c [[f32; 3]],
        target: &'c [[f32; 3]],
        frame: Frame,
        initial: Pose,
    ) -> Result<Registration<'c>, Error> {
        let mut registration = Registration::new();
        self.start_in(&mut registration, source, target, frame, initial)?;
        Ok(registration)
    }

    /// As [`Registrar::start`], in place, which saves moving four of a
    /// registration's kilobytes. A refused start leaves the registration unchanged.
    ///
    /// # Errors
    /// As [`Registrar::start`].
    pub fn start_in<'c>(
        &mut self,
        registration: &mut Registration<'c>,
        source: &'c [[f32; 3]],
        target: &'c [[f32; 3]],
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        let (source, target) = (Cloud::F32(source), Cloud::F32(target));
        registration.reset(&self.policy, source, target, frame, initial)?;
        while registration.is_at_target() {
            self.advance(registration, usize::MAX)?;
        }
        Ok(())
    }

    /// Takes one step: observes the source under the current pose, decides, accumulates.
    ///
    /// # Errors
    /// [`Error::NotStarted`] for a registration that was not started, or was started with another policy.
    pub fn step(&mut self, registration: &mut Registration<'_>) -> Result<Step, Error> {
        loop {
            if let Some(step) = self.advance(registration, usize::MAX)? {
                return Ok(step);
            }
        }
    }

    /// Runs a whole registration of `steps` steps.
    ///
    /// # Errors
    /// As [`Registrar::start`].
    pub fn register(
        &mut self,
        source: &[[f32; 3]],
        target: &[[f32; 3]],
        frame: Frame,
        initial: Pose,
        steps: usize,
    ) -> Result<Outcome, Error> {
        let mut registration = self.start(source, target, frame, initial)?;
        for _ in 0..steps {
            self.step(&mut registration)?;
        }
        Ok(registration.outcome())
    }
}
