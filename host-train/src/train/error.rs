//! Why training stopped or did not start.

use super::trainer::Diverged;
use crate::dataset::DatasetError;
use crate::dataset::bop::BopError;
use crate::learn::env::Accumulation;
use crate::learn::nn::Shape;
use crate::measure::eval::EvalError;
use crate::policy::ExportError;
use crate::policy::checkpoint::CheckpointError;
use crate::words::count;
use std::path::PathBuf;

/// Why a run stopped or did not start.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The clouds could not be read.
    #[error(transparent)]
    Data(#[from] DatasetError),
    /// Depth images, annotations or models in BOP layout could not be read.
    #[error(transparent)]
    Bop(#[from] BopError),
    /// There are too few clouds.
    #[error(
        "{0} training clouds are too few: give at least 3, of which one is held back for validation"
    )]
    TooFewClouds(usize),
    /// None of the meshes shows in a depth view.
    #[error("nothing is seen of any of the meshes: they are too thin to be rendered")]
    NothingSeen,
    /// Options that contradict each other.
    #[error("{0}")]
    Contradiction(&'static str),
    /// The run directory cannot be used.
    #[error("cannot write to run directory {path}")]
    Directory {
        /// The directory, or a file in it.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A run is in the directory already.
    #[error("{0} holds a run already: give --resume to go on with it, or another --out")]
    Exists(PathBuf),
    /// Another process trains in the run directory.
    #[error("{0}: another process trains here: wait for it, or give another --out")]
    Busy(PathBuf),
    /// A run is to end before the updates that it has done.
    #[error(
        "{path} has done {} already, and {} would end after {total}: give more --epochs, or leave them out",
        count(*.done as usize, "update", "updates"), count(*.epochs as usize, "epoch", "epochs")
    )]
    Ended {
        /// The run directory.
        path: PathBuf,
        /// Updates done.
        done: u64,
        /// Epochs asked for.
        epochs: u32,
        /// Updates that these have.
        total: u64,
    },
    /// There is no run to resume, or its record is unreadable.
    #[error("no run to resume: {path}: {what}")]
    Record {
        /// The record.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A run cannot be resumed as another one.
    #[error(
        "{path} holds another run: {differences}; leave these options out, or give another --out"
    )]
    Incompatible {
        /// The run directory.
        path: PathBuf,
        /// What differs.
        differences: String,
    },
    /// The initial network has other widths.
    #[error(
        "{path} is a network of {found}, the run's is {wanted}: give the --shape that it was trained with"
    )]
    Shape {
        /// Where the initial network came from.
        path: PathBuf,
        /// Its widths.
        found: Shape,
        /// The run's.
        wanted: Shape,
    },
    /// The initial network was trained under another accumulation.
    #[error(
        "{path} was trained with {found} accumulation, this run has {wanted}: give the --accumulation that it was trained with"
    )]
    Accumulation {
        /// Where the initial network came from.
        path: PathBuf,
        /// Its accumulation.
        found: Accumulation,
        /// The run's.
        wanted: Accumulation,
    },
    /// A checkpoint could not be read or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The initial policy could not be read.
    #[error(transparent)]
    Policy(#[from] ExportError),
    /// Validation failed.
    #[error("validation failed")]
    Validation(#[from] EvalError),
    /// The loss is not a number any more.
    #[error(
        "update {update} diverged in mini-batch {mini_batch}: loss {loss}, gradient norm {gradient_norm}; lower the learning rate or give --clip-gradient{}",
        .saved.as_ref().map(|path| format!("; the mini-batch and the state before it are in {}", path.display())).unwrap_or_default()
    )]
    Diverged {
        /// The update.
        update: u64,
        /// The mini-batch of the update.
        mini_batch: usize,
        /// Its loss.
        loss: f64,
        /// Length of its gradient.
        gradient_norm: f64,
        /// Where it was saved.
        saved: Option<PathBuf>,
    },
    /// The threads could not be started.
    #[error("cannot start {threads} threads")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// What the system said.
        source: rayon::ThreadPoolBuildError,
    },
}

impl TrainError {
    pub(super) fn diverged(update: u64, what: &Diverged, saved: Option<PathBuf>) -> Self {
        TrainError::Diverged {
            update,
            mini_batch: what.mini_batch,
            loss: what.losses.total,
            gradient_norm: what.gradient_norm,
            saved,
        }
    }
}
