//! Matches: each point of either cloud with the nearest of the other.

use super::stage::Stage;
use super::{Refiner, Workspace};
use crate::solve::Rigid;
use crate::surface::Surface;

/// Distance from which a point is near nothing of a surface, in radii of a neighbourhood: its loss is 1 anyway.
const NEAR_NOTHING: f32 = 1.0;

impl Refiner<'_> {
    /// Matches every point of each cloud with all of the other, however far.
    pub(super) fn match_all(&mut self, at: Rigid) {
        let Workspace { source, target, .. } = &mut *self.workspace;
        let pose = at.pose();
        source.match_to(self.isa, target, pose, 1, f32::INFINITY);
        target.match_to(self.isa, source, pose.inverse(), 1, f32::INFINITY);
    }

    /// Matches about `points` of each cloud with all of the other; one that is near nothing, with any.
    pub(crate) fn match_both(&mut self, at: Rigid, points: usize) {
        let Workspace { source, target, .. } = &mut *self.workspace;
        let (pose, [every_s, every_t]) = (at.pose(), every(points, source, target));
        let [near_target, near_source] = [&*target, &*source]
            .map(|other| (NEAR_NOTHING * other.radius) * (NEAR_NOTHING * other.radius));
        source.match_to(self.isa, target, pose, every_s, near_target);
        target.match_to(self.isa, source, pose.inverse(), every_t, near_source);
    }

    /// The same for a stage's steps, and the squared distance from which a match has no weight: only those nearer are the
    /// nearest for certain.
    pub(super) fn match_within_gate(&mut self, at: Rigid, stage: &Stage) -> f32 {
        let Workspace { source, target, .. } = &mut *self.workspace;
        let (pose, [every_s, every_t]) = (at.pose(), every(stage.points, source, target));
        let radius = source.radius.max(target.radius);
        let back = pose.inverse();
        // A median is at most what it was by the last matches, and so is the gate.
        let gate = stage.gate(source.largest_median(target, pose, every_s), radius);
        source.match_to(self.isa, target, pose, every_s, gate);
        let median = source.median_squared();
        let gate = stage.gate(
            target.largest_median(source, back, every_t).min(median),
            radius,
        );
        target.match_to(self.isa, source, back, every_t, gate);
        // Where one cloud shows a part of the other, its own points' median is that of the part.
        stage.gate(target.median_squared().min(median), radius)
    }

    /// Places in the source and in the target of the points matched last, both ways.
    pub(super) fn matched(&self) -> impl Iterator<Item = (usize, usize)> {
        let [source, target] = self.surfaces();
        let forward = source.matches().map(|found| (found.of, found.to));
        forward.chain(target.matches().map(|found| (found.to, found.of)))
    }
}

/// Every how many-th point of each surface are about so many.
fn every(points: usize, source: &Surface, target: &Surface) -> [usize; 2] {
    [source, target].map(|surface| surface.points().len() / points.max(1))
}
