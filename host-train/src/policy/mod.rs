//! A policy as a file: checkpoints of training, the bytes that robots run, and their announcement.

mod bundled;
pub mod checkpoint;
mod error;
mod export;
mod file;
pub mod import;
pub mod manifest;
pub mod quantise;

pub use bundled::{BUNDLED, COMPACT, REAGENT, REAGENT_INT8, VIEWS, VIEWS_COMPACT};
pub use error::ExportError;
pub use export::parameters_of;
pub use file::WeightFile;
