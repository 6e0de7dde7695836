//! Methods that are compared: each has a start, which finds a pose, and a finish, which refines it.

use crate::baselines::{FgrSettings, IcpSettings, fgr, icp};
use crate::dataset::Point;
use crate::dataset::pairs::Seen;
use crate::learn::acting::poses_of;
use crate::learn::env::{Accumulation, Problem};
use crate::learn::nn::Parameters;
use crate::random::{Purpose, stream};
use crate::register::Memory;
use glam::Vec3;
use reagent_core::pipeline::{Mode, Progress, Task, refine, register};
use reagent_core::{Decision, Error, Frame, Policy, Pose, Registrar, start};
use std::time::Instant;

/// How to register.
#[derive(Clone, Copy, Debug)]
pub struct Method<'w> {
    /// What finds a pose.
    pub start: Start<'w>,
    /// What refines it.
    pub finish: Finish,
}

/// What finds a pose, starting from the identity.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "a handful exist at a time")]
pub enum Start<'w> {
    /// Nothing: the initial error.
    Identity,
    /// Nothing, and no pose is more probable than another: verification looks everywhere.
    Anywhere,
    /// The learned policy, deciding as its file says.
    Policy(Policy<'w>),
    /// A network that the core cannot run, by [`poses_of`]; times are the trainer's, not a robot's.
    Trained {
        /// The network.
        parameters: &'w Parameters,
        /// How its actions accumulate.
        accumulation: Accumulation,
        /// How actions are chosen from its logits.
        decision: Decision,
    },
    /// Fast global registration. The seed chooses the triangles that it tests, pair by pair.
    Fgr {
        /// Its settings.
        settings: FgrSettings,
        /// Seed of the draws.
        seed: u64,
    },
}

/// What refines a pose.
#[derive(Clone, Copy, Debug)]
pub enum Finish {
    /// Nothing.
    Nothing,
    /// Iterative closest point.
    Icp(IcpSettings),
    /// Core's refinement.
    Core(Mode),
}

impl<'w> Start<'w> {
    /// The method with this start and the given finish.
    pub fn then(self, finish: Finish) -> Method<'w> {
        Method {
            start: self,
            finish,
        }
    }
}

/// The task that core gets for an evaluated pair: clouds as they are, start at the identity.
pub(crate) fn task_of(seen: Option<&Seen>) -> Task<'_> {
    Task {
        frame: Some(Frame::IDENTITY),
        view_point: seen.map(|seen| Vec3::from_array(seen.view_point)),
        background: seen.map_or(&[], |seen| &seen.background),
        ..Task::new(start::Start::at(Pose::IDENTITY))
    }
}

/// A method and the name under which it is reported.
#[derive(Clone, Debug)]
pub struct Contestant<'w> {
    /// File stem of the weights, or the method's name.
    pub name: String,
    /// How it registers.
    pub method: Method<'w>,
}

/// The poses of one registration that are to be measured, each with the milliseconds until it was reached.
pub(crate) struct Trajectory {
    pub(crate) poses: Vec<Pose>,
    pub(crate) ms: Vec<f64>,
    pub(crate) probability: Option<f32>,
    clock: Instant,
}

impl Trajectory {
    /// Starts the clock at the identity.
    fn begin() -> Self {
        Trajectory {
            poses: vec![Pose::IDENTITY],
            ms: vec![0.0],
            probability: None,
            clock: Instant::now(),
        }
    }

    /// The last pose and its time.
    fn last(&self) -> (Pose, f64) {
        (self.poses[self.poses.len() - 1], self.ms[self.ms.len() - 1])
    }

    /// Appends a pose and its time, and returns the pose.
    fn reach(&mut self, pose: Pose) -> Pose {
        self.poses.push(pose);
        self.ms.push(self.clock.elapsed().as_secs_f64() * 1e3);
        pose
    }
}

impl Method<'_> {
    /// Registers pair number `index`, source and target. A policy takes `steps` steps; `per_step` keeps the poses
    /// of all of them. `seen` tells core's refinement from where the source was seen.
    pub(crate) fn register(
        &self,
        [source, target]: [&[Point]; 2],
        seen: Option<&Seen>,
        index: u64,
        (steps, per_step): (usize, bool),
        memory: &mut Memory,
    ) -> Result<Trajectory, Error> {
        let mut track = Trajectory::begin();
        let mode = match self.finish {
            Finish::Core(mode) => mode,
            Finish::Nothing | Finish::Icp(_) => Mode::Fast,
        };
        let given = task_of(seen);
        let task = Task {
            mode,
            steps,
            start: match self.start {
                Start::Anywhere => start::Start::Anywhere,
                _ => given.start,
            },
            ..given
        };
        let mut answer = None;
        let pose = match self.start {
            Start::Identity | Start::Anywhere => Pose::IDENTITY,
            Start::Policy(policy) => {
                let mut registrar = Registrar::new(policy, &mut memory.scratch);
                let workspace = &mut memory.workspace;
                let found = register(
                    &mut registrar,
                    workspace,
                    [source, target],
                    &task,
                    |progress| {
                        if let Progress::Step(_, registration) = progress {
                            track.reach(registration.target_from_source());
                        }
                        Ok::<(), Error>(())
                    },
                )?;
                answer = Some(found);
                // Once it has settled, further steps would change nothing.
                let settled = track.last();
                track.poses.resize(1 + steps, settled.0);
                track.ms.resize(1 + steps, settled.1);
                settled.0
            }
            Start::Trained {
                parameters,
                accumulation,
                decision,
            } => {
                let pair = [Problem::new(
                    source.to_vec(),
                    target.to_vec(),
                    Pose::IDENTITY,
                )];
                let rules = (accumulation, decision);
                let parameters = parameters.clone();
                // The copy is not part of a registration.
                track = Trajectory::begin();
                let poses = poses_of(parameters, rules, &pair, steps);
                let poses = poses.iter().flatten().skip(1);
                poses.fold(Pose::IDENTITY, |_, &pose| track.reach(pose))
            }
            Start::Fgr { settings, seed } => {
                let rng = &mut stream(seed, Purpose::Tuples, index);
                track.reach(fgr(source, target, &settings, rng)?.target_from_source)
            }
        };
        match self.finish {
            Finish::Nothing => {}
            Finish::Icp(settings) => {
                track.reach(icp(source, target, pose, &settings)?.target_from_source);
            }
            Finish::Core(_) => {
                let (workspace, clouds) = (&mut memory.workspace, [source, target]);
                let refinement = match answer {
                    Some(answer) => answer.refinement,
                    None => refine(workspace, clouds, pose, &task, || Ok::<(), Error>(()))?,
                };
                if let Some(found) = refinement {
                    track.reach(found.refined.target_from_source);
                    track.probability = Some(found.evidence.probability());
                }
            }
        }
        if !(per_step && self.takes_steps_alone()) {
            track.poses.drain(..track.poses.len() - 1);
            track.ms.drain(..track.ms.len() - 1);
        }
        Ok(track)
    }

    /// Whether the method is a policy's steps and nothing else.
    fn takes_steps_alone(&self) -> bool {
        matches!(self.start, Start::Policy(_) | Start::Trained { .. })
            && matches!(self.finish, Finish::Nothing)
    }
}
