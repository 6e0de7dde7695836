//! How observations are gathered and learned from: everything that one update needs besides the network.

use crate::learn::env::Accumulation;
use crate::learn::expert::Expert;
use crate::learn::nn::Search;
use crate::learn::ppo::PpoSettings;
use serde::{Deserialize, Serialize};

/// How observations are gathered and used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RollOut {
    /// Problems rolled out together (authors' code: 32).
    pub problems: usize,
    /// Trajectories from each problem, N (paper: 4).
    pub trajectories: usize,
    /// Steps of a trajectory, n (paper: 10).
    pub steps: usize,
    /// Observations of one optimiser step (paper: 32).
    pub mini_batch: usize,
}

impl Default for RollOut {
    fn default() -> Self {
        RollOut {
            problems: 32,
            trajectories: 4,
            steps: 10,
            mini_batch: 32,
        }
    }
}

impl RollOut {
    /// Observations in one replay buffer (paper: 1280).
    pub fn observations(&self) -> usize {
        self.problems * self.trajectories * self.steps
    }
}

/// Whose actions a trajectory takes (paper, design table, column "stoch.").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Follow {
    /// Drawn from the agent's policy (the paper's choice)
    #[default]
    Stochastic,
    /// The expert's: plain behavioural cloning. The table's first row says only that the stochastic policy
    /// is not used; this is how we read it
    Expert,
    /// The agent's most likely: the other reading of that row
    Argmax,
    /// The agent's nearest to its mean, as exported policies decide (ours): no action is random, so that one trajectory
    /// a problem is enough
    Mean,
}

/// What one update does with given problems.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Method {
    /// The expert that labels the observations (paper: steady).
    pub expert: Expert,
    /// How actions accumulate (paper: global).
    pub accumulation: Accumulation,
    /// Whose actions trajectories take (paper: stochastic).
    pub follow: Follow,
    /// The reinforcement term.
    pub ppo: PpoSettings,
    /// Largest gradient norm; a longer gradient is scaled down to it (authors' code: no limit).
    pub clip_gradient: Option<f32>,
    /// Decay per mini-batch of an exponential average of the parameters, which is validated and exported in their
    /// place (ours; the authors' code has none).
    pub average: Option<f32>,
    /// How training finds the points that reach a feature's maximum.
    pub search: Search,
}

impl Method {
    /// The paper's method with the given weight of reinforcement.
    pub fn new(alpha: f32) -> Self {
        Method {
            expert: Expert::Steady,
            accumulation: Accumulation::Global,
            follow: Follow::Stochastic,
            ppo: PpoSettings::new(alpha),
            clip_gradient: None,
            average: None,
            search: Search::Auto,
        }
    }
}
