//! Refinement of a pose by closest points: a few robust steps that reduce
//! the distances between both surfaces, measured from either side.
//!
//! | stage | what |
//! |---|---|
//! | prepare, once | both clouds in spatial order, normals from moments of neighbourhoods ([`Refiner::new`]) |
//! | match | each point of either cloud with the nearest of the other, exactly |
//! | weigh | Tukey's weight of the distance; it ends at a multiple of the median distance, which shrinks as the pose gets better |
//! | step | one Gauss-Newton step of the symmetric point-to-plane distance (Rusinkiewicz 2019), along the sum of both normals |
//! | finish | the same with a share of the distance between the points themselves: it fixes what planes leave free, and finds points that both clouds share |
//!
//! Everything is f32 in a fixed order (the normal equations and their solution in f64), without fused multiply-add or the
//! system's maths library: the same bits on every kernel and target.

use crate::covariance::Covariance;
use crate::error::Error;
use crate::facing::Facing;
use crate::frame::{Frame, check_cloud};
use crate::freespace::DepthGrid;
use crate::kernels::Isa;
use crate::loss::Losses;
use crate::model::Model;
use crate::pose::{Pose, mean};
use crate::solve::Rigid;
use crate::surface::Surface;
use glam::Vec3;

mod coarse;
mod equations;
mod matching;
mod residual;
mod sample;
mod seen;
mod stage;
mod workspace;

use equations::RIDGE;
use residual::Overlap;
pub use residual::Residual;
use stage::{BRIEF_FINE, BRIEF_NEAR, FINE, NEAR, Stage};
use workspace::Work;
pub use workspace::Workspace;

/// A pose and how it fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Plain rigid transform, in the clouds' own units.
    pub target_from_source: Pose,
    /// Distance between the clouds under the pose. The view point does not enter; it only helps to choose between poses.
    pub residual: Residual,
    /// How well the matched planes fix a rotation about their weakest axis, as a share of all axes: up to 1/3, near 0 for a
    /// surface of revolution.
    pub rotation_constraint: f32,
    /// Share of the source's points that lie on the target's surface.
    pub overlap: f32,
    /// Share of them that lie at most three times as far from it; low if another object is in the cloud, not only noise.
    pub near: f32,
    /// Share of them that lie within a neighbourhood's radius of it.
    pub within: f32,
    /// Share of them near enough to the target's centre to be the object's.
    pub inside: f32,
    /// RMS distance from the surface of those that lie on it, in the clouds' own units.
    pub inlier_rmse: f32,
    /// Distinct points of the cloud that has fewer of them.
    pub distinct_points: usize,
    /// Size of the source over that of the target. A cloud's size is the
    /// median distance of its points from the medians of their coordinates.
    pub extents_ratio: f32,
    /// Share of the target's points facing the sensor behind which something was seen, so that they cannot be there; 0 where nothing
    /// besides the source was seen. At edges, some points of a right pose count, too.
    pub seen_through: f32,
    /// Shares of the source's and of the target's points left out because they lie far from all others.
    pub left_out: [f32; 2],
    /// Number of steps made.
    pub iterations: usize,
    /// Covariance of the pose, if it is the right one.
    pub covariance: Covariance,
}

/// A pose in the refiner's frame, and how it fits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) at: Rigid,
    pub(crate) residual: Residual,
    pub(crate) rotation_constraint: f32,
    pub(crate) overlap: Overlap,
    pub(crate) iterations: usize,
}

impl Candidate {
    /// Whether the steps converged before their limit.
    pub(crate) fn is_settled(&self) -> bool {
        self.iterations < NEAR.iterations + FINE.iterations
    }
}

/// Two clouds, prepared for refinement and comparison.
#[derive(Debug)]
pub struct Refiner<'w> {
    isa: Isa,
    /// The target; its frame is that of everything inside.
    model: &'w Model,
    work: &'w mut Work,
    /// Centroid of the source.
    source_centre: Vec3,
}

impl<'w> Refiner<'w> {
    /// Prepares two clouds on the workspace's kernels. The target of the last refiner in the workspace is not prepared again.
    ///
    /// # Shapes
    /// `source [N, 3]`, `target [M, 3]`; larger clouds are thinned to [`crate::dims::SURFACE_POINTS`].
    ///
    /// # Errors
    /// As [`check_cloud`] and [`Frame::of`].
    pub fn new(
        source: &[[f32; 3]],
        target: &[[f32; 3]],
        workspace: &'w mut Workspace,
    ) -> Result<Self, Error> {
        Self::with_isa(workspace.isa(), source, target, workspace)
    }

    /// As [`Self::new`], for a target prepared before.
    ///
    /// # Errors
    /// As [`check_cloud`]; [`Error::EmptyCloud`] for a model without a target.
    pub fn for_model(
        model: &'w Model,
        source: &[[f32; 3]],
        workspace: &'w mut Workspace,
    ) -> Result<Self, Error> {
        if model.surface.points().is_empty() {
            return Err(Error::EmptyCloud);
        }
        check_cloud(source)?;
        Ok(Self::begin(
            workspace.isa(),
            source,
            model,
            &mut workspace.work,
        ))
    }

    /// As [`Self::new`], on given kernels.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_isa(
        isa: Isa,
        source: &[[f32; 3]],
        target: &[[f32; 3]],
        workspace: &'w mut Workspace,
    ) -> Result<Self, Error> {
        check_cloud(source)?;
        let Workspace { model, work, .. } = workspace;
        model.prepare(isa, target, &mut work.of_target.keys)?;
        Ok(Self::begin(isa, source, model, work))
    }

    /// Prepares a source that was checked.
    fn begin(isa: Isa, source: &[[f32; 3]], model: &'w Model, work: &'w mut Work) -> Self {
        let keys = &mut work.of_source.keys;
        let bulk = keys.bulk(source);
        let source_centre = mean(bulk.kept(source));
        let factor = 1.0 / model.frame.scale;
        work.source
            .fill(isa, source, bulk, source_centre, factor, keys);
        work.sample.fill(&work.source);
        work.of_source.forget();
        work.of_target.forget();
        work.seen = DepthGrid::EMPTY;
        work.facing = Facing::UNKNOWN;
        Refiner {
            isa,
            model,
            work,
            source_centre,
        }
    }

    /// How well a pose fits.
    ///
    /// # Errors
    /// [`Error::BadPose`] for a pose that is not rigid.
    pub fn residual(&mut self, target_from_source: Pose) -> Result<Residual, Error> {
        let at = self.inside(target_from_source.checked()?);
        self.match_all(at);
        Ok(self.matched_residual(at))
    }

    /// Refines a pose in at most 22 steps; the result fits no worse.
    ///
    /// # Errors
    /// [`Error::BadPose`] for an initial pose that is not rigid.
    pub fn polish(&mut self, initial: Pose) -> Result<Refined, Error> {
        let at = self.inside(initial.checked()?);
        let found = self.polish_inside(at);
        Ok(self.refined(&found, initial))
    }

    /// A few steps on some of the points, to compare hypotheses; `None` if the first stage leads to a known pose.
    pub(crate) fn polish_briefly(
        &mut self,
        initial: Rigid,
        is_known: impl Fn(Rigid) -> bool,
    ) -> Option<Rigid> {
        let (near, _) = self.run(initial, &BRIEF_NEAR);
        (!is_known(near)).then(|| self.run(near, &BRIEF_FINE).0)
    }

    /// The first of these stages, with one motion (a turn and a shift) suppressed.
    pub(crate) fn drawn_near_but(&mut self, held: [Vec3; 2], initial: Rigid) -> Rigid {
        let mut at = initial;
        for _ in 0..BRIEF_NEAR.iterations {
            let mut equations = self.matched_equations(at, &BRIEF_NEAR);
            equations.hold(held);
            let (rotation_vector, shift) = equations.solve(RIDGE);
            at = at.moved(rotation_vector, shift);
        }
        at
    }

    /// [`Self::polish`] in the refiner's frame.
    pub(crate) fn polish_inside(&mut self, initial: Rigid) -> Candidate {
        self.match_all(initial);
        let before = self.matched_residual(initial);
        let (near, steps) = self.run(initial, &NEAR);
        let (at, more) = self.run(near, &FINE);
        self.match_all(at);
        let is_better = self.matched_residual(at).mean() <= before.mean();
        if is_better {
            self.matched_candidate(at, steps + more)
        } else {
            self.candidate(initial, steps + more)
        }
    }

    /// A pose to which so many steps led.
    pub(crate) fn candidate(&mut self, at: Rigid, iterations: usize) -> Candidate {
        self.match_all(at);
        self.matched_candidate(at, iterations)
    }

    /// The same, under which all points were matched last.
    fn matched_candidate(&mut self, at: Rigid, iterations: usize) -> Candidate {
        let overlap = self.matched_overlap(at);
        Candidate {
            at,
            residual: self.matched_residual_unseen(at),
            overlap,
            rotation_constraint: self.least_constraint(at).1,
            iterations,
        }
    }

    /// The candidate in the user's frame; exactly `initial` if no step moved it.
    pub(crate) fn refined(&mut self, candidate: &Candidate, initial: Pose) -> Refined {
        let unmoved = candidate.at == self.inside(initial);
        Refined {
            target_from_source: if unmoved {
                initial
            } else {
                self.outside(candidate.at)
            },
            residual: candidate.residual,
            rotation_constraint: candidate.rotation_constraint,
            overlap: candidate.overlap.on_surface,
            near: candidate.overlap.near,
            within: candidate.overlap.within,
            inside: candidate.overlap.inside,
            inlier_rmse: candidate.overlap.inlier_rmse * self.model.frame.scale,
            distinct_points: self.distinct_points(),
            extents_ratio: self.extents_ratio(),
            seen_through: self.seen_through(candidate.at, 1),
            left_out: self.surfaces().map(|surface| surface.left_out),
            iterations: candidate.iterations,
            covariance: self.covariance(candidate.at),
        }
    }

    /// Makes the steps of a stage; returns how many.
    pub(crate) fn run(&mut self, initial: Rigid, stage: &Stage) -> (Rigid, usize) {
        let mut at = initial;
        for i in 0..stage.iterations {
            let (rotation_vector, shift) = self.matched_equations(at, stage).solve(RIDGE);
            at = at.moved(rotation_vector, shift);
            if rotation_vector.length_squared().max(shift.length_squared())
                < stage.settled * stage.settled
            {
                return (at, i + 1);
            }
        }
        (at, stage.iterations)
    }

    /// Converts a plain pose from the user's frame to the refiner's.
    pub(crate) fn inside(&self, pose: Pose) -> Rigid {
        let Frame { centre, scale } = self.model.frame;
        let centre = pose.apply(self.source_centre) - centre;
        Rigid::new(pose.rotation, centre * (1.0 / scale))
    }

    pub(crate) fn outside(&self, at: Rigid) -> Pose {
        let rotation = at.rotation.matrix();
        let centre = at.shift * self.model.frame.scale + self.model.frame.centre;
        Pose {
            rotation,
            translation: centre - rotation * self.source_centre,
        }
    }

    /// Distinct points of the cloud that has fewer of them.
    fn distinct_points(&self) -> usize {
        let [source, target] = self.surfaces().map(|surface| surface.points().len());
        source.min(target)
    }

    /// See [`Refined::extents_ratio`].
    fn extents_ratio(&mut self) -> f32 {
        let Work {
            source, of_source, ..
        } = &mut *self.work;
        source.extent(&mut of_source.keys) / self.model.extent.max(1e-30)
    }

    /// The target's centre, in its own units.
    pub(crate) fn target_centre(&self) -> Vec3 {
        self.model.frame.centre
    }

    /// Length of the refiner's unit, in the target's units.
    pub(crate) fn target_scale(&self) -> f32 {
        self.model.frame.scale
    }

    /// Replaces the source by its mirror image; doing it twice restores it.
    pub(crate) fn mirror_source(&mut self) {
        self.work.source.mirror();
        self.work.sample.fill(&self.work.source);
        self.work.seen.mirror();
    }

    /// The kernels in use.
    pub(crate) fn isa(&self) -> Isa {
        self.isa
    }

    /// The losses kept.
    pub(crate) fn losses(&self) -> &Losses {
        &self.work.losses
    }

    /// The losses kept, mutable.
    pub(crate) fn losses_mut(&mut self) -> &mut Losses {
        &mut self.work.losses
    }

    /// Both surfaces, source first.
    pub(crate) fn surfaces(&self) -> [&Surface; 2] {
        [&self.work.source, &self.model.surface]
    }
}

#[cfg(test)]
pub(crate) mod tests;
