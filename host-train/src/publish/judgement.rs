//! Whether robots do worse with a new policy: what they tell of their poses, old and new.

use super::Halt;
use super::statistics::fisher;
use reagent_core::Verdict;
use reagent_core::wire::Tally;
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
        sum
    })
}

/// Tallies of the robots with the old policy and with the new one.
pub(super) struct Figures {
    pub(super) old: Tally,
    pub(super) new: Tally,
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
        let Figures { old, new } = self;
        // A gate may ask for no poses.
        if old.poses() + new.poses() > 0 && converged(old) + converged(new) == 0 {
            return Err(Halt::NoneConverged(self.to_string()));
        }
        self.worse().map_or(Ok(()), |why| Err(Halt::Worse(why)))
    }

    /// Why the new policy is significantly worse, if it is.
    fn worse(&self) -> Option<String> {
        let Figures { old, new } = self;
        if old.poses() == 0 {
            return None;
        }
        let (poses, right) = (old.poses() + new.poses(), converged(old) + converged(new));
        let p = fisher(converged(new), new.poses(), right, poses);
        if p < SIGNIFICANCE {
            return Some(format!("fewer poses converge (p = {p:.1e}): {self}"));
        }
        // A probability's variance is at most that of a coin with the same mean.
        let (a, b) = (probability(old), probability(new));
        let (m, n) = (f64::from(old.judged), f64::from(new.judged));
        let pooled = (a * m + b * n) / (m + n);
        let sigma = (pooled * (1.0 - pooled) * (1.0 / m + 1.0 / n)).sqrt();
        if a - b > 2.33 * sigma {
            return Some(format!("poses are less probable: {self}"));
        }
        if ms(new) > SLOWER * ms(old) {
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
        let worse = |new| Figures { old, new }.worse().unwrap_or_default();
        assert_eq!(worse(tally(88, 12, 0.89, 5500)), "");
        assert_eq!(worse(tally(95, 5, 0.99, 500)), "");
        assert!(worse(tally(70, 30, 0.9, 5000)).starts_with("fewer poses converge"));
        assert!(worse(tally(90, 10, 0.7, 5000)).starts_with("poses are less probable"));
        assert!(worse(tally(90, 10, 0.9, 8000)).starts_with("poses take longer"));
        let none = tally(0, 100, 0.1, 5000);
        let [blind, first_blind] = [none, Tally::default()].map(|old| Figures { old, new: none });
        for blind in [blind, first_blind] {
            let halted = blind.judged().expect_err("nothing is known");
            assert!(
                halted.to_string().starts_with("no pose converged"),
                "{halted}"
            );
        }
        let known = Figures { old, new: none };
        assert!(matches!(known.judged(), Err(Halt::Worse(_))));
        let nobody = Tally::default();
        let first = Figures {
            old: nobody,
            new: old,
        };
        assert_eq!(first.worse(), None, "{first}");
    }
}
