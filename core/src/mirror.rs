//! Whether the source fits better as its mirror image: a left-hand part taken for a right-hand one, or one axis reversed.
//!
//! Few hypotheses are enough: a mirrored part lies about where a plane of symmetry would mirror it, or on the target's
//! principal axes. The comparison is over the points that the pose at hand matches, since a mirrored part of a symmetric object
//! may overlap more of the target than it should. If most points are matched, all are compared as well, with less weight unless nearly all are.

use crate::loss::{COMPARED, CONTENDERS};
use crate::polish::Refiner;
use crate::search::{Best, SIFT_POINTS, SIFT_SCALE, aligned, mirrored};
use crate::solve::Rigid;
use crate::surface::Surface;

/// Mirror images that take further steps, and mirror images that are polished.
const SIFTED: usize = 4;
const POLISHED: usize = 2;
/// How much more than the pose at hand a mirror image may lose after those steps and still be polished.
const ALIKE: f32 = 0.03;
/// Shares of points matched from which on the clouds show about the same, and the weights of the score over all points then; between
/// them the weight grows. What is beside the target may be another object unless it is little.
const WHOLE: [f32; 2] = [0.75, 0.9];
const OF_ALL: [f32; 2] = [0.4, 0.7];

/// Standard errors from which on the mirror image's better fit is no chance. The limit is higher than for independent points,
/// since errors of neighbours are correlated. No right pose of a training model reached it.
pub(crate) const MIRRORED: f32 = 5.0;
/// Standard errors below which another pose fits as well as the image.
const OVER_OTHERS: f32 = 2.0;
/// Index of the losses under a pose of the source itself; those of the mirror images come first.
const HERE: usize = CONTENDERS - 1;

impl Refiner<'_> {
    /// How much better the source's mirror image fits than the source under its pose, in standard errors. If the score is high
    /// but one of the `others` fits about as well as the image, the score over that pose instead.
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

    /// How much better the best mirror image fits than the pose kept last, in standard errors; 0 if none fits better.
    fn best_of_images(&self, images: usize) -> f32 {
        let losses = self.losses();
        let of = |image: usize| {
            let matched = losses.excess_where_matched(HERE, image).score();
            let all = losses.excess(HERE, image).score();
            let ([least, most], [light, full]) = (WHOLE, OF_ALL);
            let share = (losses.matched(HERE) - least) / (most - least);
            if share > 0.0 {
                let weight = light + (full - light) * share.min(1.0);
                matched.max(weight * all)
            } else {
                matched
            }
        };
        (0..images).map(of).fold(0.0, f32::max)
    }
}
