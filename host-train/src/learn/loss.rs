//! The combined loss of a mini-batch, `l = l_IL + alpha l_RL`, with its gradient (paper, Algorithm 1).

use crate::learn::buffer::Observation;
use crate::learn::ppo::{ALL_AXES, PpoSettings};
use reagent_core::Action;
use reagent_core::dims::{AXES, STEP_SIZES};
use serde::Serialize;

/// The parts of a mini-batch's loss, and what they tell about the policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Losses {
    /// The loss that is minimised: `clone + alpha ppo`.
    pub total: f64,
    /// Cross-entropy to the expert's action, mean over the batch and the translation axes.
    pub clone_translation: f64,
    /// The same for the rotation axes.
    pub clone_rotation: f64,
    /// Clipped surrogate with a ratio for each axis, mean over the batch and six axes.
    pub policy: f64,
    /// Mean squared error of the value estimate to the return.
    pub value: f64,
    /// Mean entropy of an axis, nats.
    pub entropy: f64,
    /// Mean of `ratio - 1 - ln ratio` an axis: an estimate of KL(old, new) that is never negative.
    pub approx_kl: f64,
    /// Share of ratios outside the clipping range.
    pub clip_fraction: f64,
    /// Share of states on which the most likely action of each axis is the expert's.
    pub agreement: [f64; ALL_AXES],
}

impl Losses {
    /// The imitation term: the mean of both cross-entropies.
    pub fn imitation(&self) -> f64 {
        0.5 * (self.clone_translation + self.clone_rotation)
    }

    /// The reinforcement term.
    pub fn reinforcement(&self, settings: &PpoSettings) -> f64 {
        self.policy + f64::from(settings.value_weight) * self.value
            - f64::from(settings.entropy_weight) * self.entropy
    }

    /// Adds `share` times another.
    pub fn add(&mut self, share: f64, other: &Losses) {
        self.total += share * other.total;
        self.clone_translation += share * other.clone_translation;
        self.clone_rotation += share * other.clone_rotation;
        self.policy += share * other.policy;
        self.value += share * other.value;
        self.entropy += share * other.entropy;
        self.approx_kl += share * other.approx_kl;
        self.clip_fraction += share * other.clip_fraction;
        for (sum, x) in self.agreement.iter_mut().zip(other.agreement) {
            *sum += share * x;
        }
    }
}

/// Loss of a mini-batch, and its gradient with respect to logits and values. Where reinforcement is off
/// ([`PpoSettings::on`]), its term is left out, and `values` and `value_gradient` are not used.
///
/// # Shapes
/// `logits` and `gradients`: `[33, B]` each, translation first; `batch [B]`, `values` and
/// `value_gradient [B]`.
pub fn combined_loss(
    logits: [&[f32]; 2],
    values: &[f32],
    batch: &[Observation],
    settings: &PpoSettings,
    gradients: [&mut [f32]; 2],
    value_gradient: &mut [f32],
) -> Losses {
    let count = batch.len();
    let advantages = Advantages::of(batch, settings);
    let weight = 1.0 / (ALL_AXES * count) as f32;
    let mut sums = Losses::default();
    let (low, high) = (1.0 - settings.clip, 1.0 + settings.clip);
    for (head, (logits, gradient)) in logits.into_iter().zip(gradients).enumerate() {
        for (b, observation) in batch.iter().enumerate() {
            let advantage = advantages.scaled(observation.advantage);
            let expert = axes(&observation.expert);
            let taken = axes(&observation.action);
            for axis in 0..AXES {
                let at = |i: usize| (axis * STEP_SIZES + i) * count + b;
                let all = head * AXES + axis;
                let axis_logits: [f32; STEP_SIZES] = std::array::from_fn(|i| logits[at(i)]);
                let (log_sum, best) = log_sum_exp(axis_logits);
                let log_p = axis_logits.map(|l| l - log_sum);
                let p = log_p.map(f32::exp);
                let entropy: f32 = -log_p.iter().zip(p).map(|(l, p)| l * p).sum::<f32>();

                let cross_entropy = f64::from(-log_p[expert[all]]);
                if head == 0 {
                    sums.clone_translation += cross_entropy;
                } else {
                    sums.clone_rotation += cross_entropy;
                }
                sums.agreement[all] += f64::from(u8::from(best == expert[all]));
                sums.entropy += f64::from(entropy);

                let log_ratio = log_p[taken[all]] - observation.log_probability[all];
                let ratio = log_ratio.exp();
                sums.approx_kl += f64::from(ratio - 1.0 - log_ratio);
                sums.clip_fraction += f64::from(u8::from(!(low..=high).contains(&ratio)));
                let (plain, clipped) = (ratio * advantage, ratio.clamp(low, high) * advantage);
                sums.policy -= f64::from(plain.min(clipped));
                // The gradient flows where the plain term is the smaller: d ratio = ratio d log p.
                let pull = if settings.on() && plain <= clipped {
                    settings.alpha * plain
                } else {
                    0.0
                };
                let spread = settings.alpha * settings.entropy_weight;
                for i in 0..STEP_SIZES {
                    let one = |id: usize| f32::from(u8::from(i == id));
                    let imitate = p[i] - one(expert[all]);
                    let reinforce = pull * (p[i] - one(taken[all]));
                    let explore = spread * p[i] * (log_p[i] + entropy);
                    gradient[at(i)] = weight * (imitate + reinforce + explore);
                }
            }
        }
    }
    if settings.on() {
        let weight = settings.alpha * settings.value_weight / count as f32;
        for ((&value, observation), gradient) in values.iter().zip(batch).zip(value_gradient) {
            let (squared, slope) = value_error(value, observation, settings);
            sums.value += f64::from(squared);
            *gradient = weight * slope;
        }
    }
    let n = count as f64;
    let all = n * ALL_AXES as f64;
    let mut losses = Losses {
        total: 0.0,
        clone_translation: sums.clone_translation / (n * AXES as f64),
        clone_rotation: sums.clone_rotation / (n * AXES as f64),
        policy: sums.policy / all,
        value: sums.value / n,
        entropy: sums.entropy / all,
        approx_kl: sums.approx_kl / all,
        clip_fraction: sums.clip_fraction / all,
        agreement: sums.agreement.map(|a| a / n),
    };
    losses.total = losses.imitation();
    if settings.on() {
        losses.total += f64::from(settings.alpha) * losses.reinforcement(settings);
    }
    losses
}

/// Squared error of a value estimate, and its derivative. With clipping it is the larger of the plain error and
/// that of the clipped estimate, which is constant outside the range.
fn value_error(value: f32, observation: &Observation, settings: &PpoSettings) -> (f32, f32) {
    let error = value - observation.discounted_return;
    let moved = value - observation.value;
    // Within the range both are equal, and rounding must not decide between them.
    if settings.clip_values && moved.abs() > settings.clip {
        let clipped = observation.value + moved.clamp(-settings.clip, settings.clip);
        let clipped_error = clipped - observation.discounted_return;
        if clipped_error.powi(2) > error.powi(2) {
            return (clipped_error.powi(2), 0.0);
        }
    }
    (error.powi(2), 2.0 * error)
}

/// Shift and scale applied to the advantages of a mini-batch.
struct Advantages {
    shift: f32,
    scale: f32,
}

impl Advantages {
    fn of(batch: &[Observation], settings: &PpoSettings) -> Self {
        if !settings.normalise_advantages || batch.len() < 2 {
            return Advantages {
                shift: 0.0,
                scale: 1.0,
            };
        }
        let n = batch.len() as f64;
        let values = || batch.iter().map(|o| f64::from(o.advantage));
        let mean = values().sum::<f64>() / n;
        let variance = values().map(|a| (a - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Advantages {
            shift: mean as f32,
            scale: (1.0 / (variance.sqrt() + 1e-8)) as f32,
        }
    }

    fn scaled(&self, advantage: f32) -> f32 {
        (advantage - self.shift) * self.scale
    }
}

/// Step ids of all axes, translation first.
pub fn axes(action: &Action) -> [usize; ALL_AXES] {
    let [a, b, c] = action.translation.map(usize::from);
    let [d, e, f] = action.rotation.map(usize::from);
    [a, b, c, d, e, f]
}

/// `log Σ exp` of one axis, and the index of its largest logit.
pub fn log_sum_exp(logits: [f32; STEP_SIZES]) -> (f32, usize) {
    let mut best = 0;
    for (i, &l) in logits.iter().enumerate() {
        if l > logits[best] {
            best = i;
        }
    }
    let top = logits[best];
    let sum: f32 = logits.iter().map(|l| (l - top).exp()).sum();
    (top + sum.ln(), best)
}
