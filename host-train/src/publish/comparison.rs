//! Tests whether a policy is worse than the one before it, on the same pairs.

use super::statistics::coin;
use crate::dataset::pairs::PairSet;
use crate::measure::eval::{EvalError, EvalSettings, evaluate};
use crate::measure::method::{Contestant, Finish, Start};
use crate::measure::metrics::is_right;
use crate::policy::WeightFile;
use crate::words::count;
use reagent_core::dims::STEPS;
use std::fmt;

/// A policy is called worse if chance alone would make such a difference less often than this.
const SIGNIFICANCE: f64 = 0.05;
/// Two criteria are tested: each gets half of that level (Bonferroni).
const LEVEL: f64 = SIGNIFICANCE / 2.0;
/// Ratio of the error limits of a right pose to those of a precise one.
const PRECISE: f64 = 5.0;

/// The old and the new policy on the same pairs, ten steps each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Pairs.
    pub pairs: usize,
    /// Right poses, as recall counts them: below 5 degrees and .05 units.
    pub right: Paired,
    /// Precise poses: below 1 degree and .01 units.
    pub precise: Paired,
}

/// Numbers of pairs on which the policies met a criterion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Paired {
    /// Pairs on which the old policy met it.
    pub old: usize,
    /// Pairs on which the new policy met it.
    pub new: usize,
    /// Pairs on which only the old policy met it.
    pub lost: usize,
    /// Pairs on which only the new policy met it.
    pub won: usize,
}

impl Comparison {
    /// Registers every pair with both policies.
    ///
    /// # Errors
    /// As [`evaluate`].
    pub fn of(old: &WeightFile, new: &WeightFile, set: &PairSet) -> Result<Self, EvalError> {
        let settings = EvalSettings {
            steps: STEPS,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            per_step: false,
        };
        let contestants = [("old", old), ("new", new)].map(|(name, file)| Contestant {
            name: name.into(),
            method: Start::Policy(file.policy()).then(Finish::Nothing),
        });
        let outcomes = evaluate(set, &contestants, &settings, &|| {})?;
        let reached = |closer: f64| {
            let of = |errors: &crate::measure::metrics::Errors| -> Vec<bool> {
                let both = errors.r_iso_deg.iter().zip(&errors.t_iso);
                both.map(|(r, t)| is_right(r * closer, t * closer))
                    .collect()
            };
            let [old, new] = [&outcomes[0].errors, &outcomes[1].errors].map(of);
            Paired::of(&old, &new)
        };
        Ok(Comparison {
            pairs: set.source.len(),
            right: reached(1.0),
            precise: reached(PRECISE),
        })
    }

    /// Whether the new policy has significantly fewer right or precise poses.
    pub fn is_worse(&self) -> bool {
        self.right.p_no_worse() < LEVEL || self.precise.p_no_worse() < LEVEL
    }

    /// Whether the pairs can tell if the new policy is worse: it can only lose what the old one got right. Where the new
    /// one gets enough pairs right, the old one would have lost by them.
    pub fn can_tell(&self) -> bool {
        self.right.old.max(self.right.new) >= Comparison::fewest_pairs()
    }

    /// Number of pairs that a new policy must lose to be called worse, if it wins none.
    pub fn fewest_pairs() -> usize {
        let is_enough = |pairs: &u64| coin(*pairs, *pairs) < LEVEL;
        (1..)
            .find(is_enough)
            .map_or(usize::MAX, |pairs| pairs as usize)
    }
}

impl Paired {
    fn of(old: &[bool], new: &[bool]) -> Paired {
        let count = |which: fn(bool, bool) -> bool| {
            let both = old.iter().zip(new);
            both.filter(|&(&old, &new)| which(old, new)).count()
        };
        Paired {
            old: count(|old, _| old),
            new: count(|_, new| new),
            lost: count(|old, new| old && !new),
            won: count(|old, new| new && !old),
        }
    }

    /// Probability of so many losses among the pairs that differ if the new policy is as good: McNemar's exact test,
    /// one-sided (<https://doi.org/10.1007/BF02295996>).
    pub fn p_no_worse(&self) -> f64 {
        coin(self.lost as u64, (self.lost + self.won) as u64)
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |count: usize| 100.0 * count as f64 / self.pairs.max(1) as f64;
        write!(f, "{}", count(self.pairs, "pair", "pairs"))?;
        for (what, paired) in [("right", self.right), ("precise", self.precise)] {
            write!(
                f,
                "; {what} {:.1} % -> {:.1} % ({} lost, {} won, p = {:.3})",
                percent(paired.old),
                percent(paired.new),
                paired.lost,
                paired.won,
                paired.p_no_worse()
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::learn::nn::{Parameters, Shape};
    use crate::protocol::{self, Protocol};

    #[test]
    fn an_untrained_policy_is_worse_than_the_bundled_one_and_that_is_as_good_as_itself() {
        let models = procedural::models(3, 20);
        let set = protocol::draw(&models, Protocol::M40Models, 20, 3);
        let bundled = WeightFile::pretrained();
        let untrained = WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 1));
        let untrained = untrained.expect("deployable");
        let worse = Comparison::of(&bundled, &untrained, &set).expect("good pairs");
        assert!(worse.is_worse(), "{worse}");
        assert!(worse.to_string().starts_with("20 pairs; right "), "{worse}");
        let better = Comparison::of(&untrained, &bundled, &set).expect("good pairs");
        assert!(!better.is_worse(), "{better}");
        let same = Comparison::of(&bundled, &bundled, &set).expect("good pairs");
        assert!(!same.is_worse() && same.right.lost == 0, "{same}");
    }

    #[test]
    fn six_right_poses_can_tell_and_five_cannot() {
        assert_eq!(Comparison::fewest_pairs(), 6);
        let all_lost = |pairs: usize| Comparison {
            pairs,
            right: Paired {
                old: pairs,
                lost: pairs,
                ..Paired::default()
            },
            precise: Paired::default(),
        };
        assert!(all_lost(6).is_worse() && !all_lost(5).is_worse());
        assert!(all_lost(6).can_tell() && !all_lost(5).can_tell());
        // Pairs on which neither policy is right tell nothing, however many there are.
        let right = |old, new| Comparison {
            pairs: 100,
            right: Paired {
                old,
                new,
                ..Paired::default()
            },
            precise: Paired::default(),
        };
        assert!(!right(5, 5).can_tell() && right(0, 6).can_tell());
    }
}
