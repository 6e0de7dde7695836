//! Kernels of aarch64.

pub(super) mod bytes;
pub(super) mod detect;
pub(super) mod neon;
