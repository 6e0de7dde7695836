//! The state of a registration.

use super::target::Target;
use super::{Outcome, Step};
use crate::cloud::Cloud;
use crate::critical::Critical;
use crate::dims::LOGITS;
use crate::error::Error;
use crate::frame::Frame;
use crate::order::Order;
use crate::pose::Pose;
use crate::steps::Action;
use crate::verdict::Verdict;
use crate::view::View;
use crate::weights::Policy;
use glam::Vec3;

/// What the next slice of a registration does.
#[derive(Clone, Debug)]
pub(super) enum Phase {
    /// Embeds the target; `seen` points are done.
    Target { seen: usize },
    /// Embeds the source, of which `seen` points are done, then runs the translation head.
    Source { seen: usize },
    /// Runs the rotation head, and acts.
    Head { logits_t: [f32; LOGITS] },
}

impl Phase {
    /// The first phase of a step.
    pub(super) const START: Phase = Phase::Source { seen: 0 };

    /// Whether no point of the current cloud is embedded yet.
    pub(super) fn is_at_start(&self) -> bool {
        matches!(self, Phase::Target { seen: 0 } | Phase::Source { seen: 0 })
    }

    /// Returns to the first point of the current cloud.
    pub(super) fn restart(&mut self) {
        match self {
            Phase::Target { seen } | Phase::Source { seen } => *seen = 0,
            Phase::Head { .. } => *self = Phase::START,
        }
    }
}

/// A registration in progress: the accumulated pose, and what stays constant over its steps.
#[derive(Clone, Debug)]
pub struct Registration<'c> {
    pub(super) source: Cloud<'c>,
    /// The whole target, for a policy that chooses among its points again.
    pub(super) whole_target: Cloud<'c>,
    pub(super) phase: Phase,
    /// Generation of the scratch in which the current cloud is embedded.
    pub(super) generation: u32,
    /// Order in which the current cloud's points are embedded.
    pub(super) order: Order,
    /// Critical points, for steps that do not look at all points.
    pub(super) critical: Critical,
    pub(super) target: Target,
    /// Checksum of the policy that the registration was started with.
    policy: u32,
    /// Centroid `μ` of the source in its own units, without the points cut off under the initial pose.
    centroid: Vec3,
    frame: Frame,
    /// Disentangled accumulator, translation in normalised units.
    accumulated: Pose,
    pub(super) steps: usize,
    /// The last two actions; "stop" before the first.
    before: Action,
    last: Action,
    is_settled: bool,
}

impl<'c> Registration<'c> {
    /// An empty registration to start in: see [`super::Registrar::start_in`].
    pub const fn new() -> Self {
        Registration {
            source: Cloud::EMPTY,
            whole_target: Cloud::EMPTY,
            phase: Phase::START,
            generation: 0,
            order: Order::NONE,
            critical: Critical::NONE,
            target: Target::NONE,
            policy: 0,
            centroid: Vec3::ZERO,
            frame: Frame::IDENTITY,
            accumulated: Pose::IDENTITY,
            steps: 0,
            before: Action::STOP,
            last: Action::STOP,
            is_settled: false,
        }
    }

    /// Checks all inputs and starts anew: no step taken, the target not embedded.
    pub(super) fn reset(
        &mut self,
        policy: &Policy<'_>,
        source: Cloud<'c>,
        target: Cloud<'c>,
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        source.check()?;
        target.check()?;
        let (frame, initial) = (frame.checked()?, initial.checked()?);
        let centroid = policy.sight.cut.centroid(source, &frame, &initial);
        let initial = initial.to_disentangled(centroid);
        self.source = source;
        self.whole_target = target;
        self.phase = Phase::Target { seen: 0 };
        self.order.clear();
        self.policy = policy.checksum;
        self.centroid = centroid;
        self.frame = frame;
        self.accumulated = Pose {
            rotation: initial.rotation,
            translation: initial.translation / frame.scale,
        };
        self.steps = 0;
        self.before = Action::STOP;
        self.last = Action::STOP;
        self.is_settled = false;
        Ok(())
    }

    /// Refuses a registration that was not started with this policy. An empty source means none was started.
    pub(super) fn check(&self, policy: &Policy<'_>) -> Result<(), Error> {
        if self.source.is_empty() || self.policy != policy.checksum {
            return Err(Error::NotStarted);
        }
        Ok(())
    }

    /// The pose so far as a plain rigid transform in the clouds' own units (to-global).
    pub fn target_from_source(&self) -> Pose {
        Pose {
            rotation: self.accumulated.rotation,
            translation: self.accumulated.translation * self.frame.scale,
        }
        .to_global(self.centroid)
    }

    /// Steps taken so far.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The result if no further step is taken.
    pub fn outcome(&self) -> Outcome {
        Outcome {
            target_from_source: self.target_from_source(),
            steps: self.steps,
            verdict: self.verdict(),
        }
    }

    /// Takes over the progress of another registration of the same clouds, perhaps with another policy, to compare what two
    /// policies do next.
    pub fn copy_progress_from(&mut self, other: &Registration<'_>) {
        self.accumulated = other.accumulated;
        self.critical.clone_from(&other.critical);
        self.steps = other.steps;
        self.before = other.before;
        self.last = other.last;
        self.is_settled = other.is_settled;
    }

    /// Number of points that the next step looks at.
    pub fn points_ahead(&self, policy: &Policy<'_>) -> usize {
        if policy.sees_all(self.steps) {
            self.source.len()
        } else {
            self.critical.len()
        }
    }

    /// Whether slices still embed the target ([`super::Registrar::advance`]).
    pub fn is_at_target(&self) -> bool {
        matches!(self.phase, Phase::Target { .. })
    }

    /// Whether further steps would change nothing: the last one looked at all points, in all the ways in which the policy ever
    /// looks, and chose "stop" on every axis.
    pub fn is_settled(&self) -> bool {
        self.is_settled
    }

    /// Verdict if no further step is taken.
    pub fn verdict(&self) -> Verdict {
        if self.steps == 0 {
            return Verdict::StepLimit;
        }
        Verdict::of_actions(self.before, self.last)
    }

    /// View under which the policy sees the target: `(x - centre)/s`.
    pub(super) fn target_view(&self) -> View {
        View {
            origin: self.frame.centre,
            map: Pose {
                rotation: Pose::IDENTITY.rotation * (1.0 / self.frame.scale),
                translation: Vec3::ZERO,
            },
        }
    }

    /// View under which the policy sees the source now, equation 9 in the target's frame: `R (x - μ)/s + (μ - centre)/s + t`.
    pub(super) fn source_view(&self) -> View {
        let scale = 1.0 / self.frame.scale;
        View {
            origin: self.centroid,
            map: Pose {
                rotation: self.accumulated.rotation * scale,
                translation: (self.centroid - self.frame.centre) * scale
                    + self.accumulated.translation,
            },
        }
    }

    /// Takes the action that follows from both heads' logits.
    pub(super) fn act(
        &mut self,
        policy: &Policy<'_>,
        logits_t: [f32; LOGITS],
        logits_r: [f32; LOGITS],
    ) -> Step {
        let decision = policy.decision;
        let action = Action {
            translation: decision.steps(&logits_t),
            rotation: decision.steps(&logits_r),
        };
        self.accumulated = self.accumulated.accumulate(action.update());
        self.is_settled = action == Action::STOP
            && policy.sees_all(self.steps)
            && decision.ways(self.steps) == decision.ways(usize::MAX)
            && (policy.sight.focus == 0 || policy.sight.refocuses(self.steps));
        self.steps += 1;
        if policy.sight.refocuses(self.steps) && !self.is_settled {
            self.phase = Phase::Target { seen: 0 };
        }
        self.before = core::mem::replace(&mut self.last, action);
        Step {
            action,
            logits_t,
            logits_r,
        }
    }
}

impl Default for Registration<'_> {
    fn default() -> Self {
        Self::new()
    }
}
