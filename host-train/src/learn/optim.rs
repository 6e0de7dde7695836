//! Adam with AMSGrad, and the step schedule of the learning rate.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Constants of the optimiser; the defaults are PyTorch's, which the paper uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamSettings {
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// Added to the denominator.
    pub epsilon: f32,
}

impl Default for AdamSettings {
    fn default() -> Self {
        AdamSettings {
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
        }
    }
}

/// State of Adam with AMSGrad. The running maximum is taken of the raw second moment, and the bias correction is
/// applied after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// Constants.
    pub settings: AdamSettings,
    /// Steps taken.
    pub steps: u64,
    /// First moment.
    pub first: Vec<f32>,
    /// Second moment.
    pub second: Vec<f32>,
    /// Running maximum of the second moment.
    pub highest: Vec<f32>,
}

impl Adam {
    /// A fresh optimiser for `n` parameters.
    pub fn new(n: usize) -> Self {
        Adam {
            settings: AdamSettings::default(),
            steps: 0,
            first: vec![0.0; n],
            second: vec![0.0; n],
            highest: vec![0.0; n],
        }
    }

    /// Takes one step on all parameters, in one pass over memory.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], learning_rate: f32) {
        const BLOCK: usize = 1 << 14;
        let AdamSettings {
            beta1,
            beta2,
            epsilon,
        } = self.settings;
        self.steps += 1;
        let exponent = i32::try_from(self.steps).unwrap_or(i32::MAX);
        let step = (f64::from(learning_rate) / (1.0 - f64::from(beta1).powi(exponent))) as f32;
        let correction = (1.0 - f64::from(beta2).powi(exponent)).sqrt() as f32;
        parameters
            .par_chunks_mut(BLOCK)
            .zip(gradient.par_chunks(BLOCK))
            .zip(self.first.par_chunks_mut(BLOCK))
            .zip(self.second.par_chunks_mut(BLOCK))
            .zip(self.highest.par_chunks_mut(BLOCK))
            .for_each(|((((p, g), m), v), h)| {
                for i in 0..p.len() {
                    m[i] = beta1 * m[i] + (1.0 - beta1) * g[i];
                    v[i] = beta2 * v[i] + (1.0 - beta2) * g[i] * g[i];
                    h[i] = h[i].max(v[i]);
                    p[i] -= step * m[i] / (h[i].sqrt() / correction + epsilon);
                }
            });
    }
}

/// Step schedule that halves the learning rate every few epochs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Schedule {
    /// Rate of the first epochs.
    pub initial: f32,
    /// Epochs between halvings; 0 never halves.
    pub halve_every: u32,
}

impl Schedule {
    /// Learning rate in an epoch, counted from 0.
    pub fn rate(&self, epoch: u32) -> f32 {
        let halvings = epoch.checked_div(self.halve_every).unwrap_or(0);
        self.initial * 0.5f32.powi(halvings.min(120) as i32)
    }
}
