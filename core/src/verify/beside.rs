//! Poses next to the best one: turned or shifted a little, and slid along its least certain directions.

use super::search::{SPARE, Search, UNEXPLAINED};
use crate::loss::COMPARED;
use crate::polish::Residual;
use crate::search::{Best, SIFT_POINTS, SIFT_SCALE, is_equal, nudged};
use crate::solve::Rigid;
use crate::start::Prior;

/// Poses near the best that are polished.
const NUDGED: usize = 3;
/// Residual on both sides below which a pose explains both clouds so well that they have
/// not slid over each other. `SLIDES` are the shifts tried otherwise, in target radii;
/// results within `SLID_ALIKE` of the best loss count, and `SLID` of them are polished.
const EXPLAINED_WELL: f32 = 0.5;
const SLIDES: [f32; 14] = [
    0.05, 0.1, 0.2, 0.3, 0.4, 0.55, 0.7, -0.05, -0.1, -0.2, -0.3, -0.4, -0.55, -0.7,
];
const SLID_ALIKE: f32 = 0.15;
const SLID: usize = 5;

impl Search<'_, '_> {
    /// Tries poses near the best if that explains little: there, small steps end in one of several neighbouring minima.
    pub(super) fn nudge<E>(
        &mut self,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(best) = self.leader() else {
            return Ok(());
        };
        let [_, compared] = SIFT_POINTS;
        if self.refiner.coarse_loss(best.at, compared, SIFT_SCALE) < UNEXPLAINED {
            return Ok(());
        }
        // By the loss alone, without merging similar poses: neighbouring minima are what is looked for.
        let mut nearest = [None; NUDGED];
        for at in nudged(best.at) {
            go_on()?;
            self.hypotheses += 1;
            let loss = |sifted: &Option<(f32, Rigid)>| sifted.map_or(f32::INFINITY, |s| s.0);
            let most = nearest.last().map_or(f32::INFINITY, loss);
            let mut carried = Some(self.refiner.sifted_below(most, at));
            for held in &mut nearest {
                if loss(&carried) < loss(held) {
                    core::mem::swap(held, &mut carried);
                }
            }
        }
        for (_, at) in nearest.into_iter().flatten() {
            go_on()?;
            self.polish(at, prior);
        }
        Ok(())
    }

    /// Tries the best pose shifted along the axes by which planes hold its place, if it does not explain both clouds well:
    /// parts of an object slide over each other, and a view of one side of a wall fits the other side.
    pub(super) fn slide<E>(
        &mut self,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(best) = self.leader() else {
            return Ok(());
        };
        self.refiner.match_both(best.at, COMPARED);
        let Residual { source, target } = self.refiner.matched_residual_unseen(best.at);
        if source.max(target) < EXPLAINED_WELL {
            return Ok(());
        }
        let [_, compared] = SIFT_POINTS;
        let least = self.refiner.coarse_loss(best.at, compared, SIFT_SCALE);
        let axes = self.refiner.shift_axes(best.at);
        let mut found = Best::<SLID>::NONE;
        for axis in [axes.z_axis, axes.y_axis, axes.x_axis] {
            for shift in SLIDES {
                go_on()?;
                let shift = best.at.shift + axis * shift;
                let at = Rigid { shift, ..best.at };
                if let Some((_, at)) = self.refiner.sifted_early(least + SLID_ALIKE, at)
                    && !is_equal(at, best.at)
                {
                    self.hypotheses += 1;
                    let [loss, _] = self.refiner.keep_losses(SPARE, at);
                    found.offer(loss, at);
                }
            }
        }
        for (_, at) in found.held() {
            go_on()?;
            self.polish(at, prior);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::polish::tests::{error, moved, pose};
    use crate::polish::{Refiner, Workspace};
    use crate::start::Start;
    use crate::verify::tests::brick;

    /// Points on a rail with two knobs, between two places along it.
    fn rail(from: f32, to: f32, seed: u32) -> Vec<[f32; 3]> {
        let knob = |half, centre, seed| moved(&brick(half, 130, seed), pose([0.0; 3], centre));
        let mut points = brick([1.6, 0.3, 0.2], 1100, seed);
        points.extend(knob([0.12, 0.1, 0.1], [-0.25, 0.1, 0.3], seed + 1));
        points.extend(knob([0.06, 0.1, 0.08], [0.2, -0.15, 0.28], seed + 2));
        points.retain(|&[x, ..]| from < x && x < to);
        points
    }

    #[test]
    fn parts_of_a_rail_that_slid_over_each_other_are_put_right() {
        let mut workspace = Box::new(Workspace::new());
        let target = rail(-0.6, 1.7, 1);
        for slid in [-0.45, 0.4, 0.6] {
            let truth = pose([0.1, 0.0, 0.05], [0.2, 0.1, 0.0]);
            let source = moved(&rail(-1.7, 0.5, 4), truth.inverse());
            let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
            let start = pose([0.0; 3], [slid, 0.0, 0.0]).after(truth);
            let found = refiner.verify(start, &Start::at(start)).expect("a pose");
            let (angle, distance) = error(found.best.target_from_source, truth);
            assert!(angle < 1.5 && distance < 0.05, "{slid} {angle} {distance}");
        }
    }
}
