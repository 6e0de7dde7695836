//! What a policy is worth: errors of its poses, other methods beside it, time, and needs of small boards.

pub mod agreement;
pub mod baselines;
pub mod document;
pub mod elf;
pub mod eval;
pub mod latency;
pub mod method;
pub mod metrics;
pub mod microcontrollers;
pub mod sweep;
