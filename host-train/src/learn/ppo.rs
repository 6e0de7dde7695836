//! Settings of the reinforcement term.

use reagent_core::dims::AXES;
use serde::{Deserialize, Serialize};

/// Axes of both heads: three of translation, then three of rotation.
pub const ALL_AXES: usize = 2 * AXES;

/// Settings of the reinforcement term. Defaults that the paper does not give are those of the authors' code.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PpoSettings {
    /// Weight of the reinforcement term, alpha (paper: 2; 0.1 on LINEMOD; 0 is imitation alone).
    pub alpha: f32,
    /// Discount of later rewards, gamma (paper: 0.99).
    pub gamma: f32,
    /// Factor of generalised advantage estimation, lambda (paper: 0.95).
    pub lambda: f32,
    /// Ratios are clipped to `1 - clip ..= 1 + clip` (authors' code: 0.2).
    pub clip: f32,
    /// Weight of the value loss (authors' code: 0.3).
    pub value_weight: f32,
    /// Weight of the mean entropy of an axis (authors' code: 0.001).
    pub entropy_weight: f32,
    /// Whether advantages are normalised to mean 0 and standard deviation 1 in each mini-batch (authors' code: no).
    pub normalise_advantages: bool,
    /// Whether values, too, are clipped to within `clip` of those of the roll-out (authors' code: no).
    pub clip_values: bool,
    /// Whether returns are bootstrapped with the value estimate of the state after the last step (authors' code:
    /// no, it counts as 0).
    pub bootstrap: bool,
}

impl PpoSettings {
    /// The paper's settings with the given weight of the reinforcement term.
    pub fn new(alpha: f32) -> Self {
        PpoSettings {
            alpha,
            gamma: 0.99,
            lambda: 0.95,
            clip: 0.2,
            value_weight: 0.3,
            entropy_weight: 0.001,
            normalise_advantages: false,
            clip_values: false,
            bootstrap: false,
        }
    }

    /// Whether there is a reinforcement term at all.
    pub fn on(&self) -> bool {
        self.alpha != 0.0
    }
}
