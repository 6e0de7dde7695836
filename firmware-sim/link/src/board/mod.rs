//! Simulated boards: their kinds, the image that they run, the emulator, and the serial line to it.

mod emulator;
mod error;
mod image;
mod kind;
mod line;

pub use emulator::{Simulation, check_simulator};
pub use error::BoardError;
pub use image::{Clouds, build_image, flash_content};
pub use kind::Kind;
pub use line::Board;

use std::time::Duration;

/// The program that simulates boards.
pub const QEMU: &str = "qemu-system-arm";
/// A board that sends nothing for longer than this does not work. On a busy machine a step takes seconds.
pub const SILENCE: Duration = Duration::from_secs(120);
