//! The replay buffer: observations of roll-outs, as poses of problems rather than copies of clouds, and
//! the returns and advantages that belong to them.

use crate::learn::env::Problem;
use crate::learn::ppo::{ALL_AXES, PpoSettings};
use reagent_core::{Action, Pose};

/// One observation: the state, what the expert would do in it, and what the agent did and got.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the problem in the buffer.
    pub problem: usize,
    /// Accumulated pose under which the source was seen.
    pub pose: Pose,
    /// What the expert does here.
    pub expert: Action,
    /// What was done.
    pub action: Action,
    /// Logarithm of the probability that the policy gave to the action, for each axis.
    pub log_probability: [f32; ALL_AXES],
    /// What the value head expected.
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
    /// Observations in the order they were made, step-major: that of trajectory `r` in step `s` is at
    /// `s * trajectories + r`.
    pub observations: Vec<Observation>,
}

impl Buffer {
    /// Fills in returns and advantages from rewards and values, each at the observation that it belongs
    /// to. `last_values` are the estimates of the states after the last step, one a trajectory; none
    /// count as 0.
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

    /// Share of the variance of the returns that the value estimates explain; 1 at best, below 0 where a
    /// constant would do better. 0 where all returns are equal.
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

/// What is known of a later step when an earlier one is computed.
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
