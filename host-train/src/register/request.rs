//! What users ask for: registrations in the clouds' own coordinates, in f64.

use crate::pose64::{Pose64, Position};
use crate::register::all_points::decided_by_all_points;
use crate::register::best::{Best, Other, best_and_others};
use crate::register::dense::{Dense, DenseRefinement, refine_densely};
use crate::register::deviations::Deviations;
use crate::register::prepared::Prepared;
use crate::register::scale::other_size;
use crate::register::seen::lies_among;
use crate::register::{Memory, Registered, Start, register_in};
use glam::Vec3;
use reagent_core::dims::STEPS;
use reagent_core::pipeline::{Mode, Task};
use reagent_core::verdict::Verdict;
use reagent_core::{Error, Frame, Policy, Pose, start};
use std::time::Instant;

/// Least share of the points near the target for a source that shows the target and nothing else, whatever its
/// noise. Views of depth cameras have .95 and more.
const LEAST_WITHIN: f32 = 0.9;

/// What to do with two clouds, in their own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Where the registration starts.
    pub start: Start,
    /// How far from the truth the start may be; the core's default if not given. Nothing for a start from anywhere.
    pub deviations: Option<Deviations>,
    /// Which of the policy's steps, refinement and verification are done.
    pub mode: Mode,
    /// Most steps of the policy; 0 leaves the policy out.
    pub steps: usize,
    /// Where the sensor stood in the source's coordinates, if the source is a view from one point.
    pub view_point: Option<Position>,
    /// Whether the pose is finally refined on many points; never in [`Mode::Fast`].
    pub dense: Dense,
}

impl Default for Request {
    fn default() -> Request {
        Request {
            start: Start::Identity,
            deviations: None,
            mode: Mode::Verify,
            steps: STEPS,
            view_point: None,
            dense: Dense::Auto,
        }
    }
}

/// A registered pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Done {
    /// Answer and steps, between coordinates relative to the clouds' origins.
    pub found: Registered,
    /// The last refinement, if it improved the pose.
    pub dense: Option<DenseRefinement>,
    /// Whether the last refinement was dropped because it did not improve the pose.
    pub is_dense_dropped: bool,
    /// target_from_source between the clouds' own coordinates.
    pub pose: Pose64,
    /// The pose before the first step, relative to the clouds' origins.
    pub initial: Pose,
    /// Number of the start that it came from, if there were several.
    pub start: Option<usize>,
    /// Size of the source relative to the target, if the two seem to differ ([`other_size`]).
    pub other_size: Option<f32>,
    /// Whether the view point lies among the source's points, so that nothing follows from it.
    pub is_seen_from_among: bool,
    /// The next best poses, as many as were asked for at most.
    pub others: Vec<Other>,
    /// Time, milliseconds.
    pub ms: f64,
}

impl Done {
    /// The final pose, relative to the clouds' origins.
    pub fn near(&self) -> Pose {
        let reached = self.found.answer.target_from_source;
        self.dense.map_or(reached, |dense| dense.target_from_source)
    }

    /// Share of the target where the sensor saw something behind it, if that is too large for a right pose.
    pub fn seen_through(&self) -> Option<f32> {
        let found = self.found.answer.refinement.as_ref()?;
        let is_too_much = found.evidence.is_seen_through();
        is_too_much.then_some(found.refined.seen_through)
    }

    /// Share of the source's points off the target, if it is too large for noise although the pose is called right.
    pub fn off_target(&self) -> Option<f32> {
        let answer = &self.found.answer;
        let found = answer.refinement.as_ref()?;
        let within = found.refined.within;
        // A difference in size explains it.
        let is_told_right = answer.verdict == Verdict::Converged && self.other_size.is_none();
        (is_told_right && within < LEAST_WITHIN).then_some(1.0 - within)
    }
}

impl Request {
    /// Registers `source` to `target`.
    ///
    /// # Errors
    /// Clouds, a start or a view point that the core refuses.
    pub fn register(
        &self,
        policy: Policy<'_>,
        memory: &mut Memory,
        source: &Prepared<'_>,
        target: &Prepared<'_>,
    ) -> Result<Done, Error> {
        let go_on = || Ok::<_, Error>(());
        self.register_from(&[self.start], 1, policy, memory, [source, target], go_on)
    }

    /// The same from several starts, in place of the request's own ([`best_and_others`]). The result is the most
    /// probable pose, by its fit and its start, with the next `best - 1` ones beside it. [`Mode::Fast`] does not
    /// look at fits and takes the first start's. `go_on` is asked between two starts.
    ///
    /// # Errors
    /// As [`Request::register`], and whatever `go_on` returns.
    pub fn register_from<E: From<Error>>(
        &self,
        starts: &[Start],
        best: usize,
        policy: Policy<'_>,
        memory: &mut Memory,
        clouds: [&Prepared<'_>; 2],
        go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Done, E> {
        let before = Instant::now();
        let mut done = self.untimed(starts, best, policy, memory, clouds, go_on)?;
        done.ms = before.elapsed().as_secs_f64() * 1e3;
        Ok(done)
    }

    /// The same without a clock, which a browser does not have: the time is 0.
    ///
    /// # Errors
    /// As [`Request::register_from`].
    pub fn untimed<E: From<Error>>(
        &self,
        starts: &[Start],
        best: usize,
        policy: Policy<'_>,
        memory: &mut Memory,
        [source, target]: [&Prepared<'_>; 2],
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Done, E> {
        let clouds = [source.points(), target.points()];
        let view_point = self.seen_from(source);
        let task = |start| self.task(start, [source, target]);
        let wanted = match self.dense {
            Dense::Never => false,
            Dense::Always => true,
            Dense::Auto => source.is_thinned() || target.is_thinned(),
        };
        let is_refined = wanted && self.mode != Mode::Fast;
        let tasks: Vec<Task<'_>> = starts.iter().map(task).collect();
        let mut found = Vec::with_capacity(tasks.len());
        for (i, task) in tasks.iter().enumerate() {
            if i > 0 {
                go_on()?;
            }
            let once = register_in(memory, policy, clouds[0], clouds[1], task)?;
            found.push(if is_refined {
                decided_by_all_points(memory, [source, target], task, once)?
            } else {
                once
            });
        }
        let next_best = best.saturating_sub(1);
        let Best {
            start,
            found,
            others,
        } = best_and_others(memory, clouds, &tasks, found, next_best)?;
        let reached = found.answer.target_from_source;
        let dense = if is_refined {
            let eye = view_point.map(|view_point| reached.apply(view_point));
            refine_densely(&source.all, &target.all_seen_from(eye)?, reached)?
        } else {
            None
        };
        let other_size = match &found.answer.refinement {
            Some(refinement) => other_size(&mut memory.workspace, clouds, &refinement.refined)?,
            None => None,
        };
        let near = dense.map_or(reached, |d| d.target_from_source);
        Ok(Done {
            pose: Pose64::of(near, source.origin, target.origin),
            initial: starts[start].near(source.origin, target.origin),
            start: (starts.len() > 1).then_some(start),
            other_size,
            is_seen_from_among: view_point.is_some_and(|eye| lies_among(eye, clouds[0])),
            others,
            ms: 0.0,
            found,
            is_dense_dropped: is_refined && dense.is_none(),
            dense,
        })
    }

    /// Does once what the first registration to a target would do otherwise: a view of a mesh needs to know which way its faces look,
    /// which takes longer than a camera's next image.
    pub fn get_ready(&self, target: &Prepared<'_>) {
        if self.view_point.is_some() {
            target.outward();
        }
    }

    /// The core's task from one start, in coordinates relative to the clouds' origins.
    pub(super) fn task<'s>(
        &self,
        start: &Start,
        [source, target]: [&'s Prepared<'_>; 2],
    ) -> Task<'s> {
        let view_point = self.seen_from(source);
        Task {
            mode: self.mode,
            steps: self.steps,
            view_point,
            background: &source.background,
            outward: view_point.map_or(&[], |_| target.outward()),
            ..Task::new(self.uncertain(start.start(source.origin, target.origin), target))
        }
    }

    /// The start with the uncertainty that was asked for.
    fn uncertain(&self, start: start::Start, target: &Prepared<'_>) -> start::Start {
        match (start, self.deviations) {
            (start::Start::Pose(pose, _), Some(deviations)) => {
                // A target that has no size is refused later.
                let radius = Frame::of(target.points()).map_or(1.0, |frame| frame.scale);
                start::Start::Pose(pose, deviations.in_radii(radius))
            }
            _ => start,
        }
    }

    /// The view point relative to the source's origin.
    fn seen_from(&self, source: &Prepared<'_>) -> Option<Vec3> {
        let relative = |at: Position| [0, 1, 2].map(|k| (at[k] - source.origin[k]) as f32).into();
        self.view_point.map(relative)
    }
}

#[cfg(test)]
mod tests;
