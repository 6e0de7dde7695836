//! The agent in its environment: the trajectories that fill a replay buffer.

use super::method::{Follow, Method, RollOut};
use crate::learn::acting::Agent;
use crate::learn::buffer::{Buffer, Observation};
use crate::learn::env::{Accumulation, Problem};
use crate::learn::loss::log_sum_exp;
use crate::learn::reward::{chamfer_seen, reward};
use crate::random::Rng;
use rand::RngExt;
use rayon::prelude::*;
use reagent_core::dims::STEP_SIZES;
use reagent_core::{Decision, Pose};

/// A filled buffer without rewards, and where each trajectory ended.
pub(super) struct Gathered {
    pub(super) buffer: Buffer,
    /// Poses after the last step, one a trajectory.
    ends: Vec<Pose>,
    /// Value estimates of those poses, where the method bootstraps from them.
    end_values: Vec<f32>,
}

/// Rolls out N trajectories of n steps from each problem.
pub(super) fn gather(
    agent: &mut Agent,
    mut problems: Vec<Problem>,
    roll_out: &RollOut,
    method: &Method,
    rng: &mut Rng,
) -> Gathered {
    let Method {
        accumulation, ppo, ..
    } = *method;
    agent.embed_targets(&problems);
    let mut runs: Vec<usize> = (0..roll_out.trajectories)
        .flat_map(|_| 0..problems.len())
        .collect();
    let mut poses = vec![Pose::IDENTITY; runs.len()];
    let mut observations = Vec::with_capacity(runs.len() * roll_out.steps);
    for step in 0..roll_out.steps {
        agent.refocus(&mut problems, accumulation, (&mut runs, &poses), step);
        agent.act(&problems, accumulation, &runs, &poses);
        if ppo.on() {
            agent.activations.estimate(&agent.parameters);
        }
        for (row, (&problem, pose)) in runs.iter().zip(&mut poses).enumerate() {
            let remaining = accumulation.remaining(pose, &problems[problem]);
            let expert = method.expert.action(&remaining);
            let action = match method.follow {
                Follow::Stochastic => agent.choose(row, |logits| draw(logits, rng)),
                Follow::Expert => expert,
                Follow::Argmax => agent.decide(row, Decision::MostLikely),
                Follow::Mean => agent.decide(row, Decision::NearestToMean),
            };
            observations.push(Observation {
                problem,
                pose: *pose,
                expert,
                action,
                log_probability: agent.log_probability(row, &action),
                value: if ppo.on() {
                    agent.activations.values[row]
                } else {
                    0.0
                },
                reward: 0.0,
                discounted_return: 0.0,
                advantage: 0.0,
            });
            *pose = accumulation.step(pose, action);
        }
    }
    let mut end_values = Vec::new();
    if ppo.on() && ppo.bootstrap {
        agent.act(&problems, accumulation, &runs, &poses);
        agent.activations.estimate(&agent.parameters);
        end_values.clone_from(&agent.activations.values);
    }
    Gathered {
        buffer: Buffer {
            problems,
            trajectories: runs.len(),
            observations,
        },
        ends: poses,
        end_values,
    }
}

impl Gathered {
    /// Rewards every step by the Chamfer distance between the source and where it belongs, then computes returns
    /// and advantages.
    pub(super) fn reward(mut self, method: &Method) -> Buffer {
        let Buffer {
            problems,
            trajectories,
            observations,
        } = &mut self.buffer;
        let truths: Vec<_> = problems.par_iter().map(Problem::truth).collect();
        let count = *trajectories;
        let rewards: Vec<Vec<f32>> = (0..count)
            .into_par_iter()
            .map(|run| {
                let states = observations[run..].iter().step_by(count);
                let problem = observations[run].problem;
                let mut poses: Vec<Pose> = states.map(|o| o.pose).collect();
                poses.push(self.ends[run]);
                rewards(
                    &problems[problem],
                    &truths[problem],
                    method.accumulation,
                    &poses,
                )
            })
            .collect();
        for (i, o) in observations.iter_mut().enumerate() {
            o.reward = rewards[i % count][i / count];
        }
        self.buffer.compute_returns(&method.ppo, &self.end_values);
        self.buffer
    }
}

/// Rewards of the steps between consecutive poses. An unchanged pose keeps its distance, bit for bit.
fn rewards(
    problem: &Problem,
    truth: &[crate::dataset::Point],
    accumulation: Accumulation,
    poses: &[Pose],
) -> Vec<f32> {
    let rewarded = problem.rewarded();
    let distance = |pose: &Pose| {
        let view = accumulation.view(problem.centroid, pose);
        chamfer_seen(&rewarded, &view, truth)
    };
    let mut before = distance(&poses[0]);
    poses
        .windows(2)
        .map(|step| {
            let after = if step[0] == step[1] {
                before
            } else {
                distance(&step[1])
            };
            reward(std::mem::replace(&mut before, after), after)
        })
        .collect()
}

/// Draws a step from the categorical distribution of one axis.
fn draw(logits: [f32; STEP_SIZES], rng: &mut Rng) -> usize {
    let (log_sum, _) = log_sum_exp(logits);
    let mut left: f32 = rng.random();
    for (i, logit) in logits.into_iter().enumerate() {
        left -= (logit - log_sum).exp();
        if left < 0.0 {
            return i;
        }
    }
    STEP_SIZES - 1
}
