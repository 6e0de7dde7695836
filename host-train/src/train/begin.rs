//! The beginning of a run: its data, network and optimiser, and the folder for its results, new or as a stopped run left them.

use super::config::TrainConfig;
use super::data::{TrainingData, fingerprint, load};
use super::error::TrainError;
use super::progress::next_command;
use super::record::{RunDirectory, RunRecord, lock};
use super::state::start;
use super::trainer::Trainer;
use crate::dataset::pairs::PairSet;
use crate::policy::checkpoint::{Checkpoint, LAST, PREVIOUS, Progress};
use crate::words::count;
use std::fs::File;

/// A run that can take its next update.
pub(super) struct Begun {
    /// The clouds to train on.
    pub(super) training: TrainingData,
    /// The pairs that each epoch ends with.
    pub(super) validation: PairSet,
    /// Network and optimiser.
    pub(super) trainer: Trainer,
    /// What was reached so far.
    pub(super) progress: Progress,
    /// The folder for the results.
    pub(super) directory: RunDirectory,
    /// Updates of the whole run.
    pub(super) total: u64,
    /// Keeps other runs out of the folder.
    pub(super) locked: File,
}

/// Begins a run, or resumes one; `None` if nothing is left of it to do.
pub(super) fn begin(config: &TrainConfig, resume: bool) -> Result<Option<Begun>, TrainError> {
    config.check()?;
    let kept = [LAST, PREVIOUS].map(|name| config.out.join(name));
    let is_free = || match !resume && kept.iter().any(|path| path.exists()) {
        true => Err(TrainError::Exists(config.out.clone())),
        false => Ok(()),
    };
    is_free()?;

    // Data, network and optimiser, a folder for the results.
    let (training, validation) = load(config)?;
    let before = match resume {
        true => Some(RunRecord::load(&config.out)?),
        false => None,
    };
    let locked = lock(&config.out)?;
    // Another run may have ended here while the data was read.
    is_free()?;
    let record = RunRecord {
        version: env!("CARGO_PKG_VERSION").into(),
        data_sha256: fingerprint(&training),
        config: config.clone(),
    };
    let resumed = match resume {
        true => Checkpoint::load_newest(&config.out)?,
        false => None,
    };
    // A run that was stopped before its first checkpoint starts again.
    let done = resumed.as_ref().map_or(0, |c| c.progress.updates);
    let updates_before = resume.then_some(done);
    let total = config.updates(training.len());
    if let Some(before) = &before {
        before.check_resumed(&record)?;
        if total <= done && config.epochs < before.config.epochs {
            return Err(TrainError::Ended {
                path: config.out.clone(),
                done,
                epochs: config.epochs,
                total,
            });
        }
    }
    let (trainer, progress) = start(config, resumed)?;
    if resume && total <= done {
        eprintln!(
            "nothing left to do: all {} are done; more --epochs go on",
            count(total as usize, "update", "updates")
        );
        eprintln!("{}", next_command(config, &progress));
        return Ok(None);
    }
    // Four vectors of a checkpoint, and an average; last, previous, best and one being written.
    let room = trainer.agent.parameters.values.len() * 4 * 5 * 4;
    let directory = RunDirectory::open(&record, updates_before, room)?;
    Ok(Some(Begun {
        training,
        validation,
        trainer,
        progress,
        directory,
        total,
        locked,
    }))
}
