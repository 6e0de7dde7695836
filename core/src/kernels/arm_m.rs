//! Kernels of Cortex-M, in assembly.

#[cfg(arm_kernels = "dsp")]
pub(super) mod dsp;
#[cfg(arm_kernels = "dsp")]
pub(super) mod dsp_near;
#[cfg(arm_kernels = "helium")]
pub(super) mod helium;
#[cfg(arm_kernels = "helium")]
pub(super) mod helium_near;

#[cfg(any(arm_kernels = "dsp", arm_kernels = "helium"))]
mod near;
