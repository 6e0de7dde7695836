//! How fast training is: a few updates of a stage, without a run directory.

use super::config::{Stage, TrainConfig};
use super::data::{load, problems};
use super::error::TrainError;
use super::trainer::{Spent, Trainer};
use crate::learn::nn::Parameters;
use crate::learn::optim::Adam;
use serde::Serialize;
use std::time::Instant;

/// Speed of one stage, and where its time goes. All times are wall-clock seconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Speed {
    /// The stage.
    pub stage: Stage,
    /// Threads.
    pub threads: usize,
    /// Points a cloud.
    pub points: usize,
    /// Observations learned from.
    pub samples: usize,
    /// Observations a second.
    pub samples_per_s: f64,
    /// Total time.
    pub seconds: f64,
    /// Waiting for clouds to be drawn.
    pub data_s: f64,
    /// Roll-outs.
    pub roll_out_s: f64,
    /// Rewards, returns and advantages.
    pub reward_s: f64,
    /// Mini-batches: forward, backward, optimiser.
    pub update_s: f64,
}

/// Measures some updates of the configured stage after one to warm up.
///
/// # Errors
/// [`TrainError::Data`], [`TrainError::Threads`], [`TrainError::Diverged`].
pub fn bench(config: &TrainConfig, updates: usize) -> Result<Speed, TrainError> {
    super::run::on_threads(config.threads, || measure(config, updates))
}

fn measure(config: &TrainConfig, updates: usize) -> Result<Speed, TrainError> {
    let (training, _) = load(config)?;
    let parameters = Parameters::random(config.network.shape(), config.seed);
    let adam = Adam::new(parameters.values.len());
    let mut trainer = Trainer::new(
        parameters,
        adam,
        0,
        config.seed,
        config.roll_out,
        config.method,
    );
    let mut next = problems(config, &training, 0)?;
    let mut clock = Instant::now();
    for done in 0..=updates {
        if done == 1 {
            trainer.spent = Spent::default();
            clock = Instant::now();
        }
        let update = trainer.updates;
        let now = std::mem::take(&mut next);
        let (result, prepared) = rayon::join(
            || trainer.update(now, config.learning_rate.initial),
            || problems(config, &training, update + 1),
        );
        result.map_err(|diverged| TrainError::diverged(update, &diverged, None))?;
        next = prepared?;
    }
    let seconds = clock.elapsed().as_secs_f64();
    let Spent {
        roll_out,
        reward,
        learn,
    } = trainer.spent;
    let samples = updates * config.roll_out.observations();
    let [roll_out_s, reward_s, update_s] = [roll_out, reward, learn].map(|t| t.as_secs_f64());
    Ok(Speed {
        stage: config.stage,
        threads: rayon::current_num_threads(),
        points: config.points,
        samples,
        samples_per_s: samples as f64 / seconds,
        seconds,
        data_s: seconds - roll_out_s - reward_s - update_s,
        roll_out_s,
        reward_s,
        update_s,
    })
}
