//! The replay buffer: observations of roll-outs, as poses of problems rather than copies of clouds.

use crate::env::Problem;
use reagent_core::{Action, Pose};

/// One observation, labelled by the expert.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index of the problem in the buffer.
    pub problem: usize,
    /// Accumulated pose under which the source was seen.
    pub pose: Pose,
    /// What the expert does here.
    pub expert: Action,
}

/// All observations of one update.
#[derive(Clone, Debug, Default)]
pub struct Buffer {
    /// The pairs of clouds.
    pub problems: Vec<Problem>,
    /// Observations in the order they were made: step-major, then trajectory, then problem.
    pub observations: Vec<Observation>,
}
