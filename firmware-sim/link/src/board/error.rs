//! Why a board cannot be used.

use super::{QEMU, SILENCE};
use reagent_core::wire::Reason;
use std::io;
use thiserror::Error;

/// Why a board cannot be used.
#[derive(Debug, Error)]
pub enum BoardError {
    /// The simulator is not installed.
    #[error(
        "{QEMU} is not installed, and boards are simulated by it: apt-get install qemu-system-arm \
         (Debian, Ubuntu), brew install qemu (macOS)"
    )]
    NoQemu,
    /// The compiler cannot build for the board.
    #[error("the compiler has no core library for {target}: rustup target add {target}")]
    NoTarget {
        /// As the compiler calls it.
        target: &'static str,
    },
    /// The image cannot be built.
    #[error("the image for {target} does not build (cargo build in {directory}): {reason}")]
    Build {
        /// As the compiler calls it.
        target: &'static str,
        /// Where its sources are.
        directory: String,
        /// What cargo says.
        reason: String,
    },
    /// The process cannot be started or spoken to.
    #[error("{QEMU}: {0}")]
    Process(#[from] io::Error),
    /// The board has stopped.
    #[error("the board has stopped: {0}")]
    Stopped(String),
    /// The board says nothing.
    #[error("the board says nothing for {} s", SILENCE.as_secs())]
    Silent,
    /// The board has started anew, and what it was asked is forgotten.
    #[error("the board has started anew, probably by its watchdog")]
    Restarted,
    /// The policy that the board has taken does not pass its checks.
    #[error("the board does not use its policy: {reason}")]
    PolicyUnfit {
        /// Why.
        reason: Reason,
    },
    /// The board does not take a policy.
    #[error(
        "the board does not take the policy of {bytes} bytes; it has room for one in int8 \
         (host-train export --format int8)"
    )]
    PolicyRefused {
        /// Its length.
        bytes: usize,
    },
}
