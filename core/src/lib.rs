//! Point cloud registration in about ten discrete, interpretable steps (ReAgent), for hosts and firmware.
#![cfg_attr(not(test), no_std)]

pub mod dims;
pub mod error;
pub mod kernels;
pub mod net;
pub mod pose;
pub mod register;
pub mod steps;
pub mod weights;
pub mod wire;

pub use error::Error;
pub use pose::Pose;
pub use register::{Frame, Registrar, Registration, Verdict};
pub use steps::Action;
pub use weights::Policy;
