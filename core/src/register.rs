//! One registration: observe, embed, decide, accumulate, verdict.

use crate::cloud::Cloud;
use crate::critical::Critical;
use crate::dims::{FEATURES, HEAD, LOGITS, QUANT_TILE, TARGETS_KEPT};
use crate::error::Error;
use crate::kernels::Isa;
use crate::net::{self, Memory, Scratch, TargetHalf, View};
use crate::order::Order;
use crate::pose::{Pose, mean};
use crate::quant::{self, TargetSums};
use crate::steps::Action;
use crate::verdict::Verdict;
use crate::weights::{Network, Policy};
use core::ops::Range;
use glam::Vec3;

mod heads;
mod slices;
#[cfg(all(test, feature = "pretrained", feature = "pretrained-int8"))]
mod tests;
mod together;

pub use together::Team;

/// The normalised frame in which the policy works: `x_n = (x - centre) / scale`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Point that becomes the origin.
    pub centre: Vec3,
    /// Length that becomes 1, in the cloud's units.
    pub scale: f32,
}

impl Frame {
    /// Clouds are normalised already and used as they are.
    pub const IDENTITY: Frame = Frame {
        centre: Vec3::ZERO,
        scale: 1.0,
    };

    /// The target's frame: its mean at the origin, its farthest point at distance 1.
    ///
    /// # Errors
    /// As [`Cloud::check`]; [`Error::NoExtent`] where all points coincide.
    pub fn of(target: &[[f32; 3]]) -> Result<Frame, Error> {
        Frame::of_cloud(Cloud::F32(target))
    }

    /// As [`Frame::of`].
    ///
    /// # Errors
    /// As [`Frame::of`].
    pub fn of_cloud(target: Cloud<'_>) -> Result<Frame, Error> {
        target.check()?;
        let centre = mean(target.points());
        let scale = target
            .points()
            .map(|p| (Vec3::from_array(p) - centre).length())
            .fold(0.0, f32::max);
        if scale > 0.0 && scale.is_finite() {
            Ok(Frame { centre, scale })
        } else {
            Err(Error::NoExtent)
        }
    }
}

/// As [`Cloud::check`].
///
/// # Errors
/// As [`Cloud::check`].
pub fn check_cloud(points: &[[f32; 3]]) -> Result<(), Error> {
    Cloud::F32(points).check()
}

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

/// Feature of the target, and what it adds to the heads where that is kept.
#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "the caller's registration holds either"
)]
enum TargetFeature {
    F32(net::Feature, [TargetHalf; TARGETS_KEPT]),
    Int8(quant::Feature, [TargetSums; TARGETS_KEPT]),
}

impl TargetFeature {
    /// Makes it that of a number format.
    fn fit(&mut self, network: &Network<'_>) {
        match (network, &*self) {
            (Network::F32(_), TargetFeature::Int8(..)) => self.become_f32(),
            (Network::Int8(_), TargetFeature::F32(..)) => self.become_int8(),
            _ => {}
        }
    }

    // Out of line, so that their copies are on nobody's stack who does not call them.
    #[cold]
    #[inline(never)]
    fn become_f32(&mut self) {
        *self = TargetFeature::F32([0.0; FEATURES], [[0.0; HEAD[0]]; TARGETS_KEPT]);
    }

    #[cold]
    #[inline(never)]
    fn become_int8(&mut self) {
        *self = TargetFeature::Int8(quant::Feature::ZERO, [[0; HEAD[0]]; TARGETS_KEPT]);
    }
}

/// A registration under way: the accumulated pose and what stays constant over its steps.
#[derive(Clone, Debug)]
pub struct Registration<'c> {
    source: Cloud<'c>,
    /// Of the target, what is still to be embedded; nothing afterwards.
    unseen: Cloud<'c>,
    /// In which order the points of the cloud under way are embedded.
    order: Order,
    /// Points that steps look at which do not look at all.
    critical: Critical,
    /// Points embedded of the cloud under way, if the scratch still says that it is this one's turn.
    seen: usize,
    turn: u32,
    /// Heads that have taken its feature in, and what the first of them says.
    heads: usize,
    logits_t: [f32; LOGITS],
    /// Centroid `μ` of the observed source, own units.
    centroid: Vec3,
    frame: Frame,
    /// Disentangled accumulator, translation in normalised units.
    accumulated: Pose,
    target: TargetFeature,
    steps: usize,
    /// The last two actions; "stop" before the first.
    before: Action,
    last: Action,
    rests: bool,
}

impl Registration<'_> {
    /// A place for a registration, of no points: see [`Registrar::start_in`].
    pub const fn new() -> Self {
        Registration {
            source: Cloud::EMPTY,
            unseen: Cloud::EMPTY,
            order: Order::NONE,
            critical: Critical::NONE,
            seen: 0,
            turn: 0,
            heads: 0,
            logits_t: [0.0; LOGITS],
            centroid: Vec3::ZERO,
            frame: Frame::IDENTITY,
            accumulated: Pose::IDENTITY,
            target: TargetFeature::Int8(quant::Feature::ZERO, [[0; HEAD[0]]; TARGETS_KEPT]),
            steps: 0,
            before: Action::STOP,
            last: Action::STOP,
            rests: false,
        }
    }

    /// The pose so far as a plain rigid transform in the clouds' own units (to-global).
    pub fn target_from_source(&self) -> Pose {
        Pose {
            rotation: self.accumulated.rotation,
            translation: self.accumulated.translation * self.frame.scale,
        }
        .to_global(self.centroid)
    }

    /// Whether it was started: no cloud that is accepted is empty.
    fn has_begun(&self) -> bool {
        !self.source.is_empty()
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

    /// Goes on from where another registration of the same clouds is, of another policy perhaps: to compare what two
    /// policies do there.
    pub fn follow(&mut self, other: &Registration<'_>) {
        self.accumulated = other.accumulated;
        self.critical.clone_from(&other.critical);
        self.steps = other.steps;
        self.before = other.before;
        self.last = other.last;
        self.rests = other.rests;
    }

    /// Points that the next step looks at.
    pub fn points_ahead(&self, policy: &Policy<'_>) -> usize {
        if policy.sees_all(self.steps) {
            self.source.len()
        } else {
            self.critical.len()
        }
    }

    /// Whether slices still embed the target ([`Registrar::advance`]).
    pub fn is_at_target(&self) -> bool {
        !self.unseen.is_empty()
    }

    /// Whether further steps would change nothing: the last one looked at all points, in all the ways in which the
    /// policy ever looks, and stopped on every axis.
    pub fn rests(&self) -> bool {
        self.rests
    }

    /// Verdict if no further step is taken.
    pub fn verdict(&self) -> Verdict {
        if self.steps == 0 {
            return Verdict::StepLimit;
        }
        Verdict::of_actions(self.before, self.last)
    }

    /// How the policy sees the target: `(x - centre)/s`.
    fn target_view(&self) -> View {
        View {
            origin: self.frame.centre,
            map: Pose {
                rotation: Pose::IDENTITY.rotation * (1.0 / self.frame.scale),
                translation: Vec3::ZERO,
            },
        }
    }

    /// How the policy sees the source now: `R (x - μ)/s + (μ - centre)/s + t`.
    fn view(&self) -> View {
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
}

impl<'c> Registration<'c> {
    /// Checks everything and begins: no step taken, no target embedded.
    fn begin(
        &mut self,
        source: Cloud<'c>,
        target: Cloud<'_>,
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        source.check()?;
        target.check()?;
        let centroid = mean(source.points());
        let initial = initial.checked()?.to_disentangled(centroid);
        self.source = source;
        self.unseen = Cloud::EMPTY;
        self.order.clear();
        self.seen = 0;
        self.heads = 0;
        self.centroid = centroid;
        self.frame = frame;
        self.accumulated = Pose {
            rotation: initial.rotation,
            translation: initial.translation / frame.scale,
        };
        self.steps = 0;
        self.before = Action::STOP;
        self.last = Action::STOP;
        self.rests = false;
        Ok(())
    }
}

impl Registration<'_> {
    /// Takes the action that follows from both heads' logits.
    fn act(
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
        self.rests = action == Action::STOP
            && policy.sees_all(self.steps)
            && decision.ways(self.steps) == decision.ways(usize::MAX);
        self.steps += 1;
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
        scratch.fit(&policy.network);
        Registrar {
            isa,
            policy,
            scratch,
        }
    }

    /// Checks both clouds and embeds the target, once for the whole registration.
    ///
    /// `initial` is a plain estimate of target_from_source in the clouds' own units.
    ///
    /// # Errors
    /// As [`check_cloud`]; [`Error::BadPose`] for an `initial` that is not rigid.
    pub fn start<'c>(
        &mut self,
        source: &'c [[f32; 3]],
        target: &[[f32; 3]],
        frame: Frame,
        initial: Pose,
    ) -> Result<Registration<'c>, Error> {
        let mut registration = Registration::new();
        self.start_in(&mut registration, source, target, frame, initial)?;
        Ok(registration)
    }

    /// As [`Registrar::start`], in place: four of a registration's kilobytes need not be moved. A
    /// registration whose start was refused is as it was.
    ///
    /// # Errors
    /// As [`Registrar::start`].
    pub fn start_in<'c>(
        &mut self,
        registration: &mut Registration<'c>,
        source: &'c [[f32; 3]],
        target: &[[f32; 3]],
        frame: Frame,
        initial: Pose,
    ) -> Result<(), Error> {
        registration.begin(Cloud::F32(source), Cloud::F32(target), frame, initial)?;
        let view = registration.target_view();
        let target = Cloud::F32(target);
        self.put_in_order(target, &mut registration.order);
        self.scratch.begin();
        self.embed_cloud(target, &registration.order, 0..target.len(), false, &view);
        self.finish_target(registration);
        Ok(())
    }

    /// Finds the order in which a cloud's points are embedded fastest, where it is not that in which they come.
    fn put_in_order(&self, cloud: Cloud<'_>, order: &mut Order) {
        let prunes = match &self.policy.network {
            Network::F32(network) => network.embedding.prunes(self.isa),
            Network::Int8(_) => self.isa.prunes_codes(),
        };
        // Which of equals is the critical point depends on the order.
        if prunes && self.policy.sees_all(1) {
            order.find(cloud);
        } else {
            order.clear();
        }
    }

    /// Makes the target that was embedded a feature, and turns to the source.
    fn finish_target(&mut self, registration: &mut Registration<'_>) {
        self.finish();
        self.read_target(registration);
        self.put_in_order(registration.source, &mut registration.order);
    }

    /// Takes the feature of the target that is embedded.
    fn read_target(&self, registration: &mut Registration<'_>) {
        let isa = self.isa;
        let target = &mut registration.target;
        target.fit(&self.policy.network);
        match (&self.policy.network, &self.scratch.memory, target) {
            (Network::F32(network), Memory::F32(scratch), TargetFeature::F32(feature, halves)) => {
                *feature = scratch.feature;
                let heads = [&network.translation, &network.rotation];
                for (head, half) in heads.into_iter().zip(halves) {
                    net::target_half(isa, head, feature, half);
                }
            }
            (Network::Int8(network), Memory::Int8(scratch), TargetFeature::Int8(feature, sums)) => {
                feature.clone_from(&scratch.feature);
                for (head, sums) in network.heads.iter().zip(sums) {
                    quant::target_sums(isa, head, feature, sums);
                }
            }
            // The memory was made that of the network's format, and stays so.
            _ => {}
        }
    }

    /// One step: observe the source under the current pose, decide, accumulate.
    pub fn step(&mut self, registration: &mut Registration<'_>) -> Step {
        loop {
            if let Some(step) = self.advance(registration, usize::MAX) {
                return step;
            }
        }
    }

    /// A whole registration of `steps` steps.
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
            self.step(&mut registration);
        }
        Ok(registration.outcome())
    }

    /// Logits of a head, translation or rotation, for the source that is embedded.
    fn logits(&mut self, registration: &Registration<'_>, head: usize) -> [f32; LOGITS] {
        let scratch = core::array::from_mut(&mut *self.scratch);
        let registration = core::array::from_ref(registration);
        let [logits] = heads::logits(self.isa, &self.policy, head, scratch, registration);
        logits
    }

    /// Embeds the source as it is seen now, and the target if that is still to be done.
    fn observe(&mut self, registration: &mut Registration<'_>) {
        while registration.is_at_target() {
            self.advance(registration, usize::MAX);
        }
        registration.seen = 0;
        registration.heads = 0;
        registration.turn = self.scratch.begin();
        self.look(registration, usize::MAX);
        self.finish_source(registration);
    }

    /// Embeds at most so many more points of the source as it is seen now.
    fn look(&mut self, registration: &mut Registration<'_>, points: usize) {
        let (source, view) = (registration.source, registration.view());
        let seen = registration.seen;
        if self.policy.sees_all(registration.steps) {
            let end = seen.saturating_add(points).min(source.len());
            let counted = self.finds_critical(registration.steps);
            self.embed_cloud(source, &registration.order, seen..end, counted, &view);
            registration.seen = end;
            return;
        }
        let mut tile = [[0.0; 3]; QUANT_TILE];
        let mut left = points;
        while left > 0 && registration.seen < source.len() {
            let mut filled = 0;
            for place in tile.iter_mut().take(left) {
                let next = registration.critical.next(registration.seen);
                let Some((next, point)) = next.and_then(|i| Some((i, source.point(i)?))) else {
                    registration.seen = source.len();
                    break;
                };
                *place = point;
                registration.seen = next + 1;
                filled += 1;
            }
            if let Some(points) = tile.get(..filled) {
                self.embed(points, None, &view);
            }
            left -= filled.min(left);
        }
    }

    /// Whether the step after so many looks at all points, and the one after it only at the critical ones.
    fn finds_critical(&self, steps: usize) -> bool {
        self.policy.sees_all(steps) && !self.policy.sees_all(steps + 1)
    }

    /// Makes the source that was embedded a feature, and keeps the points by which it came about.
    fn finish_source(&mut self, registration: &mut Registration<'_>) {
        if self.finds_critical(registration.steps) {
            let (critical, order) = (&mut registration.critical, &registration.order);
            let channels = self.policy.shape.features();
            critical.clear();
            match &self.scratch.memory {
                Memory::F32(scratch) => {
                    let winners = scratch.winners().iter().take(channels);
                    winners.for_each(|&place| critical.insert(order.point(place.into())));
                }
                Memory::Int8(scratch) => {
                    let winners = scratch.winners().take(channels);
                    winners.for_each(|place| critical.insert(order.point(place)));
                }
            }
        }
        self.finish();
    }

    /// Makes what was embedded a feature.
    fn finish(&mut self) {
        if let (Network::Int8(network), Memory::Int8(scratch)) =
            (&self.policy.network, &mut self.scratch.memory)
        {
            quant::finish(network, scratch);
        }
    }

    /// Embeds the points at some places of an order; where they count, finds the places of the critical ones among them.
    fn embed_cloud(
        &mut self,
        cloud: Cloud<'_>,
        order: &Order,
        places: Range<usize>,
        counted: bool,
        view: &View,
    ) {
        let mut tile = [[0.0; 3]; QUANT_TILE];
        let mut place = places.start;
        while place < places.end {
            let together = (places.end - place).min(order.together(place));
            let mut filled = 0;
            for point in tile.iter_mut().take(together) {
                *point = cloud.point(order.point(place + filled)).unwrap_or_default();
                filled += 1;
            }
            let points = tile.get(..filled).unwrap_or(&[]);
            self.embed(points, counted.then_some(place), view);
            place += filled;
        }
    }

    /// Embeds points of the cloud under way; where they count from `first`, finds the critical ones among them.
    fn embed(&mut self, points: &[[f32; 3]], first: Option<usize>, view: &View) {
        match (&self.policy.network, &mut self.scratch.memory) {
            (Network::F32(network), Memory::F32(scratch)) => {
                net::embed(self.isa, &network.embedding, points, first, view, scratch);
            }
            (Network::Int8(network), Memory::Int8(scratch)) => {
                quant::embed(self.isa, network, points, first, view, scratch);
            }
            // The memory was made that of the network's format, and stays so.
            _ => {}
        }
    }
}
