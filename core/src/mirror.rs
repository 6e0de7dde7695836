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

/// Standard errors from which on it is no chance that the mirror image fits better: more than of independent points, since
/// errors of neighbours are alike. Of right poses of training models, none had as many.
pub(crate) const MIRRORED: f32 = 5.0;
/// The same up to which another pose fits as well as the image.
const OVER_OTHERS: f32 = 2.0;
/// Place of the losses under a pose that is none of the mirror image's; those of the mirror image's are the first.
const HERE: usize = CONTENDERS - 1;

impl Refiner<'_> {
    /// By how much better the source's mirror image fits than the source under its pose, in standard errors; where that is much, but one
    /// of the poses that were compared with it fits about as well as the image, than under that.
    pub(crate) fn mirror_score(
        &mut self,
        found: Rigid,
        others: impl Iterator<Item = Rigid>,
    ) -> f32 {
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
        let mut images = 0;
        for (_, at) in sifted.held() {
            if let Some(at) = self.polish_briefly(at, |_| false) {
                self.keep_surface_losses(images, at);
                images += 1;
            }
        }
        self.mirror_source();
        let mut score = self.best_of_images(images);
        for at in others {
            if score > MIRRORED {
                self.keep_surface_losses(HERE, at);
                let over = self.best_of_images(images);
                score = if over < OVER_OTHERS { over } else { score };
            }
        }
        score
    }

    fn keep_surface_losses(&mut self, contender: usize, at: Rigid) {
        self.match_both(at, COMPARED);
        self.keep_matched_surface_losses(contender, at);
    }

    /// By how much better the best of the mirror images fits than what was kept last, in standard errors; 0 if none does.
    fn best_of_images(&self, images: usize) -> f32 {
        let losses = self.losses();
        let of = |image: usize| {
            let matched = losses.excess_where_matched(HERE, image).score();
            let all = losses.excess(HERE, image).score();
            let is_whole = losses.matched(HERE) > WHOLE;
            matched.max(if is_whole { OF_ALL * all } else { 0.0 })
        };
        (0..images).map(of).fold(0.0, f32::max)
    }
}
