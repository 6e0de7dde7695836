//! Whether robots do worse with a new policy: what they tell of their poses, old and new.

use super::statistics::fisher;
use super::{Halt, Heard};
use reagent_core::Verdict;
use reagent_core::wire::{PolicyId, Tally};
use std::collections::BTreeMap;
use std::fmt;

/// A policy is called worse if chance alone would make such a difference less often than this.
const SIGNIFICANCE: f64 = 0.01;
/// A policy is called slower if its mean time is so many times as long.
const SLOWER: f64 = 1.5;

pub(super) fn total(tallies: impl Iterator<Item = Tally>) -> Tally {
    tallies.fold(Tally::default(), |mut sum, tally| {
        for (sum, count) in sum.verdicts.iter_mut().zip(tally.verdicts) {
            *sum = sum.saturating_add(count);
        }
        sum.judged = sum.judged.saturating_add(tally.judged);
        sum.probability_millionths += tally.probability_millionths;
        sum.micros += tally.micros;
        sum.refined = sum.refined.saturating_add(tally.refined);
        sum.reached = sum.reached.saturating_add(tally.reached);
        sum
    })
}

/// What the robots of a fleet have done with both policies.
pub(super) struct Record {
    /// With the new policy, the robots that are new to it.
    pub(super) new: Tally,
    /// With the old policy, the same robots before the roll-out.
    own: Tally,
    /// With the old policy, robots that run it.
    others: Tally,
}

impl Record {
    /// Adds up what robots report, and the tallies of the policy of SHA-256 `old` from `before` the roll-out.
    pub(super) fn of(
        robots: &[Heard],
        is_new: impl Fn(&Heard) -> bool,
        before: &BTreeMap<String, Tally>,
        policy: PolicyId,
        old: [u8; 32],
    ) -> Record {
        let (with, without): (Vec<_>, Vec<_>) = robots
            .iter()
            .partition(|heard| heard.status.policy == Some(policy));
        let new = with.into_iter().filter(|heard| is_new(heard));
        let others = without.into_iter().filter(|heard| heard.runs_file(old));
        let own = new.clone().filter_map(|heard| before.get(&heard.robot));
        Record {
            own: total(own.copied()),
            new: total(new.map(|heard| heard.status.tally)),
            others: total(others.map(|heard| heard.status.tally)),
        }
    }

    /// Compares the robots with their own past if that has enough `poses`, for each may see other things than the
    /// others. If not, it compares them with the others; if these gave too few, too, with both. `earlier` is the record
    /// of when the robots had taken the policy.
    pub(super) fn figures(&self, earlier: &Record, poses: u64) -> Figures {
        let Record { new, own, others } = *self;
        let count = others.poses().saturating_sub(earlier.others.poses());
        let micros = others.micros.saturating_sub(earlier.others.micros);
        let old = match () {
            () if own.poses() >= poses => own,
            () if others.poses() >= poses => others,
            () => total([own, others].into_iter()),
        };
        let meanwhile_ms = (count > 0).then(|| micros as f64 / 1e3 / count as f64);
        Figures {
            old,
            new,
            meanwhile_ms,
        }
    }
}

/// Tallies of the old policy and of the new one.
pub(super) struct Figures {
    old: Tally,
    new: Tally,
    /// Mean time of the poses that robots with the old policy gave in the same time as those with the new one. Times also
    /// depend on what else a machine does.
    meanwhile_ms: Option<f64>,
}

fn converged(tally: &Tally) -> u64 {
    tally.verdicts[Verdict::Converged as usize].into()
}

/// Mean probability of a pose; NaN if none is known.
fn probability(tally: &Tally) -> f64 {
    tally.probability_millionths as f64 / 1e6 / f64::from(tally.judged)
}

fn ms(tally: &Tally) -> f64 {
    tally.micros as f64 / 1e3 / tally.poses() as f64
}

impl Figures {
    /// Whether the roll-out may go on.
    pub(super) fn judged(&self) -> Result<(), Halt> {
        let Figures { old, new, .. } = self;
        // A gate may ask for no poses.
        if old.poses() + new.poses() > 0 && converged(old) + converged(new) == 0 {
            return Err(Halt::NoneConverged(self.to_string()));
        }
        self.worse().map_or(Ok(()), |why| Err(Halt::Worse(why)))
    }

    /// Why the new policy is significantly worse, if it is.
    fn worse(&self) -> Option<String> {
        let Figures { old, new, .. } = self;
        if old.poses() == 0 {
            return None;
        }
        let (poses, right) = (old.poses() + new.poses(), converged(old) + converged(new));
        let p = fisher(converged(new), new.poses(), right, poses);
        if p < SIGNIFICANCE {
            return Some(format!("fewer poses converge (p = {p:.1e}): {self}"));
        }
        // Where refinement finds the pose whatever the policy does, only this tells.
        let [few, others] = [new, old].map(|tally| u64::from(tally.reached));
        let [drawn, rest] = [new, old].map(|tally| u64::from(tally.refined));
        let p = fisher(few, drawn, few + others, drawn + rest);
        if p < SIGNIFICANCE {
            return Some(format!(
                "fewer poses are reached by the policy itself (p = {p:.1e}): {self}"
            ));
        }
        // A probability's variance is at most that of a coin with the same mean.
        let (a, b) = (probability(old), probability(new));
        let (m, n) = (f64::from(old.judged), f64::from(new.judged));
        let pooled = (a * m + b * n) / (m + n);
        let sigma = (pooled * (1.0 - pooled) * (1.0 / m + 1.0 / n)).sqrt();
        if a - b > 2.33 * sigma {
            return Some(format!("poses are less probable: {self}"));
        }
        let is_slower = |than: f64| ms(new) > SLOWER * than;
        if is_slower(ms(old)) && self.meanwhile_ms.is_some_and(is_slower) {
            return Some(format!("poses take longer: {self}"));
        }
        None
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = |tally: &Tally| {
            if tally.poses() == 0 {
                return "no poses".to_owned();
            }
            let share = 100.0 * converged(tally) as f64 / tally.poses() as f64;
            let mut text = format!("{} poses, {share:.1} % converged", tally.poses());
            if tally.refined > 0 {
                let share = 100.0 * f64::from(tally.reached) / f64::from(tally.refined);
                text += &format!(", {share:.1} % of the refined ones reached by the policy itself");
            }
            if tally.judged > 0 {
                text += &format!(", mean probability {:.3}", probability(tally));
            }
            text + &format!(", {:.1} ms", ms(tally))
        };
        write!(
            f,
            "old policy {}; new policy {}",
            part(&self.old),
            part(&self.new)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(converged: u32, others: u32, probability: f64, micros: u64) -> Tally {
        let poses = converged + others;
        let mut tally = Tally {
            judged: poses,
            probability_millionths: (f64::from(poses) * probability * 1e6) as u64,
            micros: u64::from(poses) * micros,
            ..Tally::default()
        };
        tally.verdicts[Verdict::Converged as usize] = converged;
        tally.verdicts[Verdict::StepLimit as usize] = others;
        tally
    }

    #[test]
    fn what_is_worse_beyond_chance_is_told() {
        let old = tally(900, 100, 0.9, 5000);
        let figures = |old, new| Figures {
            old,
            new,
            meanwhile_ms: Some(5.0),
        };
        let worse = |new| figures(old, new).worse().unwrap_or_default();
        assert_eq!(worse(tally(88, 12, 0.89, 5500)), "");
        assert_eq!(worse(tally(95, 5, 0.99, 500)), "");
        assert!(worse(tally(70, 30, 0.9, 5000)).starts_with("fewer poses converge"));
        assert!(worse(tally(90, 10, 0.7, 5000)).starts_with("poses are less probable"));
        assert!(worse(tally(90, 10, 0.9, 8000)).starts_with("poses take longer"));
        // So do those of the old policy in the same time.
        let busy = Figures {
            meanwhile_ms: Some(8.0),
            ..figures(old, tally(90, 10, 0.9, 8000))
        };
        assert_eq!(busy.worse(), None);
        let reached = |tally: Tally, reached: u32| Tally {
            refined: tally.verdicts[Verdict::Converged as usize],
            reached,
            ..tally
        };
        let old = reached(old, 810);
        let worse = |share: u32| {
            let new = reached(tally(90, 10, 0.9, 5000), share);
            figures(old, new).worse().unwrap_or_default()
        };
        assert_eq!(worse(80), "");
        assert!(worse(60).starts_with("fewer poses are reached by the policy itself"));
        assert!(worse(60).contains("66.7 % of the refined ones reached by the policy itself"));
        let none = tally(0, 100, 0.1, 5000);
        let [blind, first_blind] = [none, Tally::default()].map(|old| figures(old, none));
        for blind in [blind, first_blind] {
            let halted = blind.judged().expect_err("nothing is known");
            assert!(
                halted.to_string().starts_with("no pose converged"),
                "{halted}"
            );
        }
        let known = figures(old, none);
        assert!(matches!(known.judged(), Err(Halt::Worse(_))));
        let first = figures(Tally::default(), old);
        assert_eq!(first.worse(), None, "{first}");
    }
}
