//! Where a run begins, and the checkpoint from which it can go on.

use super::config::TrainConfig;
use super::error::TrainError;
use super::trainer::Trainer;
use crate::learn::env::Accumulation;
use crate::learn::nn::Parameters;
use crate::policy::WeightFile;
use crate::policy::checkpoint::{Checkpoint, Progress};
use std::path::PathBuf;

/// The trainer at the start of a run or where a stopped run left it, and the progress made so far.
pub(super) fn start(
    config: &TrainConfig,
    resumed: Option<Checkpoint>,
) -> Result<(Trainer, Progress), TrainError> {
    let wanted = config.network.shape();
    let accumulation = config.method.accumulation;
    let (checkpoint, path) = match (resumed, &config.init) {
        (Some(checkpoint), _) => (checkpoint, config.out.clone()),
        (None, None) => {
            let parameters = Parameters::random(wanted, config.seed);
            (
                Checkpoint::start(parameters, accumulation, config.sight),
                PathBuf::new(),
            )
        }
        (None, Some(path)) => {
            let (parameters, found) = if path.extension().is_some_and(|e| e == "rgw") {
                let parameters = WeightFile::load(path)?.parameters(config.seed)?;
                (parameters, Accumulation::Global)
            } else {
                let checkpoint = Checkpoint::load(&Checkpoint::find(path)?)?;
                let found = checkpoint.accumulation;
                (checkpoint.result(), found)
            };
            if found != accumulation {
                return Err(TrainError::Accumulation {
                    path: path.clone(),
                    found,
                    wanted: accumulation,
                });
            }
            (
                Checkpoint::start(parameters, accumulation, config.sight),
                path.clone(),
            )
        }
    };
    let found = checkpoint.parameters.shape;
    if found != wanted {
        return Err(TrainError::Shape {
            path,
            found,
            wanted,
        });
    }
    let Checkpoint {
        parameters,
        adam,
        averaged,
        accumulation: _,
        sight: _,
        progress,
    } = checkpoint;
    let mut trainer = Trainer::new(
        parameters,
        adam,
        progress.updates,
        config.seed,
        config.roll_out,
        config.method,
    );
    if averaged.is_some() {
        trainer.averaged = averaged;
    }
    Ok((trainer, progress))
}

/// Everything that the run needs to go on from here.
pub(super) fn checkpoint(
    config: &TrainConfig,
    trainer: &Trainer,
    progress: &Progress,
) -> Checkpoint {
    Checkpoint {
        parameters: trainer.agent.parameters.clone(),
        adam: trainer.adam.clone(),
        averaged: trainer.averaged.clone(),
        accumulation: config.method.accumulation,
        sight: config.sight,
        progress: Progress {
            updates: trainer.updates,
            optimiser_steps: trainer.adam.steps,
            ..progress.clone()
        },
    }
}
