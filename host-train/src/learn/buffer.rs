//! The replay buffer: observations of roll-outs with their returns and advantages. They hold poses of problems
//! rather than copies of clouds.

use crate::learn::env::Problem;
use crate::learn::ppo::{ALL_AXES, PpoSettings};
use reagent_core::{Action, Pose};

/// One observation: the state, the expert's action in it, the agent's action, and its reward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the problem in the buffer.
    pub problem: usize,
    /// Accumulated pose under which the source was seen.
    pub pose: Pose,
    /// The expert's action in this state.
    pub expert: Action,
    /// The action taken.
    pub action: Action,
    /// Log-probability of the action under the policy that took it, for each axis.
    pub log_probability: [f32; ALL_AXES],
    /// Value estimate of the value head.
    pub value: f32,
    /// Reward of the step taken here.
    pub reward: f32,
    /// Discounted sum of this and all later rewards of the trajectory.
    pub discounted_return: f32,
    /// Generalised advantage estimate.
    pub advantage: f32,
}

/// All observations of one update.
#[derive(Clone, Debug, Default)]
pub struct Buffer {
    /// The pairs of clouds.
    pub problems: Vec<Problem>,
    /// Trajectories rolled out side by side.
    pub trajectories: usize,
    /// Observations in the order they were made, step-major: trajectory `r` at step `s` is at `s * trajectories + r`.
    pub observations: Vec<Observation>,
}

impl Buffer {
    /// Computes every observation's return and advantage from the rewards and values. `last_values` are the
    /// estimates of the states after the last step, one a trajectory; a missing one counts as 0.
    pub fn compute_returns(&mut self, settings: &PpoSettings, last_values: &[f32]) {
        for trajectory in 0..self.trajectories {
            let last = last_values.get(trajectory).copied().unwrap_or(0.0);
            let mut next = Step {
                value: last,
                discounted_return: last,
                advantage: 0.0,
            };
            let steps = self.observations[trajectory..].iter_mut();
            for o in steps.step_by(self.trajectories).rev() {
                next = next.before(o.reward, o.value, settings);
                o.discounted_return = next.discounted_return;
                o.advantage = next.advantage;
            }
        }
    }

    /// Share of the variance of the returns that the value estimates explain: 1 at best, below 0 where a constant
    /// would do better, 0 where all returns are equal.
    pub fn explained_variance(&self) -> f64 {
        let returns = || {
            self.observations
                .iter()
                .map(|o| f64::from(o.discounted_return))
        };
        let errors = self
            .observations
            .iter()
            .map(|o| f64::from(o.discounted_return) - f64::from(o.value));
        let total = variance(returns());
        if total > 0.0 {
            1.0 - variance(errors) / total
        } else {
            0.0
        }
    }
}

/// A later step, as far as an earlier one needs it.
struct Step {
    value: f32,
    discounted_return: f32,
    advantage: f32,
}

impl Step {
    /// The step before this one: `R = r + γ R'`, `A = (r + γ v' - v) + γ λ A'`.
    fn before(&self, reward: f32, value: f32, settings: &PpoSettings) -> Step {
        let PpoSettings { gamma, lambda, .. } = *settings;
        let surprise = reward + gamma * self.value - value;
        Step {
            value,
            discounted_return: reward + gamma * self.discounted_return,
            advantage: surprise + gamma * lambda * self.advantage,
        }
    }
}

fn variance(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / n;
    values.map(|v| (v - mean).powi(2)).sum::<f64>() / n
}
