//! Learning a policy: `env <-> agent -> buffer -> loss -> optim`; the loop is in [`crate::train`].

pub mod acting;
pub mod agent;
pub mod buffer;
pub mod env;
pub mod expert;
pub mod heads;
pub mod loss;
pub mod matmul;
pub mod nn;
pub mod optim;
pub mod ppo;
pub mod reward;
