//! Losses on logits, with their gradients.

use reagent_core::Action;
use reagent_core::dims::{AXES, LOGITS, STEP_SIZES};

/// Cross-entropy of a mini-batch against the expert (the paper's behavioural cloning).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CloneLoss {
    /// Mean over the batch and the three translation axes.
    pub translation: f64,
    /// Mean over the batch and the three rotation axes.
    pub rotation: f64,
    /// Share of axes on which the most likely action is the expert's.
    pub agreement: f64,
}

impl CloneLoss {
    /// The loss that is minimised: the mean of both.
    pub fn total(&self) -> f64 {
        0.5 * (self.translation + self.rotation)
    }
}

/// Cloning loss of both heads, and its gradient with respect to the logits.
///
/// # Shapes
/// `logits` and `gradients`: `[33, B]` each, translation first; `expert [B]`.
pub fn clone_loss(logits: [&[f32]; 2], expert: &[Action], gradients: [&mut [f32]; 2]) -> CloneLoss {
    let batch = expert.len();
    let mut losses = [0.0f64; 2];
    let mut agree = 0usize;
    let weight = 1.0 / (2 * batch * AXES) as f32;
    for (head, (logits, gradient)) in logits.into_iter().zip(gradients).enumerate() {
        for (b, action) in expert.iter().enumerate() {
            let labels = if head == 0 {
                action.translation
            } else {
                action.rotation
            };
            for (axis, label) in labels.into_iter().enumerate() {
                let at = |i: usize| (axis * STEP_SIZES + i) * batch + b;
                let (log_sum, best) = log_sum_exp(std::array::from_fn(|i| logits[at(i)]));
                let label = usize::from(label);
                losses[head] += f64::from(log_sum - logits[at(label)]);
                agree += usize::from(best == label);
                for i in 0..STEP_SIZES {
                    let probability = (logits[at(i)] - log_sum).exp();
                    let expected = if i == label { 1.0 } else { 0.0 };
                    gradient[at(i)] = weight * (probability - expected);
                }
            }
        }
    }
    let n = (batch * AXES) as f64;
    CloneLoss {
        translation: losses[0] / n,
        rotation: losses[1] / n,
        agreement: agree as f64 / (2.0 * n),
    }
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

const _: () = assert!(LOGITS == AXES * STEP_SIZES);
