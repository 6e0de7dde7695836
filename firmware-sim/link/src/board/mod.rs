//! Simulated boards: their kinds, the image that they run, the emulator, and the serial line to it.

mod emulator;
mod error;
mod image;
mod kind;
mod line;

pub use emulator::{QEMU, SILENCE, Simulation, check_simulator};
pub use error::BoardError;
pub use image::{Clouds, build_image, flash_content};
pub use kind::Kind;
pub use line::Board;
