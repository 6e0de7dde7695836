//! Matches: each point of either cloud with the nearest of the other.

use super::stage::Stage;
use super::{Refiner, Work};
use crate::kernels::Pair;
use crate::pose::Pose;
use crate::solve::Rigid;
use crate::surface::Surface;

/// Distance from which a point is near nothing of a surface, in radii of a neighbourhood: its loss is 1.
const NEAR_NOTHING: f32 = 1.0;

impl Refiner<'_> {
    /// Matches every point of each cloud with all of the other, however far.
    pub(super) fn match_all(&mut self, at: Rigid) {
        self.match_every(at, [1, 1], [f32::INFINITY; 2]);
    }

    /// Matches about `points` of each cloud with all of the other; one that is near nothing, with none.
    pub(crate) fn match_both(&mut self, at: Rigid, points: usize) {
        let [source, target] = self.surfaces();
        let near = [target, source]
            .map(|other| (NEAR_NOTHING * other.radius) * (NEAR_NOTHING * other.radius));
        self.match_every(at, every(points, source, target), near);
    }

    /// Matches every so many-th point of each cloud with all of the other; where none is within the root of a limit, with none.
    fn match_every(&mut self, at: Rigid, [of_s, of_t]: [usize; 2], [limit_s, limit_t]: [f32; 2]) {
        let (isa, target, pose) = (self.isa, &self.model.surface, at.pose());
        self.match_source(pose, of_s, limit_s);
        let Work {
            source, of_target, ..
        } = &mut *self.work;
        of_target.find(isa, [target, source], pose.inverse(), of_t, limit_t);
    }

    /// The same for a stage's steps, and the squared distance from which a match has no weight: only those nearer are looked for.
    pub(super) fn match_within_gate(&mut self, at: Rigid, stage: &Stage) -> f32 {
        let (isa, target, pose) = (self.isa, &self.model.surface, at.pose());
        let Work {
            source, of_source, ..
        } = &mut *self.work;
        let [every_s, every_t] = every(stage.points, source, target);
        let radius = source.radius.max(target.radius);
        let back = pose.inverse();
        // A median is at most what it was by the last matches, and so is the gate.
        let median = of_source.largest_median(isa, [source, target], pose, every_s);
        self.match_source(pose, every_s, stage.gate(median, radius));
        let Work {
            source,
            of_source,
            of_target,
            ..
        } = &mut *self.work;
        let median = of_source.median_squared();
        let known = of_target.largest_median(isa, [target, source], back, every_t);
        let gate = stage.gate(known.min(median), radius);
        of_target.find(isa, [target, source], back, every_t, gate);
        // Where one cloud shows a part of the other, its own points' median is that of the part.
        stage.gate(of_target.median_squared().min(median), radius)
    }

    /// Matches every so many-th point of the source with what does not face away from the sensor.
    fn match_source(&mut self, pose: Pose, every: usize, limit: f32) {
        let (isa, target) = (self.isa, &self.model.surface);
        let Work {
            source,
            of_source,
            seen,
            facing,
            ..
        } = &mut *self.work;
        let faced = facing.seen_from(seen, pose, target);
        of_source.find(isa, [source, target], pose, every, limit);
        if faced.tells() {
            of_source.find_of_use([source, target], pose, limit, |to| !faced.is_away(to));
        }
    }

    /// Places in the source and in the target of the points matched last with one within the limit, both ways, without what faces
    /// away from the sensor.
    pub(super) fn matched(&self, at: Rigid) -> impl Iterator<Item = Pair> {
        let Work {
            of_source,
            of_target,
            seen,
            facing,
            ..
        } = &*self.work;
        let faced = facing.seen_from(seen, at.pose(), &self.model.surface);
        let forward = of_source
            .matches()
            .filter_map(|m| m.to.map(|to| [m.of as u16, to as u16]));
        let backward = of_target
            .matches()
            .filter(move |m| !faced.is_away(m.of))
            .filter_map(|m| m.to.map(|to| [to as u16, m.of as u16]));
        forward.chain(backward)
    }
}

/// Every how many-th point of each surface are about so many.
fn every(points: usize, source: &Surface, target: &Surface) -> [usize; 2] {
    [source, target].map(|surface| surface.points().len() / points.max(1))
}
