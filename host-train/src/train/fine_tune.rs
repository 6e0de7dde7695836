//! A short run without a run directory: it trains the shipped policy further.

use super::config::{Stage, TrainConfig};
use super::error::TrainError;
use super::method::{Follow, RollOut};
use super::trainer::Trainer;
use crate::dataset::pairs::Sample;
use crate::learn::env::Problem;
use crate::learn::optim::Adam;
use crate::policy::WeightFile;
use crate::random::{Purpose, Rng, stream};
use rayon::prelude::*;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Learning rate of the first update; it falls linearly to zero as the time runs out.
const LEARNING_RATE: f32 = 2e-4;
/// Decay of the exponential average ([`super::Method::average`]); a short run has a few hundred mini-batches.
const AVERAGE: f32 = 0.98;

/// Trains an f32 policy further by imitation until the time is up. The new policy looks and decides as the given one does.
/// `sample` draws sample number `i` from a stream of its own; `progress` is told the number of updates done and the loss.
///
/// # Errors
/// [`TrainError::Diverged`] or [`TrainError::Policy`].
pub fn fine_tune(
    start: &WeightFile,
    sample: impl Fn(&mut Rng, u64) -> Sample + Sync,
    budget: Duration,
    seed: u64,
    mut progress: impl FnMut(u64, f64),
) -> Result<WeightFile, TrainError> {
    let mut config = TrainConfig::new(Stage::Il, Vec::new(), PathBuf::new());
    // A short run: smaller buffers are fresher, and give more updates.
    config.roll_out = RollOut {
        problems: 32,
        trajectories: 1,
        ..RollOut::default()
    };
    config.method.follow = Follow::Mean;
    config.method.average = Some(AVERAGE);
    let policy = start.policy();
    let parameters = start.parameters(seed)?;
    let adam = Adam::new(parameters.values.len());
    let mut trainer = Trainer::new(parameters, adam, 0, seed, config.roll_out, config.method);
    let batch = config.roll_out.problems as u64;
    let clock = Instant::now();
    loop {
        let spent = clock.elapsed().as_secs_f32() / budget.as_secs_f32().max(1e-3);
        if spent >= 1.0 {
            break;
        }
        let update = trainer.updates;
        let problems = (update * batch..(update + 1) * batch)
            .into_par_iter()
            .map(|i| {
                let sample = sample(&mut stream(seed, Purpose::Augment, i), i);
                Problem::seen(policy.sight, sample)
            })
            .collect();
        let rate = LEARNING_RATE * (1.0 - spent);
        let stats = trainer
            .update(problems, rate)
            .map_err(|diverged| TrainError::diverged(update, &diverged, None))?;
        progress(trainer.updates, stats.loss);
    }
    Ok(WeightFile::from_parameters(&trainer.result())?.run_like(&policy))
}
