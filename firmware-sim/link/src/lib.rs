//! What a robot and a workstation share beyond the wire format of `reagent_core`. A robot never links the trainer, and the trainer
//! never links a robot.

pub mod board;
#[cfg(feature = "session")]
pub mod certificate;
pub mod files;
pub mod log;
#[cfg(feature = "session")]
pub mod metrics;
pub mod name;
pub mod print;
#[cfg(feature = "session")]
pub mod routers;
#[cfg(feature = "session")]
pub mod session;
#[cfg(feature = "session")]
pub mod stop;
