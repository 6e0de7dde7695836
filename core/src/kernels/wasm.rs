//! Kernels of wasm32 with simd128.

pub(super) mod bytes;
