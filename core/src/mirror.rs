//! Whether the source fits better as its mirror image: a left-hand part taken for a right-hand one, or a file with an axis the
//! other way around.
//!
//! Few hypotheses are enough: a mirrored part lies where its mirror image in a plane of symmetry would, or nearly, or on the
//! target's principal axes. Points that the pose at hand matches are compared: a part of a symmetric thing, mirrored, may overlap
//! with more of the target than it should. Where nearly all points are matched, all are compared, and count less.

use crate::loss::{COMPARED, CONTENDERS};
use crate::polish::Refiner;
use crate::search::{Best, SIFT_POINTS, SIFT_SCALE, aligned, mirrored};
use crate::solve::Rigid;
use crate::surface::Surface;

/// Mirror images that take further steps, and those that are polished.
const SIFTED: usize = 4;
const POLISHED: usize = 2;
/// How much more the best of them may lose after those steps to be polished at all.
const ALIKE: f32 = 0.03;
/// Share of points matched from which on clouds show about the same, and what a difference over all points counts then.
const WHOLE: f32 = 0.75;
const OF_ALL: f32 = 0.4;

impl Refiner<'_> {
    /// By how much better the source's mirror image fits than the source under its pose, in standard errors.
    pub(crate) fn mirror_score(&mut self, found: Rigid) -> f32 {
        const HERE: usize = CONTENDERS - 1;
        const MIRRORED: usize = CONTENDERS - 2;
        let [_, sifted_on] = SIFT_POINTS;
        self.keep_surface_losses(HERE, found);
        let least = self.coarse_loss(found, sifted_on, SIFT_SCALE);
        self.mirror_source();
        let [source, target] = self.surfaces().map(Surface::axes);
        let mut screened = Best::<SIFTED>::NONE;
        for at in mirrored(found, target).chain(aligned(source, target, found.shift)) {
            self.screen(at, &mut screened);
        }
        let mut sifted = Best::<POLISHED>::NONE;
        for (_, at) in screened.held() {
            if let Some((loss, at)) = self.sifted_early(least + ALIKE, at) {
                sifted.offer(loss, at);
            }
        }
        let mut most = 0.0f32;
        for (_, at) in sifted.held() {
            let Some(at) = self.polish_briefly(at, |_| false) else {
                continue;
            };
            self.keep_surface_losses(MIRRORED, at);
            let losses = self.losses();
            most = most.max(losses.excess_where_matched(HERE, MIRRORED).score());
            if losses.matched(HERE) > WHOLE {
                most = most.max(OF_ALL * losses.excess(HERE, MIRRORED).score());
            }
        }
        self.mirror_source();
        most
    }

    fn keep_surface_losses(&mut self, contender: usize, at: Rigid) {
        self.match_both(at, COMPARED);
        self.keep_matched_surface_losses(contender, at);
    }
}
