//! Coarse steps and losses, for searches over many poses: few of the source's points, matched with approximately nearest points
//! of the target.

use super::Refiner;
use super::equations::RIDGE;
use crate::kernels::{CELLS, GridLookup, HALF, Sums, Weighing};
use crate::search::{
    Best, EARLY, EARLY_POINTS, EARLY_SLACK, SCREEN, SCREEN_POINTS, SCREEN_SCALE, SIFT, SIFT_POINTS,
    SIFT_SCALE,
};
use crate::solve::{NormalEquations, Rigid};

/// Neighbourhood radius below which the grid, not the target's own sampling, says how near to a surface a point is seen to be: one
/// and a half cells. The point that a cell looks up may be half a cell off, which would be far on a surface of dense points.
const LEAST_RADIUS: f32 = 1.5 * (2.0 * HALF / CELLS as f32);

impl Refiner<'_> {
    /// Makes one coarse step for each gate: the distance from which on a match has no weight, in normalised units.
    pub(crate) fn coarse(&self, initial: Rigid, points: usize, gates: &[f32]) -> Rigid {
        const TANGENTIAL: f32 = 0.1;
        let (sample, count) = self.work.sample.first(points);
        let near = self.near();
        let mut at = initial;
        for &gate in gates {
            let by = Weighing {
                gate: gate * gate,
                tangential: TANGENTIAL,
            };
            let mut sums = Sums::ZERO;
            self.isa
                .coarse_equations(sample, count, &at.pose(), &near, by, &mut sums);
            let (rotation_vector, shift) = NormalEquations::of(&sums).solve(RIDGE);
            at = at.moved(rotation_vector, shift);
        }
        at
    }

    /// Mean loss of few of the source's points, to approximately nearest points.
    pub(crate) fn coarse_loss(&self, at: Rigid, points: usize, scale: f32) -> f32 {
        self.coarse_loss_below(f32::INFINITY, at, points, scale)
    }

    /// The same if it is below `most`, else any number not below: it stops as soon as that is certain.
    pub(crate) fn coarse_loss_below(&self, most: f32, at: Rigid, points: usize, scale: f32) -> f32 {
        // More than rounding can change a mean.
        const CERTAIN: f32 = 1.0 + 1e-5;
        let (sample, count) = self.work.sample.first(points);
        let radius = self.model.surface.radius.max(LEAST_RADIUS);
        let (near, by) = (self.near(), [radius, scale]);
        let all = count.max(1) as f32;
        let most = most * all * CERTAIN;
        let sum = self
            .isa
            .coarse_loss(sample, count, &at.pose(), &near, by, most);
        sum / all
    }

    /// Offers a hypothesis after a few steps, unless it is far behind those held already after the first of them.
    pub(crate) fn screen<const N: usize>(&self, at: Rigid, screened: &mut Best<N>) {
        let [points, compared] = SCREEN_POINTS;
        let (early, late) = SCREEN.split_at(EARLY);
        let at = self.coarse(at, EARLY_POINTS, early);
        let most = screened.most();
        let loss = self.coarse_loss_below(most + EARLY_SLACK, at, EARLY_POINTS, SCREEN_SCALE);
        if loss - EARLY_SLACK < most {
            let at = self.coarse(at, points, late);
            let loss = self.coarse_loss_below(most, at, compared, SCREEN_SCALE);
            screened.offer(loss, at);
        }
    }

    /// A hypothesis after further steps, with its loss if that is below `most`, else with any number not below.
    pub(crate) fn sifted_below(&self, most: f32, at: Rigid) -> (f32, Rigid) {
        let [points, compared] = SIFT_POINTS;
        let at = self.coarse(at, points, &SIFT);
        let loss = self.coarse_loss_below(most, at, compared, SIFT_SCALE);
        (loss, at)
    }

    /// As [`Self::sifted_below`], but drops a hypothesis far behind
    /// after the first steps; `None` unless its loss is below `most`.
    pub(crate) fn sifted_early(&self, most: f32, at: Rigid) -> Option<(f32, Rigid)> {
        let ([points, compared], [_, few]) = (SIFT_POINTS, SCREEN_POINTS);
        let (early, late) = SIFT.split_at(EARLY);
        let at = self.coarse(at, points, early);
        let far = most + EARLY_SLACK;
        if self.coarse_loss_below(far, at, few, SIFT_SCALE) >= far {
            return None;
        }
        let at = self.coarse(at, points, late);
        let loss = self.coarse_loss_below(most, at, compared, SIFT_SCALE);
        (loss < most).then_some((loss, at))
    }

    /// The target's grid.
    fn near(&self) -> GridLookup<'_> {
        self.model.lookup.of(&self.model.surface)
    }
}
