//! Compares a pose with others that might be right instead, and says what stays undetermined if several are.
//!
//! | stage | hypotheses | what |
//! |---|---|---|
//! | screen | around the pose at hand: shifted, turned, turned as symmetries of the target would; principal axes on principal axes; unless that pose is held on to, also around the start, and rotations anywhere | few coarse steps on few points |
//! | sift | the best of those | more steps on more points |
//! | pairs | unless one of these explains the source or the pose at hand is held on to: pairs of its oriented points on similar pairs of the target's | more steps on more points |
//! | again | the best of those, unless the pose at hand is held on to, turned as symmetries of the target would | both stages |
//! | polish | the best that differ, and the start, which is also compared as it is | [`Refiner::polish`], briefly |
//! | spin | the best, if planes leave a rotation free, turned about that axis and upside down | compared on few points, the best of them polished |
//! | copies | the best, turned as a cube's symmetries would | the same, if they fit about as well |
//! | nudge | the best, turned or shifted a little, if it explains little | sifted, the best of them polished |
//! | slide | the best, shifted along the axes by which planes hold its place, if it does not explain both clouds well | the same |
//! | decide | all polished poses | loss point by point, less where the source lies beyond an edge of the target, and the probability under the start's uncertainty |

use crate::error::Error;
use crate::loss::{COMPARED, CONTENDERS};
use crate::polish::{Candidate, Refined, Refiner};
use crate::pose::Pose;
use crate::search::is_same;
use crate::solve::Rigid;
use crate::start::{Prior, Start};
use core::cell::Cell;

mod beside;
mod fold;
mod search;
mod undetermined;

pub use fold::Fold;
use search::{ENDED, MORE_PROBABLE, SPARE, Search, explains_both};
use undetermined::lead;
pub use undetermined::{Axis, OTHERS, Slide, Undetermined};

/// Log-probability that the loss of one whole point stands for. It is far less than an independent point's, since errors of
/// neighbours are correlated, and sensors, models and masks have faults that no sampling explains.
const EVIDENCE: f32 = 0.014;
/// The same for the loss of all points.
const ALL_LOST: f32 = EVIDENCE * 2.0 * COMPARED as f32;
/// Mean loss of the source above which a pose explains so little of it that a start should not favour the pose; loss above it
/// counts `BEYOND` times. If clouds overlap by a third, only a pose far from the start may explain them. If the background is
/// known, a mask may be mostly that, and no loss counts more.
const HARDLY_EXPLAINED: f32 = 0.7;
const BEYOND: f32 = 5.0;

/// Most poses in the final comparison. The last two places for losses serve other comparisons.
pub const RANKED: usize = CONTENDERS - 2;
/// Places for losses of two poses that are compared with each other alone.
const HERE: usize = CONTENDERS - 1;
const THERE: usize = CONTENDERS - 2;

/// Result of comparing a pose with others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verified {
    /// The best pose.
    pub best: Refined,
    /// The pose at hand, polished without regard to others.
    pub polished: Refined,
    /// Number of other hypotheses tried.
    pub hypotheses: usize,
    /// How many of the sifted hypotheses ended in the best pose.
    pub support: usize,
    /// How much less probable the runner-up is, copies turned about an undetermined axis left out: a difference of
    /// [`Ranked::energy`]; infinite without a runner-up.
    pub lead: f32,
    /// What the shape leaves undetermined.
    pub undetermined: Undetermined,
    /// How much better the source's mirror image fits, over the points that the best pose matches, in standard errors; 0 if it
    /// does not fit better.
    pub mirror_score: f32,
    /// The pose returned, then those it was compared with, the most probable first.
    pub ranked: [Option<Ranked>; RANKED],
}

/// A pose in the comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranked {
    /// Plain rigid transform.
    pub target_from_source: Pose,
    /// Negative log-probability, from how the clouds fit and from the start: comparable between poses of the same clouds,
    /// whatever the start.
    pub energy: f32,
}

/// A polished hypothesis in the comparison.
#[derive(Clone, Copy)]
struct Contender {
    at: Rigid,
    /// Negative log-probability, from the losses and under the start; lower is better.
    energy: f32,
    /// The same from the losses alone.
    fit: f32,
}

impl Refiner<'_> {
    /// Compares a pose with others and returns the most probable, by fit and by the start.
    ///
    /// # Errors
    /// [`Error::BadPose`] for a pose that is not rigid.
    pub fn verify(&mut self, pose: Pose, start: &Start) -> Result<Verified, Error> {
        self.verify_while(pose, start, || Ok(()))
    }

    /// As [`Self::verify`], but asks `go_on` before every hypothesis.
    ///
    /// # Errors
    /// As [`Self::verify`], and whatever `go_on` returns.
    // Its lists are off a board's stack where poses are only polished.
    #[inline(never)]
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
            keeps_pose_at_hand: begun != at_hand && explains_both(polished.residual),
            hypotheses: 0,
            ended: [None; ENDED],
            contenders: [None; RANKED],
        };
        search.enter(polished.at, prior.as_ref());
        if begun != at_hand && prior.is_some() {
            search.enter(begun, prior.as_ref());
            search.polish(begun, prior.as_ref());
        }
        search.screen(polished, begun, prior.as_ref(), &mut go_on)?;
        search.spin(polished, prior.as_ref(), &mut go_on)?;
        search.copies(prior.as_ref(), &mut go_on)?;
        search.nudge(prior.as_ref(), &mut go_on)?;
        search.slide(prior.as_ref(), &mut go_on)?;
        let best = search.best().unwrap_or(0);
        let best = search.far_better(best);
        let hypotheses = search.hypotheses;
        let (refiner, ended, contenders) = (search.refiner, &search.ended, &search.contenders);
        let winner = contenders.get(best).copied().flatten();
        let further = winner
            .filter(|winner| best > 0 || winner.at != polished.at || !polished.is_settled())
            .map(|winner| refiner.polish_unless_less_probable(winner, prior.as_ref()));
        let found = further.unwrap_or(polished);
        let ranked = refiner.ranked(best, &found, contenders);
        let undetermined = refiner.undetermined(best, &found, contenders);
        let support = ended.iter().flatten().filter(|&&at| is_same(at, found.at));
        let support = support.count();
        let lead = lead(best, contenders, &undetermined);
        let others = contenders.iter().flatten().map(|contender| contender.at);
        let mirror_score = refiner.mirror_score(found.at, others);
        let polished = refiner.refined(&polished, pose);
        Ok(Verified {
            best: further.map_or(polished, |found| refiner.refined(&found, pose)),
            polished,
            hypotheses,
            support,
            lead,
            undetermined,
            mirror_score,
            ranked,
        })
    }

    /// Polishes a contender, unless that makes it less probable: where little holds a pose, it slides away.
    #[inline(never)]
    fn polish_unless_less_probable(
        &mut self,
        winner: Contender,
        prior: Option<&Prior>,
    ) -> Candidate {
        let polished = self.polish_inside(winner.at);
        let energy = self.keep_energy(SPARE, polished.at, prior);
        if energy < winner.energy + MORE_PROBABLE {
            polished
        } else {
            self.candidate(winner.at, polished.iterations)
        }
    }

    /// Negative log-probability of a pose ([`Ranked::energy`]).
    ///
    /// # Errors
    /// [`Error::BadPose`] for a pose or a start that is not rigid.
    pub fn energy(&mut self, pose: Pose, start: &Start) -> Result<f32, Error> {
        let at = self.inside(pose.checked()?);
        let prior = self.prior(start)?;
        Ok(self.keep_energy(0, at, prior.as_ref()))
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

    /// The contenders as poses: the best, in its final form, then the others, the most probable first.
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
        if best < ranked.len() {
            ranked.swap(0, best);
        }
        if let Some(others) = ranked.get_mut(1..) {
            // A bubble sort, as there are few: those of equal energy keep their order.
            let others = Cell::from_mut(others).as_slice_of_cells();
            for [a, b] in others.iter().flat_map(|_| others.array_windows()) {
                if energy(&a.get()).total_cmp(&energy(&b.get())).is_gt() {
                    a.swap(b);
                }
            }
        }
        ranked
    }

    /// Keeps the losses under a pose, point by point, and returns its negative log-probability.
    fn keep_energy(&mut self, contender: usize, at: Rigid, prior: Option<&Prior>) -> f32 {
        let losses = self.keep_losses(contender, at);
        let surprise = prior.map_or(0.0, |prior| prior.surprise(at));
        energy(losses, surprise, self.knows_background())
    }

    /// Keeps the losses under a pose, point by point; returns their sum and the source's mean loss.
    fn keep_losses(&mut self, contender: usize, at: Rigid) -> [f32; 2] {
        self.match_both(at, COMPARED);
        self.keep_matched_losses(contender, at)
    }
}

/// Negative log-probability, from both clouds' summed loss, the source's mean loss, the surprise under the start, and whether the
/// background is known.
fn energy([loss, source]: [f32; 2], surprise: f32, knows_background: bool) -> f32 {
    let beyond = if knows_background {
        0.0
    } else {
        (source - HARDLY_EXPLAINED).max(0.0) * 2.0 * COMPARED as f32
    };
    EVIDENCE * (loss + (BEYOND - 1.0) * beyond) + surprise
}

#[cfg(test)]
pub(crate) mod tests;
