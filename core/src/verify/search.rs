//! The search for poses that might be right instead: hypotheses, and the choice of those that enter the comparison.

use super::{ALL_LOST, Contender, RANKED};
use crate::loss::{COMPARED, CONTENDERS};
use crate::pairs::matching_pairs;
use crate::polish::{Candidate, Refiner, Residual};
use crate::rotation::Rotation;
use crate::search::{
    Best, SCREEN_SCALE, SIFT_POINTS, SIFT_SCALE, aligned, anywhere, around, cube_rotations,
    is_equal, is_same, symmetry_candidates,
};
use crate::solve::Rigid;
use crate::start::Prior;
use crate::surface::Surface;

/// Hypotheses that are sifted in the first round, and in the second.
const SIFTED: usize = 24;
const SIFTED_AGAIN: usize = 6;
/// Number of best hypotheses whose symmetric copies are tried.
const AGAIN: usize = 2;
/// Loss of the best sifted hypothesis above which pairs of points give further hypotheses, and more are polished.
const EXPLAINED: f32 = 0.25;
/// Loss of the best pose above which poses near it are tried; typical if clouds overlap only in part.
pub(super) const UNEXPLAINED: f32 = 0.4;
/// Points that judge the hypotheses from pairs, first and last; how
/// much loss the first may add by chance; and how many are sifted.
const PAIR_POINTS: [usize; 2] = [32, 128];
const PAIR_SLACK: f32 = 0.08;
const MATCHED: usize = 160;
/// Most hypotheses that are sifted.
pub(super) const ENDED: usize = SIFTED + MATCHED + AGAIN * SIFTED_AGAIN;
/// Symmetric copies that are polished, and how much more loss than the best they may have.
const COPIES: usize = 8;
pub(super) const ALIKE: f32 = 0.08;
/// Residual on both sides below which a pose explains both clouds, with no side unseen. If the pose at hand does, and something
/// led to it, another replaces it only if it is more probable by `MORE_PROBABLE` (a logarithm) or fits better by `BETTER`
/// standard errors: the copies of a symmetric shape differ by their sampling alone.
const BOTH_EXPLAINED: f32 = 0.55;
pub(super) const MORE_PROBABLE: f32 = 1.0;
const BETTER: f32 = 2.0;
/// Standard errors by which a pose that explains both clouds must fit better than the most probable one to replace it. Fewer are enough
/// with residuals below `WELL_EXPLAINED`: the clouds then overlap as a whole, not by chance in some part.
const FAR_BETTER: f32 = 10.0;
const CLEARLY_BETTER: f32 = 3.0;
const WELL_EXPLAINED: f32 = 0.4;
/// How much more loss than the best a polished hypothesis may have: normally, and with the pose at hand held on to.
const FAR_BEHIND: f32 = 0.2;
const BEHIND: f32 = 0.1;
/// Hypotheses polished besides the start and the policy's pose: if the best explains the source, and if it does not.
const POLISHED: usize = 5;
const POLISHED_LOST: usize = 12;
/// Rotation constraint below which planes leave an angle free: then spins are tried, and their fit is examined.
pub(super) const SLIPPERY: f32 = 0.06;
/// Spins about the axis about which planes constrain rotation least: every 4.5 degrees, from two poses.
const SPINS: usize = 80;
/// Points of each cloud by which spins are compared.
const SPIN_POINTS: usize = 64;
/// Spins that are polished.
const SPINS_POLISHED: usize = 1;

/// Index of the losses of a pose under examination.
pub(super) const SPARE: usize = CONTENDERS - 1;

/// A search in progress.
pub(super) struct Search<'r, 'w> {
    pub(super) refiner: &'r mut Refiner<'w>,
    /// Whether the pose at hand, the first contender, is held on to: something led to it, and it explains both clouds.
    pub(super) keeps_pose_at_hand: bool,
    pub(super) hypotheses: usize,
    /// Where the sifted hypotheses ended.
    pub(super) ended: [Option<Rigid>; ENDED],
    pub(super) contenders: [Option<Contender>; RANKED],
}

/// Whether a pose explains both clouds.
pub(super) fn explains_both(Residual { source, target }: Residual) -> bool {
    source.max(target) < BOTH_EXPLAINED
}

impl Search<'_, '_> {
    /// Enters a polished pose into the comparison: in place of one of the same hypothesis,
    /// else in a free place, else in place of the worst if it is more probable. The first
    /// place is the pose at hand's; only a better one of its own hypothesis takes it. The pose
    /// that fits best keeps a place, however improbable the start makes it.
    pub(super) fn enter(&mut self, at: Rigid, prior: Option<&Prior>) {
        if is_held(&self.contenders, at) {
            return;
        }
        let energy = self.refiner.keep_energy(SPARE, at, prior);
        let fit = energy - prior.map_or(0.0, |prior| prior.surprise(at));
        let fits = self.contenders.iter().flatten().map(|held| held.fit);
        let best_fit = fits.fold(f32::INFINITY, f32::min);
        let is_best_fit = fit < best_fit;
        let energy_of = |held: &Option<Contender>| held.map_or(f32::INFINITY, |held| held.energy);
        let is_twin = |held: &Option<Contender>| held.is_some_and(|held| is_same(held.at, at));
        let replaceable = usize::from(self.contenders.iter().any(Option::is_some));
        let place = self.contenders.iter().position(is_twin).or_else(|| {
            let places = self.contenders.iter().enumerate().skip(replaceable);
            let places = places
                .filter(|(_, held)| is_best_fit || held.is_none_or(|held| held.fit > best_fit));
            let least_probable = places.min_by(|a, b| energy_of(b.1).total_cmp(&energy_of(a.1)));
            least_probable.map(|(i, _)| i)
        });
        if let Some(i) = place
            && let Some(held) = self.contenders.get_mut(i)
            && (energy < energy_of(held) || is_best_fit && !is_twin(held))
        {
            *held = Some(Contender { at, energy, fit });
            self.refiner.losses_mut().copy(SPARE, i);
        }
    }

    /// Polishes a pose briefly and enters it, unless it turns out to be one already held.
    pub(super) fn polish(&mut self, at: Rigid, prior: Option<&Prior>) {
        let is_known = |at| is_held(&self.contenders, at);
        if let Some(at) = self.refiner.polish_briefly(at, is_known) {
            self.enter(at, prior);
        }
    }

    /// Tries symmetric copies of the best pose that fit about as well: one of them may be right.
    pub(super) fn copies<E>(
        &mut self,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(best) = self.leader() else {
            return Ok(());
        };
        let [_, compared] = SIFT_POINTS;
        let least = self.refiner.coarse_loss(best.at, compared, SIFT_SCALE);
        let [_, target] = self.refiner.surfaces();
        let axes = target.axes();
        let mut found = Best::<COPIES>::NONE;
        for at in cube_rotations(best.at, axes) {
            go_on()?;
            // The target's centre need not be the centre of its symmetries: a few steps lead to where the copy fits.
            if let Some((_, at)) = self.refiner.sifted_early(least + ALIKE, at) {
                self.hypotheses += 1;
                self.refiner.match_both(at, compared);
                found.offer(self.refiner.matched_residual(at).mean(), at);
            }
        }
        for (_, at) in found.held() {
            go_on()?;
            self.polish(at, prior);
        }
        Ok(())
    }

    /// The best pose so far.
    pub(super) fn leader(&self) -> Option<Contender> {
        self.best()
            .and_then(|i| self.contenders.get(i).copied().flatten())
    }

    pub(super) fn best(&self) -> Option<usize> {
        let energy = |i: usize| self.contenders.get(i).copied().flatten().map(|c| c.energy);
        let held = (0..RANKED).filter_map(|i| energy(i).map(|energy| (i, energy)));
        let (best, least) = held.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let holds = self.keeps_pose_at_hand
            && energy(0)? - least < MORE_PROBABLE
            && self.refiner.losses().excess(0, best).score() < BETTER;
        Some(if holds { 0 } else { best })
    }

    /// Given the most probable pose, returns one that explains both clouds and fits far better, if any, whatever the start. A view
    /// does not explain what of the target it does not show.
    pub(super) fn far_better(&mut self, best: usize) -> usize {
        let score = |i: usize| self.refiner.losses().excess(best, i).score();
        let held = self.contenders.iter().enumerate();
        let held = held.filter_map(|(i, held)| held.map(|held| (score(i), i, held.at)));
        let best_fit = held.max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((score, i, at)) = best_fit.filter(|&(score, ..)| score > CLEARLY_BETTER) else {
            return best;
        };
        self.refiner.match_both(at, COMPARED);
        let Residual { source, target } = self.refiner.matched_residual_unseen(at);
        let most = if score > FAR_BETTER {
            BOTH_EXPLAINED
        } else {
            WELL_EXPLAINED
        };
        if source.max(target) < most { i } else { best }
    }

    /// Screens hypotheses, sifts the best and enters the best of those. If the pose at hand is held on to and planes fix its
    /// rotation, it tries only hypotheses near it and those that a symmetry would confuse with it.
    pub(super) fn screen<E>(
        &mut self,
        polished: Candidate,
        begun: Rigid,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let looks_far = !self.keeps_pose_at_hand || polished.rotation_constraint < SLIPPERY;
        let polished = polished.at;
        let [source_axes, target_axes] = self.refiner.surfaces().map(Surface::axes);
        let mut screened = Best::<SIFTED>::NONE;
        let begun_elsewhere = !is_same(begun, polished);
        let far = around(begun)
            .filter(|_| begun_elsewhere)
            .chain(anywhere(begun))
            .filter(|_| looks_far);
        let hypotheses = around(polished)
            .chain(symmetry_candidates(polished, target_axes))
            .chain(aligned(source_axes, target_axes, polished.shift))
            .chain(far);
        for at in hypotheses {
            go_on()?;
            self.offer(at, &mut screened);
        }
        let mut sifted = Best::<POLISHED_LOST>::NONE;
        for (_, at) in screened.held() {
            go_on()?;
            self.sift(at, prior, &mut sifted);
        }
        let is_explained = sifted.least().is_some_and(|least| least < EXPLAINED);
        if looks_far && !is_explained {
            self.match_pairs(prior, &mut sifted, go_on)?;
        }
        // Copies of the pose at hand were tried already.
        let so_far = sifted.clone();
        let firsts = so_far.held().take(AGAIN);
        let firsts = firsts.filter(|&(_, first)| looks_far && !is_same(first, polished));
        for (_, first) in firsts {
            let mut screened = Best::<SIFTED_AGAIN>::NONE;
            for at in symmetry_candidates(first, target_axes) {
                go_on()?;
                self.offer(at, &mut screened);
            }
            for (_, at) in screened.held() {
                go_on()?;
                self.sift(at, prior, &mut sifted);
            }
        }
        let behind = if looks_far { FAR_BEHIND } else { BEHIND };
        let most = sifted.least().unwrap_or(0.0) + behind;
        let count = if is_explained {
            POLISHED
        } else {
            POLISHED_LOST
        };
        let near_best = sifted.held().take_while(|&(loss, _)| loss < most);
        for (_, at) in near_best.take(count) {
            go_on()?;
            self.polish(at, prior);
        }
        Ok(())
    }

    /// Sifts the best hypotheses that pairs of oriented points give.
    fn match_pairs<E>(
        &mut self,
        prior: Option<&Prior>,
        sifted: &mut Best<POLISHED_LOST>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let mut matched = Best::<MATCHED>::NONE;
        let [source, target] = self.refiner.surfaces();
        // Few points are enough to drop most of them.
        let [few, all] = PAIR_POINTS.map(|points| {
            move |r: &Refiner<'_>, most, at| r.coarse_loss_below(most, at, points, SCREEN_SCALE)
        });
        matching_pairs(self.refiner.isa(), source, target, |at| {
            let most = matched.most();
            if few(self.refiner, most + PAIR_SLACK, at) - PAIR_SLACK < most {
                matched.offer(all(self.refiner, most, at), at);
            }
        });
        for (_, at) in matched.held() {
            go_on()?;
            self.hypotheses += 1;
            self.sift(at, prior, sifted);
        }
        Ok(())
    }

    fn offer<const N: usize>(&mut self, at: Rigid, screened: &mut Best<N>) {
        self.hypotheses += 1;
        self.refiner.screen(at, screened);
    }

    /// Takes further steps and offers the result; of results that fit alike, the most probable under the start wins.
    fn sift(&mut self, at: Rigid, prior: Option<&Prior>, sifted: &mut Best<POLISHED_LOST>) {
        let (loss, at) = self.refiner.sifted_below(sifted.most(), at);
        let surprise = prior.map_or(0.0, |prior| prior.surprise(at));
        // Where the camera looked through the target, it cannot be.
        let through = self.refiner.seen_through(at, 8);
        let loss = loss + surprise / (12.0 * ALL_LOST) + through;
        if let Some(place) = self.ended.iter_mut().find(|ended| ended.is_none()) {
            *place = Some(at);
        }
        sifted.offer(loss, at);
    }

    /// If planes leave the angle about an axis free, points that both clouds share may tell it: tries copies turned about it in
    /// small steps, right way up and upside down.
    pub(super) fn spin<E>(
        &mut self,
        polished: Candidate,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let at = self.leader().map_or(polished.at, |best| best.at);
        let (axis, constraint) = self.refiner.least_constraint(at);
        if constraint >= SLIPPERY {
            return Ok(());
        }
        let mut spun = Best::<SPINS_POLISHED>::NONE;
        let upside_down = Rotation::new(axis.any_orthonormal_vector(), 0.0);
        let step = Rotation::about(axis, core::f32::consts::TAU / SPINS as f32);
        for from in [at, at.turned(upside_down)] {
            let mut at = from;
            for _ in 0..SPINS {
                go_on()?;
                self.hypotheses += 1;
                self.refiner.match_both(at, SPIN_POINTS);
                spun.offer(self.refiner.matched_residual(at).mean(), at);
                at = at.turned(step);
            }
        }
        for (_, at) in spun.held() {
            self.polish(at, prior);
        }
        Ok(())
    }
}

/// Whether a refinement that ended in this pose was entered already.
fn is_held(contenders: &[Option<Contender>; RANKED], at: Rigid) -> bool {
    contenders
        .iter()
        .flatten()
        .any(|held| is_equal(held.at, at))
}
