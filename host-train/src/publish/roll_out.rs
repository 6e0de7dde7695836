//! Staged roll-outs: a policy goes to a part of the fleet first, and to the rest if that part does no worse with it.

use super::judgement::{Figures, total};
use super::stages::reach;
use super::{Heard, PublishError, Publisher, Reception, Stages};
use crate::policy::WeightFile;
use crate::words::count;
use reagent_core::wire::{Manifest, Tally, WhyNot};
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;
use tokio::time::Instant;

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

fn tallies(robots: Vec<Heard>, which: impl Fn(&Heard) -> bool) -> BTreeMap<String, Tally> {
    let robots = robots.into_iter().filter(|heard| which(heard));
    robots
        .map(|heard| (heard.robot, heard.status.tally))
        .collect()
}

impl Reception {
    /// Robots that should have taken the policy and could not.
    fn failed(&self) -> impl Iterator<Item = &(String, WhyNot)> {
        self.refused
            .iter()
            .filter(|(_, why)| *why != WhyNot::NotYet)
    }
}
