//! The learning rate over a run.

use crate::learn::optim::Schedule;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// How the learning rate falls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Anneal {
    /// Halved every few epochs (the paper's)
    #[default]
    Halve,
    /// In a straight line to 0 at the end of the run
    Linear,
    /// Along half a cosine to 0 at the end of the run
    Cosine,
}

/// The learning rate of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearningRate {
    /// Rate at the start.
    pub initial: f32,
    /// Epochs between halvings; 0 never halves.
    pub halve_every: u32,
    /// How it falls.
    pub anneal: Anneal,
}

impl LearningRate {
    /// Rate of an update in epoch `epoch` (from 0), when the share `done` of the run's updates is done.
    pub fn at(&self, epoch: u32, done: f32) -> f32 {
        match self.anneal {
            Anneal::Halve => Schedule {
                initial: self.initial,
                halve_every: self.halve_every,
            }
            .rate(epoch),
            Anneal::Linear => self.initial * (1.0 - done),
            Anneal::Cosine => self.initial * 0.5 * (1.0 + (PI * done).cos()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_fall_as_described() {
        let rates = |anneal| {
            let rate = LearningRate {
                initial: 1.0,
                halve_every: 2,
                anneal,
            };
            [0, 1, 2, 3, 4].map(|epoch| rate.at(epoch, epoch as f32 / 4.0))
        };
        assert_eq!(rates(Anneal::Halve), [1.0, 1.0, 0.5, 0.5, 0.25]);
        assert_eq!(rates(Anneal::Linear), [1.0, 0.75, 0.5, 0.25, 0.0]);
        let expected = [1.0, 0.853_553_4, 0.5, 0.146_446_6, 0.0];
        for (rate, expected) in rates(Anneal::Cosine).into_iter().zip(expected) {
            assert!((rate - expected).abs() < 1e-6, "{rate} {expected}");
        }
    }
}
