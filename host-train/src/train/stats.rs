//! The measurements of one update, as the metrics file has them.

use super::method::Method;
use crate::learn::buffer::Buffer;
use crate::learn::loss::{Losses, axes};
use crate::learn::ppo::ALL_AXES;
use crate::policy::checkpoint::EpochSums;
use reagent_core::dims::STEP_SIZES;
use serde::{Deserialize, Serialize};

/// The measurements of one update. Fields of the reinforcement term are absent in stages without it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UpdateStats {
    /// The loss that is minimised, mean over the mini-batches.
    pub loss: f64,
    /// Imitation term.
    pub clone: f64,
    /// Clipped surrogate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy: Option<f64>,
    /// Mean squared error of the value estimates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Mean entropy of an axis, nats.
    pub entropy: f64,
    /// Estimate of the KL divergence of the policy from the one that was rolled out, nats.
    pub approx_kl: f64,
    /// Share of ratios outside the clipping range.
    pub clip_fraction: f64,
    /// Share of the variance of the returns that the roll-out's value estimates explain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explained_variance: Option<f64>,
    /// Mean length of the gradient, before clipping.
    pub gradient_norm: f64,
    /// Mean reward of a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reward: Option<f64>,
    /// Share of axes on which the most likely action is the expert's.
    pub agreement: f64,
    /// The same by axis: translation x, y, z, rotation x, y, z.
    pub agreement_axes: [f64; ALL_AXES],
    /// Share of each step size among the actions taken, from -0.27 to 0.27.
    pub action_histogram: [f64; STEP_SIZES],
}

impl UpdateStats {
    pub(super) fn new(
        losses: &Losses,
        gradient_norm: f64,
        buffer: &Buffer,
        method: &Method,
    ) -> Self {
        let n = buffer.observations.len() as f64;
        let mut action_histogram = [0.0; STEP_SIZES];
        for o in &buffer.observations {
            for id in axes(&o.action) {
                action_histogram[id] += 1.0 / (n * ALL_AXES as f64);
            }
        }
        let on = method.ppo.on();
        let mean_reward = || {
            buffer
                .observations
                .iter()
                .map(|o| f64::from(o.reward))
                .sum::<f64>()
                / n
        };
        UpdateStats {
            loss: losses.total,
            clone: losses.imitation(),
            policy: on.then_some(losses.policy),
            value: on.then_some(losses.value),
            entropy: losses.entropy,
            approx_kl: losses.approx_kl,
            clip_fraction: losses.clip_fraction,
            explained_variance: on.then(|| buffer.explained_variance()),
            gradient_norm,
            reward: on.then(mean_reward),
            agreement: losses.agreement.iter().sum::<f64>() / ALL_AXES as f64,
            agreement_axes: losses.agreement,
            action_histogram,
        }
    }

    /// Adds these to the sums of their epoch.
    pub(super) fn add_to(&self, epoch: &mut EpochSums) {
        epoch.updates += 1;
        epoch.loss += self.loss;
        epoch.agreement += self.agreement;
        if let Some(reward) = self.reward {
            *epoch.reward.get_or_insert_default() += reward;
        }
    }
}
