//! The training loop: clouds in, checkpoints and metrics out.

mod config;
mod data;
mod run;
mod trainer;

pub use config::{Categories, DataSource, RollOut, Stage, TrainConfig};
pub use run::{TrainError, fine_tune, run};
pub use trainer::{Trainer, UpdateStats};
