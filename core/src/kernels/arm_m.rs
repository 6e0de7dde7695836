//! Kernels of Cortex-M, in assembly.

#[cfg(arm_kernels = "dsp")]
pub(super) mod dsp;
#[cfg(arm_kernels = "helium")]
pub(super) mod helium;
