//! The training loop: clouds in, checkpoints and metrics out.

mod bench;
mod config;
mod data;
mod fine_tune;
mod learning_rate;
mod method;
pub mod record;
mod roll_out;
mod run;
mod stats;
mod trainer;
mod validate;

pub use bench::{Speed, bench};
pub use config::{Categories, DataSource, Network, Stage, TrainConfig};
pub use fine_tune::fine_tune;
pub use learning_rate::{Anneal, LearningRate};
pub use method::{Follow, Method, RollOut};
pub use roll_out::Agent;
pub use run::{TrainError, run};
pub use stats::UpdateStats;
pub use trainer::{Diverged, Spent, Trainer};
pub use validate::arg_max_poses;
