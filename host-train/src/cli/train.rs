//! `host-train train`

use super::source::{DataSource, positive};
use crate::expert::Expert;
use crate::optim::Schedule;
use crate::train::{self, Categories, Stage, TrainConfig};
use anyhow::{Context, bail};
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Train a policy
///
/// Writes RUN_DIR/config.json, metrics.jsonl, checkpoints and best/. Ctrl-C writes a checkpoint first;
/// --resume goes on exactly from there. The model that is kept is the best on a validation split carved
/// out of the training split by mesh.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Data sets (modelnet40_ply_hdf5_2048, ScanObjectNN, trees of loose meshes and clouds) or built-in shapes,
    /// taken together
    #[arg(long, value_name = "DIR|FILE.h5|procedural[:COUNT]", num_args = 1.., required = true)]
    data: Vec<DataSource>,
    /// What to train
    #[arg(long, value_enum, value_name = "STAGE")]
    stage: Stage,
    /// Categories of a data set that are trained on
    #[arg(long, value_enum, value_name = "WHICH", default_value_t = Categories::First)]
    categories: Categories,
    /// Directory of the run
    #[arg(long, value_name = "RUN_DIR")]
    out: PathBuf,
    /// Passes over the clouds [default: the paper's 50]
    #[arg(long, value_name = "N", value_parser = positive())]
    epochs: Option<usize>,
    /// Points drawn from each cloud
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = 1024)]
    points: usize,
    /// Learning rate of the first epochs [default: the paper's 1e-3 in pretrain, 1e-4 after]
    #[arg(long, value_name = "RATE", value_parser = rate)]
    learning_rate: Option<f32>,
    /// Epochs between halvings of the learning rate
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = 10)]
    halve_every: usize,
    /// Who labels the observations
    #[arg(long, value_enum, value_name = "WHO", default_value_t = Expert::Steady)]
    expert: Expert,
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
        let paper = TrainConfig::new(self.stage, self.data, self.out);
        let config = TrainConfig {
            categories: self.categories,
            epochs: self.epochs.map_or(paper.epochs, |n| n as u32),
            seed,
            points: self.points,
            schedule: Schedule {
                initial: self.learning_rate.unwrap_or(paper.schedule.initial),
                halve_every: self.halve_every as u32,
            },
            expert: self.expert,
            threads: self.threads.unwrap_or(paper.threads),
            init: self.init,
            ..paper
        };
        let stop = stop_on_ctrl_c()?;
        train::run(&config, self.resume, &stop)?;
        if stop.load(Ordering::Relaxed) {
            bail!(
                "interrupted: {} holds a checkpoint, go on with --resume",
                config.out.display()
            );
        }
        Ok(())
    }
}

/// A learning rate above 0 and at most 1.
fn rate(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(rate) if rate > 0.0 && rate <= 1.0 => Ok(rate),
        _ => Err("give a number above 0 and at most 1".into()),
    }
}

/// A flag that the first Ctrl-C sets; the second ends the process.
fn stop_on_ctrl_c() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot listen for Ctrl-C")?;
    let flag = stop.clone();
    std::thread::spawn(move || {
        runtime.block_on(async {
            if tokio::signal::ctrl_c().await.is_ok() {
                flag.store(true, Ordering::Relaxed);
                eprintln!("stopping after this update; Ctrl-C again loses what follows the last checkpoint");
            }
            if tokio::signal::ctrl_c().await.is_ok() {
                std::process::exit(1);
            }
        });
    });
    Ok(stop)
}
