//! `host-train bench`

use super::output::write_json;
use super::source::{DataSource, positive};
use crate::train::{self, Stage, TrainConfig};
use clap::Args;
use std::path::PathBuf;

/// Measure how fast this machine trains
///
/// Runs a few updates of the stages pretrain and ilrl with the paper's settings, after one of each to warm
/// up, and says where the time goes. Nothing is written but FILE.
#[derive(Debug, Args)]
pub(super) struct BenchArgs {
    /// Measure training: observations a second
    #[arg(long, required = true)]
    train: bool,
    /// Clouds to train on
    #[arg(long, value_name = "DIR|procedural[:COUNT]", num_args = 1.., default_value = "procedural:64")]
    data: Vec<DataSource>,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = positive())]
    threads: Option<usize>,
    /// Points of a cloud
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = 1024)]
    points: usize,
    /// Updates to measure of each stage, of 1280 observations each
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = 4)]
    updates: usize,
    /// Write what was measured (seconds) as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl BenchArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let mut speeds = Vec::new();
        println!("stage     threads  samples/s  roll-out  reward  update  data");
        for stage in [Stage::Pretrain, Stage::Ilrl] {
            let config = TrainConfig {
                seed,
                points: self.points,
                threads: self.threads.unwrap_or(0),
                ..TrainConfig::new(stage, self.data.clone(), PathBuf::new())
            };
            let speed = train::bench(&config, self.updates)?;
            let share = |seconds: f64| 100.0 * seconds / speed.seconds;
            println!(
                "{:<9} {:>7}  {:>9.0}  {:>6.1} %  {:>4.1} %  {:>4.1} %  {:>2.1} %",
                stage.to_string(),
                speed.threads,
                speed.samples_per_s,
                share(speed.roll_out_s),
                share(speed.reward_s),
                share(speed.update_s),
                share(speed.data_s),
            );
            speeds.push(speed);
        }
        if let Some(path) = &self.json {
            write_json(path, &serde_json::json!({ "train": speeds }))?;
        }
        Ok(())
    }
}
