//! How well a pose fits: the losses of the matched points, and how much of the source lies on the target.

use super::{Refiner, Work};
use crate::loss;
use crate::solve::Rigid;

/// Weight of the source's points when poses are compared: the target often has sides that the source does not show.
const SOURCE_SHARE: f32 = 0.8;
/// The same if the background is known: masks of thin objects hold more of that than of the object, and what the target would
/// hide tells a pose that slid along it.
const SOURCE_SHARE_BEFORE_BACKGROUND: f32 = 0.4;
/// Highest loss of a target point that was not seen but need not have been; a point that would hide what was seen loses 1.
const UNSEEN: f32 = 0.5;

/// Distance from the target's centre within which a source point may be the object's, in target radii.
const INSIDE: f32 = 1.1;

/// How far apart two clouds are under a pose, in each direction: the mean over the points of a loss that is 0 on the other
/// cloud's surface and 1 near nothing of it. It is 0 for equal clouds, about .4 for two samples of one noisy surface, and 1 for
/// clouds that have nothing in common. A part that the other cloud lacks adds its share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// From the source's points to the target.
    pub source: f32,
    /// From the target's points to the source.
    pub target: f32,
}

impl Residual {
    /// Mean of both directions.
    pub fn mean(&self) -> f32 {
        0.5 * (self.source + self.target)
    }
}

/// How much of the source lies on the target's surface: see [`super::Refined`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Overlap {
    pub(super) on_surface: f32,
    pub(super) near: f32,
    pub(super) within: f32,
    pub(super) inside: f32,
    pub(super) inlier_rmse: f32,
}

impl Refiner<'_> {
    /// Residual of the points matched last, with a known view point taken into account.
    pub(crate) fn matched_residual(&mut self, at: Rigid) -> Residual {
        self.lose(at, loss::POINT_SHARE, true);
        self.lost()
    }

    /// The same without regard to the view point.
    pub(crate) fn matched_residual_unseen(&mut self, at: Rigid) -> Residual {
        self.lose(at, loss::POINT_SHARE, false);
        self.lost()
    }

    /// Mean of the losses computed last.
    fn lost(&self) -> Residual {
        let [source, target] = [&self.work.of_source, &self.work.of_target].map(|matched| {
            let (mut sum, mut count) = (0.0f64, 0u32);
            for loss in matched.lost() {
                sum += f64::from(loss);
                count += 1;
            }
            (sum / f64::from(count.max(1))) as f32
        });
        Residual { source, target }
    }

    /// How much of the source, as matched last, lies on the target's surface.
    pub(super) fn matched_overlap(&self, at: Rigid) -> Overlap {
        let [source, target] = self.surfaces();
        let pose = at.pose();
        let mut sum = 0.0f64;
        let [mut on_surface, mut near, mut within, mut inside, mut count] = [0u32; 5];
        for found in self.work.of_source.matches() {
            count += 1;
            let p = pose.apply(source.at(found.of).0);
            inside += u32::from(p.length_squared() < INSIDE * INSIDE);
            let Some(to) = found.to else { continue };
            let (q, n) = target.at(to);
            let apart = p - q;
            near += u32::from(loss::is_near_surface(apart, n, target.radius));
            within += u32::from(apart.length_squared() < target.radius * target.radius);
            if loss::is_on_surface(apart, n, target.radius) {
                let across = n.dot(apart);
                sum += f64::from(across * across);
                on_surface += 1;
            }
        }
        let share = |of: u32| (f64::from(of) / f64::from(count.max(1))) as f32;
        Overlap {
            on_surface: share(on_surface),
            near: share(near),
            within: share(within),
            inside: share(inside),
            inlier_rmse: libm::sqrt(sum / f64::from(on_surface.max(1))) as f32,
        }
    }

    /// Keeps the losses of the points matched last, lowered for source points beyond an edge of the target. Returns their
    /// weighted sum, scaled to [`loss::COMPARED`] points of each cloud, and the source's mean loss before lowering.
    pub(crate) fn keep_matched_losses(&mut self, contender: usize, at: Rigid) -> [f32; 2] {
        let all = self.matched_residual(at);
        self.spare_beyond_edges(at);
        self.keep_lost(contender);
        let Residual { source, target } = self.lost();
        let share = if self.work.seen.shows_background() {
            SOURCE_SHARE_BEFORE_BACKGROUND
        } else {
            SOURCE_SHARE
        };
        let mean = share * source + (1.0 - share) * target;
        [mean * 2.0 * loss::COMPARED as f32, all.source]
    }

    /// Lowers the losses of source points beyond an edge of the target. Points without a match look up a near point.
    fn spare_beyond_edges(&mut self, at: Rigid) {
        let (there, model) = (at.pose(), self.model);
        let Work {
            source, of_source, ..
        } = &mut *self.work;
        for (found, lost) in of_source.lost_mut() {
            let loss = f32::from_bits(*lost);
            if loss > loss::BEYOND_EDGE {
                let p = there.apply(source.at(found.of).0);
                let to = found.to.unwrap_or_else(|| model.lookup.near(p));
                let apart = p - model.surface.at(to).0;
                *lost = loss::beyond_edge(loss, apart, model.surface.inward(to)).to_bits();
            }
        }
    }

    /// Keeps losses of distances to surfaces, not to points, whose places are chance.
    pub(crate) fn keep_matched_surface_losses(&mut self, contender: usize, at: Rigid) {
        self.lose(at, 0.0, true);
        self.keep_lost(contender);
    }

    /// Keeps the losses computed last.
    fn keep_lost(&mut self, contender: usize) {
        let Work {
            of_source,
            of_target,
            losses,
            ..
        } = &mut *self.work;
        losses.keep(contender, [of_source.lost(), of_target.lost()]);
    }

    /// Computes the losses of the points matched last: 1 for those near nothing. If a view point is known and `looks` is set,
    /// target points lose 1 if they would hide what was seen, and less if they merely were not seen.
    fn lose(&mut self, at: Rigid, point_share: f32, looks: bool) {
        let (isa, target, there) = (self.isa, &self.model.surface, at.pose());
        let Work {
            source,
            of_source,
            of_target,
            seen,
            facing,
            ..
        } = &mut *self.work;
        of_source.lose(isa, [source, target], there, point_share);
        let back = there.inverse();
        of_target.lose(isa, [target, source], back, point_share);
        if looks && seen.is_known() {
            for (found, lost) in of_target.lost_mut() {
                let is_hidden = seen.hides(back.apply(target.at(found.of).0));
                let loss = if is_hidden {
                    1.0
                } else if facing.is_hidden(found.of) {
                    UNSEEN
                } else {
                    UNSEEN * f32::from_bits(*lost)
                };
                *lost = loss.to_bits();
            }
        }
    }
}
