//! Staged roll-outs: a policy goes to a part of the fleet first, and to the rest if that part does no worse with it.

use super::statistics::fisher;
use super::{Heard, PublishError, Publisher, Reception};
use crate::policy::WeightFile;
use crate::words::count;
use reagent_core::Verdict;
use reagent_core::wire::{Manifest, Tally, WhyNot};
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;
use tokio::time::Instant;

/// A policy is called worse if chance alone would make such a difference less often than this.
const SIGNIFICANCE: f64 = 0.01;
/// A policy is called slower if its mean time is so many times as long.
const SLOWER: f64 = 1.5;

/// Parts of a fleet, each larger than the one before it as far as that can be told without the fleet's size.
#[derive(Clone, Debug, PartialEq)]
pub struct Stages(Vec<Stage>);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Robots(usize),
    Percent(f64),
}

impl FromStr for Stages {
    type Err = String;

    /// Parses numbers of robots and percentages, separated by commas.
    fn from_str(text: &str) -> Result<Stages, String> {
        let stage = |part: &str| {
            let stage = match part.strip_suffix('%') {
                Some(percent) => percent.parse().ok().map(Stage::Percent),
                None => part.parse().ok().map(Stage::Robots),
            };
            match stage {
                Some(Stage::Percent(percent)) if !(percent > 0.0 && percent <= 100.0) => None,
                Some(Stage::Robots(0)) => None,
                stage => stage,
            }
        };
        let wrong = |part: &str| {
            format!("{part:?}: give numbers of robots and percentages, such as 1,10%,100%")
        };
        let parts = text
            .split(',')
            .map(|part| stage(part.trim()).ok_or_else(|| wrong(part)));
        let stages: Vec<Stage> = parts.collect::<Result<_, _>>()?;
        match stages.is_sorted_by(|before, next| before.may_precede(*next)) {
            true => Ok(Stages(stages)),
            false => Err(format!(
                "{text:?}: each stage must be larger than the one before it"
            )),
        }
    }
}

impl Stage {
    /// Whether the next stage may be larger; for a number and a percentage that depends on the fleet.
    fn may_precede(self, next: Stage) -> bool {
        match (self, next) {
            (Stage::Robots(a), Stage::Robots(b)) => a < b,
            (Stage::Percent(a), Stage::Percent(b)) => a < b,
            (Stage::Percent(percent), Stage::Robots(_)) => percent < 100.0,
            (Stage::Robots(_), Stage::Percent(_)) => true,
        }
    }

    /// Number of robots in a fleet of this size.
    fn robots(self, fleet: usize) -> usize {
        match self {
            Stage::Robots(robots) => robots.min(fleet),
            Stage::Percent(percent) => (fleet as f64 * percent / 100.0).ceil() as usize,
        }
    }
}

/// What the robots of a stage must have done before the next stage.
#[derive(Clone, Debug)]
pub struct Gate {
    /// Poses that they must give together, once all of them have the policy.
    pub poses: u64,
    /// How long that may take.
    pub wait: Duration,
    /// Robots that need not take the policy, such as one whose flash is broken.
    pub except: Vec<String>,
}

/// Why a roll-out stops.
#[derive(Clone, Debug, PartialEq)]
pub enum Halt {
    /// Robots could not take the policy.
    NotTaken(Reception),
    /// The robots that have it gave too few poses to judge it.
    Unknown {
        /// Poses given since all of them have had it.
        poses: u64,
        /// Poses wanted.
        wanted: u64,
    },
    /// No pose converged, with either policy, which tells nothing of the new one.
    NoneConverged(String),
    /// The robots that have it do worse.
    Worse(String),
}

impl fmt::Display for Halt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Halt::NotTaken(reception) => {
                let robots: Vec<&str> = reception.failed().map(|(robot, _)| &**robot).collect();
                let (robots, reception) = (robots.join(","), reception.one_line());
                write!(
                    f,
                    "{reception}; if that is the robot's fault alone, go on without it: --except {robots}"
                )
            }
            Halt::Unknown { poses, wanted } => {
                write!(
                    f,
                    "{poses} poses with the new policy where {wanted} are needed to judge it"
                )
            }
            Halt::NoneConverged(figures) => write!(
                f,
                "no pose converged, which tells nothing of the new policy; ask for verified or polished poses of what the robots see: {figures}"
            ),
            Halt::Worse(why) => f.write_str(why),
        }
    }
}

impl Publisher {
    /// Serves a policy and announces it to one part of the fleet after the other. `told` gets a line for each stage. If
    /// a stage halts, the robots that it has not reached keep what they have.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub async fn roll_out(
        &mut self,
        manifest: &Manifest,
        file: &WeightFile,
        stages: &Stages,
        gate: &Gate,
        mut told: impl FnMut(String),
    ) -> Result<Result<(), Halt>, PublishError> {
        self.serve(manifest, file.clone()).await?;
        let before = tallies(self.robots().await?, |_| true);
        for &stage in &stages.0 {
            let manifest = Manifest {
                reach: reach(manifest, stage, before.keys()),
                ..manifest.clone()
            };
            self.announce(&manifest).await?;
            let reception = self.reception(&manifest, gate.wait).await?;
            let taken = reception.taken.len();
            let robots = count(taken, "robot", "robots");
            told(format!("stage of {robots}: taken"));
            let mut failed = reception.failed();
            if failed.any(|(robot, _)| !gate.except.contains(robot)) {
                drop(failed);
                return Ok(Err(Halt::NotTaken(reception)));
            }
            if taken == 0 && before.is_empty() || manifest.reach == u32::MAX {
                continue;
            }
            if let Err(halt) = self.judge(&manifest, &before, gate, &mut told).await? {
                return Ok(Err(halt));
            }
        }
        Ok(Ok(()))
    }

    /// Waits until the robots with the policy have given enough poses, and compares them with those of the other
    /// robots. If the others gave too few, all robots' poses from before the roll-out are added to these.
    async fn judge(
        &self,
        manifest: &Manifest,
        before: &BTreeMap<String, Tally>,
        gate: &Gate,
        told: &mut impl FnMut(String),
    ) -> Result<Result<(), Halt>, PublishError> {
        let deadline = Instant::now() + gate.wait;
        let changes = self.follow_robots().await?;
        let mut robots: BTreeMap<String, Heard> = BTreeMap::new();
        for heard in self.robots().await? {
            robots.insert(heard.robot.clone(), heard);
        }
        let sum = |robots: &BTreeMap<String, Heard>, new: bool| {
            let id = Some(manifest.id());
            let heard = robots
                .values()
                .filter(|heard| (heard.status.policy == id) == new);
            total(heard.map(|heard| heard.status.tally))
        };
        // Poses from earlier stages say nothing of the robots that got it since.
        let earlier = sum(&robots, true).poses();
        loop {
            let (new, mut old) = (sum(&robots, true), sum(&robots, false));
            let given = new.poses().saturating_sub(earlier);
            if given >= gate.poses {
                if old.poses() < gate.poses {
                    old = total([old].into_iter().chain(before.values().copied()));
                }
                let figures = Figures { old, new };
                told(figures.to_string());
                return Ok(figures.judged());
            }
            match tokio::time::timeout_at(deadline, changes.recv_async()).await {
                Ok(sample) => {
                    let heard = Heard::read(&sample?);
                    robots.extend(heard.map(|heard| (heard.robot.clone(), heard)));
                }
                Err(_) => {
                    let (poses, wanted) = (given, gate.poses);
                    return Ok(Err(Halt::Unknown { poses, wanted }));
                }
            }
        }
    }
}

/// The largest draw that a stage of the fleet reaches.
fn reach<'r>(manifest: &Manifest, stage: Stage, robots: impl Iterator<Item = &'r String>) -> u32 {
    let mut draws: Vec<_> = robots.map(|robot| manifest.draw(robot)).collect();
    draws.sort_unstable();
    let wanted = stage.robots(draws.len());
    match draws.get(wanted.saturating_sub(1)) {
        Some(&last) if wanted < draws.len() => last,
        _ => u32::MAX,
    }
}

fn tallies(robots: Vec<Heard>, which: impl Fn(&Heard) -> bool) -> BTreeMap<String, Tally> {
    let robots = robots.into_iter().filter(|heard| which(heard));
    robots
        .map(|heard| (heard.robot, heard.status.tally))
        .collect()
}

fn total(tallies: impl Iterator<Item = Tally>) -> Tally {
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
struct Figures {
    old: Tally,
    new: Tally,
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
    fn judged(&self) -> Result<(), Halt> {
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

impl Reception {
    /// Robots that should have taken the policy and could not.
    fn failed(&self) -> impl Iterator<Item = &(String, WhyNot)> {
        self.refused
            .iter()
            .filter(|(_, why)| *why != WhyNot::NotYet)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_numbers_and_percentages() {
        let stages: Stages = "1, 10%,100%".parse().expect("stages");
        let counts: Vec<_> = stages.0.iter().map(|stage| stage.robots(25)).collect();
        assert_eq!(counts, [1, 3, 25]);
        for wrong in [
            "", "0", "1,,2", "101%", "-1", "nan%", "0%", "x", "1,1", "2,1", "10%,5%", "100%,1",
        ] {
            assert!(wrong.parse::<Stages>().is_err(), "{wrong}");
        }
    }

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
