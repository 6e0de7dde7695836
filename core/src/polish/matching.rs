//! Matches: each point of either cloud with the nearest point of the other.

use super::stage::Stage;
use super::{Refiner, Work};
use crate::kernels::Pair;
use crate::pose::Pose;
use crate::solve::Rigid;
use crate::surface::Surface;

/// Distance from which on a point is near nothing on a surface, in neighbourhood radii; its loss is 1.
const NEAR_NOTHING: f32 = 1.0;

impl Refiner<'_> {
    /// Matches every point of each cloud, at any distance.
    pub(super) fn match_all(&mut self, at: Rigid) {
        self.match_every(at, [1, 1], [f32::INFINITY; 2]);
    }

    /// Matches about `points` points of each cloud; those near nothing stay unmatched.
    pub(crate) fn match_both(&mut self, at: Rigid, points: usize) {
        let [source, target] = self.surfaces();
        let near = [target, source]
            .map(|other| (NEAR_NOTHING * other.radius) * (NEAR_NOTHING * other.radius));
        self.match_every(at, every(points, source, target), near);
    }

    /// Matches every n-th point of each cloud with the other cloud, within limits on the squared distance.
    fn match_every(&mut self, at: Rigid, [of_s, of_t]: [usize; 2], [limit_s, limit_t]: [f32; 2]) {
        let (isa, target, pose) = (self.isa, &self.model.surface, at.pose());
        self.match_source(pose, of_s, limit_s);
        let Work {
            source, of_target, ..
        } = &mut *self.work;
        of_target.find(isa, [target, source], None, pose.inverse(), of_t, limit_t);
    }

    /// Matches points for a step of a stage; returns the squared gate, from which on a match has no weight. Farther points are
    /// not searched for.
    pub(super) fn match_within_gate(&mut self, at: Rigid, stage: &Stage) -> f32 {
        let (isa, target, pose) = (self.isa, &self.model.surface, at.pose());
        let Work {
            source, of_source, ..
        } = &mut *self.work;
        let [every_s, every_t] = every(stage.points, source, target);
        let radius = source.radius.max(target.radius);
        let back = pose.inverse();
        // The median by the last matches is an upper bound, and so is its gate.
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
        of_target.find(isa, [target, source], None, back, every_t, gate);
        // If one cloud shows a part of the other, the median of its own points is the part's.
        stage.gate(of_target.median_squared().min(median), radius)
    }

    /// Matches every n-th point of the source with points that do not face away from the sensor.
    fn match_source(&mut self, pose: Pose, every: usize, limit: f32) {
        let (isa, target) = (self.isa, &self.model.surface);
        let Work {
            source,
            of_source,
            seen,
            facing,
            ..
        } = &mut *self.work;
        facing.look(isa, seen, pose, target);
        let hidden = facing.hidden();
        of_source.find(isa, [source, target], hidden, pose, every, limit);
    }

    /// Pairs of places in source and target that were matched last within the limit, both ways, without points that face away
    /// from the sensor.
    pub(super) fn matched(&self) -> impl Iterator<Item = Pair> {
        let Work {
            of_source,
            of_target,
            facing,
            ..
        } = &*self.work;
        let forward = of_source
            .matches()
            .filter_map(|m| m.to.map(|to| [m.of as u16, to as u16]));
        let backward = of_target
            .matches()
            .filter(|m| !facing.is_hidden(m.of))
            .filter_map(|m| m.to.map(|to| [to as u16, m.of as u16]));
        forward.chain(backward)
    }
}

/// Strides that select about `points` points of each surface.
fn every(points: usize, source: &Surface, target: &Surface) -> [usize; 2] {
    [source, target].map(|surface| surface.points().len() / points.max(1))
}
