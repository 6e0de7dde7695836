//! `host-train train`

use super::source::{DataSource, positive};
use crate::train::{self, Stage, TrainConfig};
use clap::Args;
use std::path::PathBuf;

/// Train a policy
///
/// Writes RUN_DIR/config.json, metrics.jsonl, checkpoints and best/. Ctrl-C writes a checkpoint first;
/// --resume goes on exactly from there. The model that is kept is the best on a validation split carved
/// out of the training split by mesh.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Data set (modelnet40_ply_hdf5_2048 layout), or the built-in shapes
    #[arg(long, value_name = "DIR|procedural")]
    data: DataSource,
    /// What to train
    #[arg(long, value_enum, value_name = "STAGE", default_value_t = Stage::Pretrain)]
    stage: Stage,
    /// Directory of the run
    #[arg(long, value_name = "RUN_DIR")]
    out: PathBuf,
    /// Passes over the data [default: the stage's in the paper]
    #[arg(long, value_name = "N", value_parser = positive())]
    epochs: Option<usize>,
    /// Go on from the last checkpoint of the run
    #[arg(long)]
    resume: bool,
    /// Threads; results do not depend on it [default: all cores]
    #[arg(long, value_name = "N", value_parser = positive())]
    threads: Option<usize>,
    /// Start from a run, a checkpoint or a policy instead of random weights
    #[arg(long, value_name = "RUN_OR_WEIGHTS", conflicts_with = "resume")]
    init: Option<PathBuf>,
}

impl TrainArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let all_cores = || std::thread::available_parallelism().map_or(1, usize::from);
        let config = TrainConfig {
            data: self.data,
            stage: self.stage,
            out: self.out,
            epochs: self.epochs,
            seed,
            threads: self.threads.unwrap_or_else(all_cores),
            init: self.init,
        };
        Ok(train::run(&config, self.resume)?)
    }
}
