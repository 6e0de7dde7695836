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
        /// The folder of its sources.
        directory: String,
        /// What cargo says.
        reason: String,
    },
    /// The process cannot be started, or its pipe fails.
    #[error("{QEMU}: {0}")]
    Process(#[from] io::Error),
    /// The board has stopped.
    #[error("the board has stopped: {0}")]
    Stopped(String),
    /// The board sends nothing.
    #[error("the board says nothing for {} s", SILENCE.as_secs())]
    Silent,
    /// The board has restarted, and has forgotten what it was asked.
    #[error("the board has started anew, probably by its watchdog")]
    Restarted,
    /// The board has the policy, but the policy does not pass the board's checks.
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
