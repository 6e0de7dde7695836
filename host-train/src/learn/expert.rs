//! The experts that imitation learns from (paper, eqs. 10 and 11).

use glam::Vec3;
use reagent_core::pose::euler_from_rotation;
use reagent_core::steps::{STEPS, STOP};
use reagent_core::{Action, Pose};
use serde::{Deserialize, Serialize};

/// The expert that labels the observations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Expert {
    /// The largest step that does not overshoot (the paper's choice: interpretable trajectories).
    #[default]
    Steady,
    /// The nearest step, which may overshoot and may go back.
    Greedy,
}

impl Expert {
    /// The expert's action: one step an axis, rotation by XYZ Euler angles. `remaining` is the update that would
    /// register the source in one go ([`crate::learn::env::Accumulation::remaining`]).
    pub fn action(self, remaining: &Pose) -> Action {
        Action {
            translation: self.axes(remaining.translation),
            rotation: self.axes(euler_from_rotation(&remaining.rotation)),
        }
    }

    fn axes(self, delta: Vec3) -> [u8; 3] {
        delta.to_array().map(|d| match self {
            Expert::Steady => steady(d),
            Expert::Greedy => greedy(d),
        })
    }
}

/// Largest step strictly below the error, or stop where there is none.
fn steady(delta: f32) -> u8 {
    signed(
        delta,
        STEPS[STOP_INDEX..].iter().rposition(|&s| s < delta.abs()),
    )
}

/// Step nearest to the error, the larger of two equally near.
fn greedy(delta: f32) -> u8 {
    let mut nearest = (f32::INFINITY, 0);
    for (i, &step) in STEPS[STOP_INDEX..].iter().enumerate() {
        let distance = (delta.abs() - step).abs();
        if distance <= nearest.0 {
            nearest = (distance, i);
        }
    }
    signed(delta, Some(nearest.1))
}

const STOP_INDEX: usize = STOP as usize;

fn signed(delta: f32, magnitude: Option<usize>) -> u8 {
    let magnitude = magnitude.unwrap_or(0) as u8;
    if delta < 0.0 {
        STOP - magnitude
    } else {
        STOP + magnitude
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_never_overshoots_and_greedy_takes_the_nearest() {
        assert_eq!(
            [0.0, -0.0, 0.0033, 0.0034, -0.28, 0.27].map(steady),
            [5, 5, 5, 6, 0, 9]
        );
        assert_eq!(
            [0.016, 0.021, -0.001, 0.0017, 3.0].map(greedy),
            [7, 8, 5, 6, 10]
        );
    }
}
