//! What a policy is worth: its errors, other methods beside it, its time, and its needs on small boards.

#[cfg(not(target_family = "wasm"))]
pub mod agreement;
#[cfg(not(target_family = "wasm"))]
pub mod calibrate;
#[cfg(not(target_family = "wasm"))]
pub mod document;
#[cfg(not(target_family = "wasm"))]
pub mod elf;
#[cfg(not(target_family = "wasm"))]
pub mod eval;
#[cfg(not(target_family = "wasm"))]
pub mod latency;
#[cfg(not(target_family = "wasm"))]
pub mod method;
pub mod metrics;
#[cfg(not(target_family = "wasm"))]
pub mod microcontrollers;
#[cfg(not(target_family = "wasm"))]
pub mod quality;
#[cfg(not(target_family = "wasm"))]
pub mod sweep;
#[cfg(not(target_family = "wasm"))]
pub mod trace;
