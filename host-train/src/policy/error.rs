//! Why a policy file could not be read, made or written.

use super::BUNDLED;
use super::checkpoint::CheckpointError;
use crate::learn::env::Accumulation;
use crate::learn::nn::Shape;
use reagent_core::Error;
use std::path::PathBuf;

/// Why a policy file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The file could not be read.
    #[error("cannot read {path}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// There is neither such a file nor such a policy.
    #[error(
        "no policy {path}: it is no file, no run directory, and no bundled policy ({})",
        BUNDLED.map(|(name, _)| name).join(", ")
    )]
    Missing {
        /// What was asked for.
        path: PathBuf,
    },
    /// The file could not be written.
    #[error("cannot write {path}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The bytes are not a policy that this build runs.
    #[error("{path} is no usable policy")]
    Policy {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Error,
    },
    /// Parameters were asked of a file that holds 8-bit codes.
    #[error(
        "this weight file holds 8-bit integers; give the f32 file or checkpoint it was made from"
    )]
    Integers,
    /// The checkpoint could not be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The network has a shape that the deployed format does not hold.
    #[error(
        "a network of {0} cannot be deployed: only embeddings of three layers, with widths of multiples of 64 \
         and at most {paper}",
        paper = Shape::PAPER
    )]
    Shape(Shape),
    /// The network's actions accumulate in another way than the robot's do.
    #[error("a policy with {0} accumulation cannot be deployed; only global can")]
    Accumulation(Accumulation),
}
