//! Comparison of a pose with others that might be right instead, and what stays open where several are.
//!
//! | stage | hypotheses | what |
//! |---|---|---|
//! | screen | the start and the policy's pose, and around each: moved, turned; turned as symmetries of the target would; principal axes on principal axes; rotations anywhere | few coarse steps on few points |
//! | sift | the best of those | more steps on more points |
//! | pairs | where none explains the source: pairs of its points with normals on pairs of the target's like them | more steps on more points |
//! | again | the best of those, turned as symmetries of the target would | both stages |
//! | polish | the best that differ | [`Refiner::polish`], briefly |
//! | copies | the best, turned as a cube's symmetries would | the same, where they fit about as well |
//! | nudge | the best, turned and moved a little, where it explains little | sifted, the best of them polished |
//! | decide | the same | loss point by point, and how probable each is under the start's uncertainty |

use crate::error::Error;
use crate::loss::{COMPARED, CONTENDERS};
use crate::pairs::matching_pairs;
use crate::polish::{Candidate, Refined, Refiner};
use crate::pose::Pose;
use crate::search::{
    Best, SCREEN_SCALE, SIFT_POINTS, SIFT_SCALE, aligned, anywhere, around, confused, copies,
    is_equal, is_same, nudged,
};
use crate::solve::Rigid;
use crate::start::{Prior, Start};
use crate::surface::Surface;
use crate::turn::Turn;

mod undetermined;

use undetermined::lead;
pub use undetermined::{Axis, OTHERS, Undetermined};

/// Hypotheses that are sifted, and the same of the second round.
const SIFTED: usize = 24;
const SIFTED_AGAIN: usize = 6;
/// Best ones whose symmetric copies are tried, too.
const AGAIN: usize = 2;
/// Loss of the best of them above which poses are looked for by pairs of points, and near the best: where clouds overlap in
/// part.
const UNEXPLAINED: f32 = 0.4;
/// Points by which those are judged, first and last, by how much the first may mislead, and how many of them are sifted.
const PAIR_POINTS: [usize; 2] = [32, 128];
const PAIR_SLACK: f32 = 0.08;
const MATCHED: usize = 48;
/// Hypotheses that are sifted, at most.
const ENDED: usize = SIFTED + MATCHED + AGAIN * SIFTED_AGAIN;
/// Symmetric copies that are polished, and by how much more loss they count as such.
const COPIES: usize = 4;
const ALIKE: f32 = 0.08;
/// Poses near the best that are polished.
const NUDGED: usize = 3;
/// How much more loss than the best a hypothesis may have to be polished.
const FAR_BEHIND: f32 = 0.2;
/// Hypotheses that are polished besides the start and the policy's pose.
const POLISHED: usize = 5;
/// Below this share of all axes, planes do not tell an angle: spins are tried, and it is looked how far they fit.
const SLIPPERY: f32 = 0.06;
/// Spins about the axis about which planes fix a rotation least: every 4.5 degrees, from two poses.
const SPINS: usize = 80;
/// Points of each cloud by which spins are compared.
const SPIN_POINTS: usize = 64;
/// Spins that are polished.
const SPINS_POLISHED: usize = 1;
/// Logarithm of probability that a whole point's loss stands for: far less than a point's own, since errors of neighbours
/// are alike, and sensors, models and masks have faults that no sampling explains.
const EVIDENCE: f32 = 0.014;
/// Mean loss of the source under a pose that explains so little of it that a start does not speak for it, and how many times a
/// loss above that counts: where clouds overlap by a third, only what lies far from the start may explain them.
const HARDLY_EXPLAINED: f32 = 0.7;
const BEYOND: f32 = 5.0;

/// Poses that are compared at last, at most: the last two places for losses are for comparisons of another kind.
pub const RANKED: usize = CONTENDERS - 2;

/// A pose that was compared with others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verified {
    /// The best pose.
    pub best: Refined,
    /// The pose at hand, polished without looking at others.
    pub polished: Refined,
    /// Hypotheses that were tried besides.
    pub hypotheses: usize,
    /// How many of those that were looked at closely ended in the best pose.
    pub support: usize,
    /// How much less probable the next of the poses compared is, the same turned about an open axis left out: a difference of
    /// [`Ranked::energy`]; infinite where there is none.
    pub lead: f32,
    /// What the shape leaves open.
    pub undetermined: Undetermined,
    /// By how much better the source's mirror image fits where the best pose matches points, in standard errors; 0 if it
    /// does not.
    pub mirror_score: f32,
    /// The poses that were compared, the most probable first.
    pub ranked: [Option<Ranked>; RANKED],
}

/// A pose among others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranked {
    /// Plain rigid transform.
    pub target_from_source: Pose,
    /// How improbable it is by how the clouds fit and under the start, a negative logarithm: comparable between poses of the same
    /// clouds, from whatever start.
    pub energy: f32,
}

/// A polished hypothesis in the comparison.
#[derive(Clone, Copy)]
struct Contender {
    at: Rigid,
    /// Less is better: loss, and how improbable it is under the start.
    energy: f32,
}

impl Refiner<'_> {
    /// Compares a pose with others and takes the most probable, by fit and by the start.
    ///
    /// # Errors
    /// [`Error::BadPose`] for a pose that is not rigid.
    pub fn verify(&mut self, pose: Pose, start: &Start) -> Result<Verified, Error> {
        self.verify_while(pose, start, || Ok(()))
    }

    /// As [`Self::verify`], asking before every hypothesis whether to go on.
    ///
    /// # Errors
    /// As [`Self::verify`], and whatever `go_on` returns.
    pub fn verify_while<E: From<Error>>(
        &mut self,
        pose: Pose,
        start: &Start,
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Verified, E> {
        let at_hand = self.inside(pose.checked()?);
        let begun = self.inside(start.pose().checked()?);
        let prior = self.prior(start)?;
        let polished = self.polish_inside(at_hand);
        let mut search = Search {
            refiner: self,
            hypotheses: 0,
            ended: [None; ENDED],
            contenders: [None; RANKED],
        };
        search.enter(polished.at, prior.as_ref());
        if begun != at_hand && prior.is_some() {
            let at = search.refiner.polish_briefly(begun);
            search.enter(at, prior.as_ref());
        }
        search.screen(polished.at, begun, prior.as_ref(), &mut go_on)?;
        search.spin(polished, prior.as_ref(), &mut go_on)?;
        search.copies(prior.as_ref(), &mut go_on)?;
        search.nudge(prior.as_ref(), &mut go_on)?;
        let best = search.best().unwrap_or(0);
        let hypotheses = search.hypotheses;
        let (contenders, ended) = (search.contenders, search.ended);
        let winner = contenders.get(best).copied().flatten();
        let further = winner
            .filter(|winner| best > 0 || winner.at != polished.at || !polished.is_settled())
            .map(|winner| self.polish_inside(winner.at));
        let found = further.unwrap_or(polished);
        let ranked = self.ranked(best, &found, &contenders);
        let undetermined = self.undetermined(best, &found, &contenders);
        let support = ended.iter().flatten().filter(|&&at| is_same(at, found.at));
        let support = support.count();
        let lead = lead(best, &contenders, undetermined.axis);
        let mirror_score = self.mirror_score(found.at);
        let polished = self.refined(&polished, pose);
        Ok(Verified {
            best: further.map_or(polished, |found| self.refined(&found, pose)),
            polished,
            hypotheses,
            support,
            lead,
            undetermined,
            mirror_score,
            ranked,
        })
    }

    /// How improbable a pose is ([`Ranked::energy`]).
    ///
    /// # Errors
    /// [`Error::BadPose`] for a pose or a start that is not rigid.
    pub fn energy(&mut self, pose: Pose, start: &Start) -> Result<f32, Error> {
        let at = self.inside(pose.checked()?);
        let prior = self.prior(start)?;
        let losses = self.keep_losses(0, at);
        Ok(energy(
            losses,
            prior.map_or(0.0, |prior| prior.surprise(at)),
        ))
    }

    /// Whether two poses are one hypothesis: within 8 degrees and .15 target radii of each other.
    pub fn is_same(&self, a: Pose, b: Pose) -> bool {
        is_same(self.inside(a), self.inside(b))
    }

    fn prior(&self, start: &Start) -> Result<Option<Prior>, Error> {
        let begun = self.inside(start.pose().checked()?);
        Ok(match *start {
            Start::Pose(_, uncertainty) => Some(Prior::new(begun, self.ahead(), uncertainty)),
            Start::Anywhere => None,
        })
    }

    /// The contenders as poses, the most probable first; the best as it was found.
    fn ranked(
        &self,
        best: usize,
        found: &Candidate,
        contenders: &[Option<Contender>; RANKED],
    ) -> [Option<Ranked>; RANKED] {
        let mut ranked = [None; RANKED];
        for (i, (place, contender)) in ranked.iter_mut().zip(contenders).enumerate() {
            *place = contender.map(|contender| Ranked {
                target_from_source: self.outside(if i == best { found.at } else { contender.at }),
                energy: contender.energy,
            });
        }
        let energy = |ranked: &Option<Ranked>| ranked.map_or(f32::INFINITY, |r| r.energy);
        ranked.sort_unstable_by(|a, b| energy(a).total_cmp(&energy(b)));
        ranked
    }

    /// Keeps the losses under a pose, point by point; their sum, and the mean of the source's.
    fn keep_losses(&mut self, contender: usize, at: Rigid) -> [f32; 2] {
        self.match_both(at, COMPARED);
        self.keep_matched_losses(contender, at)
    }
}

/// A search under way.
struct Search<'r, 'w> {
    refiner: &'r mut Refiner<'w>,
    hypotheses: usize,
    /// Where those that were sifted ended.
    ended: [Option<Rigid>; ENDED],
    contenders: [Option<Contender>; RANKED],
}

impl Search<'_, '_> {
    /// Enters a polished pose into the comparison: in place of one that is the same, else in a free place or that of the worst,
    /// if it is more probable. The first is the pose at hand, and stays.
    fn enter(&mut self, at: Rigid, prior: Option<&Prior>) {
        const SPARE: usize = CONTENDERS - 1;
        if self.held().any(|held| is_equal(held.at, at)) {
            return;
        }
        let losses = self.refiner.keep_losses(SPARE, at);
        let surprise = prior.map_or(0.0, |prior| prior.surprise(at));
        let energy = energy(losses, surprise);
        let energy_of = |held: &Option<Contender>| held.map_or(f32::INFINITY, |held| held.energy);
        let is_twin = |held: &Option<Contender>| held.is_some_and(|held| is_same(held.at, at));
        let replaceable = usize::from(self.held().next().is_some());
        let place = self.contenders.iter().position(is_twin).or_else(|| {
            let places = self.contenders.iter().enumerate().skip(replaceable);
            let least_probable = places.min_by(|a, b| energy_of(b.1).total_cmp(&energy_of(a.1)));
            least_probable.map(|(i, _)| i)
        });
        if let Some(i) = place
            && let Some(held) = self.contenders.get_mut(i)
            && energy < energy_of(held)
        {
            *held = Some(Contender { at, energy });
            self.refiner.losses_mut().copy(SPARE, i);
        }
    }

    /// Symmetric copies of the best pose that fit about as well: one of them may be right.
    fn copies<E>(
        &mut self,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(best) = self
            .best()
            .and_then(|i| self.contenders.get(i).copied().flatten())
        else {
            return Ok(());
        };
        let [points, compared] = SIFT_POINTS;
        let least = self.refiner.coarse_loss(best.at, points, SIFT_SCALE);
        let [_, target] = self.refiner.surfaces();
        let axes = target.axes();
        let mut found = Best::<COPIES>::NONE;
        for at in copies(best.at, axes) {
            if self.refiner.coarse_loss(at, points, SIFT_SCALE) < least + ALIKE {
                go_on()?;
                self.hypotheses += 1;
                self.refiner.match_both(at, compared);
                found.offer(self.refiner.matched_residual(at).mean(), at);
            }
        }
        for (_, at) in found.held() {
            go_on()?;
            let at = self.refiner.polish_briefly(at);
            self.enter(at, prior);
        }
        Ok(())
    }

    /// Poses near the best where that explains little: there small steps end in one of several minima side by side.
    fn nudge<E>(
        &mut self,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let best = self.best().and_then(|i| self.contenders.get(i).copied());
        let Some(best) = best.flatten() else {
            return Ok(());
        };
        let [_, compared] = SIFT_POINTS;
        if self.refiner.coarse_loss(best.at, compared, SIFT_SCALE) < UNEXPLAINED {
            return Ok(());
        }
        // By the loss alone: those beside each other are what is looked for.
        let mut nearest = [None; NUDGED];
        for at in nudged(best.at) {
            go_on()?;
            self.hypotheses += 1;
            let mut carried = Some(self.refiner.sifted(at));
            for held in &mut nearest {
                let loss = |sifted: &Option<(f32, Rigid)>| sifted.map_or(f32::INFINITY, |s| s.0);
                if loss(&carried) < loss(held) {
                    core::mem::swap(held, &mut carried);
                }
            }
        }
        for (_, at) in nearest.into_iter().flatten() {
            go_on()?;
            let at = self.refiner.polish_briefly(at);
            self.enter(at, prior);
        }
        Ok(())
    }

    fn held(&self) -> impl Iterator<Item = Contender> {
        self.contenders.iter().flatten().copied()
    }

    fn best(&self) -> Option<usize> {
        let held = self.contenders.iter().enumerate();
        held.filter_map(|(i, contender)| contender.map(|c| (i, c.energy)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| i)
    }

    /// Screens hypotheses, sifts the best and enters the best of those.
    fn screen<E>(
        &mut self,
        polished: Rigid,
        begun: Rigid,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let [source_axes, target_axes] = self.refiner.surfaces().map(Surface::axes);
        let mut screened = Best::<SIFTED>::NONE;
        let begun_elsewhere = !is_same(begun, polished);
        let hypotheses = around(polished)
            .chain(around(begun).filter(|_| begun_elsewhere))
            .chain(confused(polished, target_axes))
            .chain(aligned(source_axes, target_axes, polished.shift))
            .chain(anywhere(begun));
        for at in hypotheses {
            go_on()?;
            self.offer(at, &mut screened);
        }
        let mut sifted = Best::<POLISHED>::NONE;
        for (_, at) in screened.held() {
            go_on()?;
            self.sift(at, &mut sifted);
        }
        let is_explained = sifted.least().is_some_and(|least| least < UNEXPLAINED);
        if !is_explained {
            let mut matched = Best::<MATCHED>::NONE;
            let [source, target] = self.refiner.surfaces();
            for at in matching_pairs(source, target) {
                // Most are given up after few points.
                let [few, all] = PAIR_POINTS
                    .map(|points| move |r: &Refiner<'_>| r.coarse_loss(at, points, SCREEN_SCALE));
                if matched.takes(few(self.refiner) - PAIR_SLACK) {
                    matched.offer(all(self.refiner), at);
                }
            }
            for (_, at) in matched.held() {
                go_on()?;
                self.hypotheses += 1;
                self.sift(at, &mut sifted);
            }
        }
        // The copies of the pose at hand were tried already.
        let firsts = sifted.clone().held().take(AGAIN);
        for (_, first) in firsts.filter(|&(_, first)| !is_same(first, polished)) {
            let mut screened = Best::<SIFTED_AGAIN>::NONE;
            for at in confused(first, target_axes) {
                go_on()?;
                self.offer(at, &mut screened);
            }
            for (_, at) in screened.held() {
                go_on()?;
                self.sift(at, &mut sifted);
            }
        }
        let least = sifted.least().unwrap_or(0.0);
        for (_, at) in sifted
            .held()
            .take_while(|&(loss, _)| loss < least + FAR_BEHIND)
        {
            go_on()?;
            let at = self.refiner.polish_briefly(at);
            self.enter(at, prior);
        }
        Ok(())
    }

    fn offer<const N: usize>(&mut self, at: Rigid, screened: &mut Best<N>) {
        self.hypotheses += 1;
        self.refiner.screen(at, screened);
    }

    fn sift(&mut self, at: Rigid, sifted: &mut Best<POLISHED>) {
        let (loss, at) = self.refiner.sifted(at);
        if let Some(place) = self.ended.iter_mut().find(|ended| ended.is_none()) {
            *place = Some(at);
        }
        sifted.offer(loss, at);
    }

    /// Where planes do not tell the angle about an axis, points that both clouds share do: copies turned about it in small
    /// steps, and of the same upside down.
    fn spin<E>(
        &mut self,
        polished: Candidate,
        prior: Option<&Prior>,
        go_on: &mut impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let best = self.best().and_then(|i| self.contenders.get(i).copied());
        let at = best.flatten().map_or(polished.at, |best| best.at);
        let (axis, constraint) = self.refiner.least_constraint(at);
        if constraint >= SLIPPERY {
            return Ok(());
        }
        let mut spun = Best::<SPINS_POLISHED>::NONE;
        let upside_down = Turn::new(axis.any_orthonormal_vector(), 0.0);
        let (sine, cosine) = libm::sincosf(core::f32::consts::PI / SPINS as f32);
        let step = Turn::new(axis * sine, cosine);
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
            let at = self.refiner.polish_briefly(at);
            self.enter(at, prior);
        }
        Ok(())
    }
}

/// How improbable a pose is by the loss of the points of both clouds and the mean loss of the source's, and under the start.
fn energy([loss, source]: [f32; 2], surprise: f32) -> f32 {
    let beyond = (source - HARDLY_EXPLAINED).max(0.0) * 2.0 * COMPARED as f32;
    EVIDENCE * (loss + (BEYOND - 1.0) * beyond) + surprise
}

#[cfg(test)]
mod tests;
