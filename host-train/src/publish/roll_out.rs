//! Staged roll-outs: a policy goes to a part of the fleet first, and to the rest if that part does no worse with it.

use super::judgement::{Record, total};
use super::stages::reach;
use super::{Heard, PublishError, Publisher, Reception, Stages};
use crate::policy::WeightFile;
use crate::words::count;
use reagent_core::wire::{Manifest, PolicyId, Tally, WhyNot};
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
    /// SHA-256 of the old policy's file.
    pub old: [u8; 32],
    /// Whether a roll-out goes on though robots do worse.
    pub anyway: bool,
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
        /// Robots of the stage that are no longer there.
        gone: Vec<String>,
    },
    /// A robot runs another policy of this version, or a newer one, and takes this one no longer.
    Overtaken {
        /// The robot.
        robot: String,
        /// What it runs.
        policy: PolicyId,
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
            Halt::Unknown {
                poses,
                wanted,
                gone,
            } => {
                write!(
                    f,
                    "{poses} poses with the new policy where {wanted} are needed to judge it"
                )?;
                match gone.is_empty() {
                    true => Ok(()),
                    false => write!(f, "; no longer there: {}", gone.join(", ")),
                }
            }
            Halt::Overtaken { robot, policy } => write!(
                f,
                "somebody else publishes to this fleet: {robot} runs version {} (SHA-256 {})",
                policy.release(),
                const_hex::encode(policy.sha256)
            ),
            Halt::NoneConverged(figures) => write!(
                f,
                "no pose converged, which tells nothing of the new policy; ask for verified or polished poses of what the robots see: {figures}"
            ),
            Halt::Worse(why) => f.write_str(why),
        }
    }
}

impl Publisher {
    /// Checks, before a roll-out, that robots are there and that one of them runs the old policy. Robots without a
    /// policy, and those that have the new one from a roll-out that halted, do not count.
    ///
    /// # Errors
    /// `Nobody`, `NotTheirs`; `Zenoh`.
    pub async fn check_old(&self, manifest: &Manifest, old: [u8; 32]) -> Result<(), PublishError> {
        let there = self.follow().await?.heard();
        if there.is_empty() {
            let fleet = self.fleet.clone();
            return Err(PublishError::Nobody { fleet });
        }
        let others = there.into_iter().filter_map(|heard| {
            let runs = heard.status.policy?;
            (runs != manifest.id()).then_some((heard.robot, runs))
        });
        let mut others = others.peekable();
        let Some((robot, runs)) = others.peek().cloned() else {
            return Ok(());
        };
        match others.any(|(_, runs)| runs.sha256 == old) {
            true => Ok(()),
            false => Err(PublishError::NotTheirs { old, robot, runs }),
        }
    }

    /// Serves a policy and announces it to one part of the fleet after the other. `told` gets a line for each stage. If
    /// a stage halts, the robots that it has not reached keep what they have. Returns the manifest that was announced last:
    /// it need not reach all robots.
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
    ) -> Result<Result<Manifest, Halt>, PublishError> {
        self.serve(manifest, file.clone()).await?;
        let before = past(self.follow().await?.heard(), gate.old);
        for robot in gate
            .except
            .iter()
            .filter(|&robot| !before.contains_key(robot))
        {
            told(format!("no robot {robot} is there, which --except names"));
        }
        let names = before.keys().filter(|name| !gate.except.contains(name));
        let names: Vec<&String> = names.collect();
        let (mut manifest, mut reached) = (manifest.clone(), None);
        for &stage in &stages.0 {
            let reach = reach(&manifest, stage, &names);
            let last = reached;
            if last.is_some_and(|last| reach <= last) {
                continue;
            }
            reached = Some(reach);
            manifest.reach = reach;
            self.announce(&manifest).await?;
            let reception = self.reception(&manifest, gate.wait).await?;
            // The others were judged before.
            let is_new = |robot: &String| {
                let draw = manifest.draw(robot);
                draw <= reach && last.is_none_or(|last| draw > last)
            };
            // Also of robots that have not been heard: what is not heard of does not go unjudged.
            let own = before.iter().filter(|&(robot, _)| is_new(robot));
            let own = own.filter(|&(robot, _)| !gate.except.contains(robot));
            let own = total(own.map(|(_, tally)| *tally)).poses();
            // The last stage leaves no others to compare its robots with.
            let is_judged = reach != u32::MAX || own >= gate.poses;
            let robots = count(reception.taken.len(), "robot", "robots");
            let absent = reception.absent(&manifest);
            told(match is_judged {
                true => format!("stage of {robots}: taken{absent}"),
                false => format!(
                    "stage of {robots}: taken{absent}; not judged: the old policy gave {own} poses there where {} are \
                     needed",
                    gate.poses
                ),
            });
            let mut failed = reception.failed();
            if failed.any(|(robot, _)| !gate.except.contains(robot)) {
                drop(failed);
                let overtaken = overtaken(&self.robots().await?, &manifest);
                return Ok(Err(overtaken.unwrap_or(Halt::NotTaken(reception))));
            }
            if is_judged
                && let Err(halt) = self
                    .judge(&manifest, is_new, &before, gate, &mut told)
                    .await?
            {
                return Ok(Err(halt));
            }
        }
        Ok(Ok(manifest))
    }

    /// Waits until the robots that are new to the policy have given enough poses, and judges these.
    async fn judge(
        &self,
        manifest: &Manifest,
        is_new: impl Fn(&String) -> bool,
        before: &BTreeMap<String, Tally>,
        gate: &Gate,
        told: &mut impl FnMut(String),
    ) -> Result<Result<(), Halt>, PublishError> {
        let deadline = Instant::now() + gate.wait;
        let mut fleet = self.follow().await?;
        let record = |robots: &[Heard]| {
            let new = |heard: &Heard| is_new(&heard.robot);
            Record::of(robots, new, before, manifest.id(), gate.old)
        };
        // Some had the policy before the last of them took it.
        let earlier = record(&fleet.heard());
        loop {
            let robots = fleet.heard();
            if let Some(halt) = overtaken(&robots, manifest) {
                return Ok(Err(halt));
            }
            let record = record(&robots);
            let given = record.new.poses().saturating_sub(earlier.new.poses());
            if given >= gate.poses {
                let figures = record.figures(&earlier, gate.poses);
                told(figures.to_string());
                return Ok(match figures.judged() {
                    Err(Halt::Worse(why)) if gate.anyway => {
                        told(format!("it goes on all the same: {why}"));
                        Ok(())
                    }
                    judged => judged,
                });
            }
            let Ok(changed) = tokio::time::timeout_at(deadline, fleet.changed()).await else {
                let there = self.robots().await?;
                let is_gone = |name: &&String| !there.iter().any(|heard| heard.robot == **name);
                let stage = before.keys().filter(|&name| is_new(name));
                return Ok(Err(Halt::Unknown {
                    poses: given,
                    wanted: gate.poses,
                    gone: stage.filter(is_gone).cloned().collect(),
                }));
            };
            changed?;
        }
    }
}

/// What the old policy has done on each robot so far: nothing where another one runs.
fn past(robots: Vec<Heard>, old: [u8; 32]) -> BTreeMap<String, Tally> {
    let tally = |heard: Heard| match heard.runs_file(old) {
        true => (heard.robot, heard.status.tally),
        false => (heard.robot, Tally::default()),
    };
    robots.into_iter().map(tally).collect()
}

/// The halt that a robot calls for which runs another policy of this version, or a newer one.
fn overtaken(robots: &[Heard], manifest: &Manifest) -> Option<Halt> {
    robots.iter().find_map(|Heard { robot, status }| {
        let policy = status.policy?;
        let is_other = policy != manifest.id() && policy.release() >= manifest.release();
        is_other.then(|| Halt::Overtaken {
            robot: robot.clone(),
            policy,
        })
    })
}

impl Reception {
    /// What a stage's line says of its robots that have left or say nothing.
    fn absent(&self, stage: &Manifest) -> String {
        let said = |what: &str, robots: Vec<&String>| {
            let robots = robots.into_iter().filter(|robot| stage.reaches(robot));
            let robots: Vec<&str> = robots.map(String::as_str).collect();
            match robots.is_empty() {
                true => String::new(),
                false => format!("; {what}: {}", robots.join(", ")),
            }
        };
        let silent = self.silent.iter().map(|(robot, _)| robot);
        said("no longer there", self.left.iter().collect()) + &said("silent", silent.collect())
    }

    /// Robots that should have taken the policy and could not.
    fn failed(&self) -> impl Iterator<Item = &(String, WhyNot)> {
        self.refused
            .iter()
            .filter(|(_, why)| *why != WhyNot::NotYet)
    }
}
