//! What a registration costs in RAM, flash and time, and what it may cost: asserted at compile time.

use crate::dims::STEPS;
use crate::shape::Shape;
use crate::weights::{FORMAT_INT8, file_len};

/// RAM of [`crate::net::Scratch`], bytes.
pub const SCRATCH_BYTES: usize = core::mem::size_of::<crate::net::Scratch>();
/// RAM of [`crate::register::Registration`], bytes.
pub const REGISTRATION_BYTES: usize = core::mem::size_of::<crate::register::Registration<'_>>();
/// RAM of two clouds of the paper's 1024 points, bytes.
pub const CLOUD_BYTES: usize = 2 * 1024 * 3 * core::mem::size_of::<f32>();
/// RAM of the same clouds on a grid of 16-bit codes ([`crate::cloud::Cloud::Grid`]), bytes.
pub const GRID_CLOUD_BYTES: usize = 2 * 1024 * 3 * core::mem::size_of::<i16>();
/// Flash of a policy of the largest shape in 8-bit integers, bytes.
pub const POLICY_BYTES: usize = file_len(&Shape::FULL, FORMAT_INT8);
/// Flash of a policy of the compact shape in 8-bit integers, bytes.
pub const COMPACT_POLICY_BYTES: usize = file_len(&Shape::COMPACT, FORMAT_INT8);

/// Most RAM besides the policy for two clouds of 1024 points on a microcontroller, stack included, bytes. It holds tiles of
/// sixteen points, which share bounds: with eight, it took 2 KiB less, and a registration twice as long.
pub const RAM_BUDGET: usize = 50 * 1024;
/// The same for clouds on a grid of 16-bit codes, bytes.
pub const GRID_RAM_BUDGET: usize = RAM_BUDGET - (CLOUD_BYTES - GRID_CLOUD_BYTES);
/// Part of both budgets left for frames on the line and the rest of the stack, bytes.
pub const RAM_REST: usize = 8 * 1024 + 512;
/// Part of both budgets that the stack may take, bytes; the simulated boards reserve it.
pub const STACK_BUDGET: usize = 13 * 1024 + 768;
/// Most flash of a policy in 8-bit integers, bytes.
pub const FLASH_BUDGET: usize = 2_700_000;
/// Most flash that this library adds to a microcontroller's program, constants included, bytes.
pub const CODE_BUDGET: usize = 41 * 1024;
/// Most flash of a policy of the compact shape in 8-bit integers, bytes.
pub const COMPACT_FLASH_BUDGET: usize = 256 * 1024;

/// Multiply-adds of a registration of two clouds of 1024 points in [`STEPS`] steps that look at all points.
pub const MULTIPLY_ADDS: u64 = Shape::FULL.macs_registration(1024, STEPS);
/// The same of the compact shape.
pub const COMPACT_MULTIPLY_ADDS: u64 = Shape::COMPACT.macs_registration(1024, STEPS);
/// Upper bound on [`MULTIPLY_ADDS`].
pub const MULTIPLY_ADD_BUDGET: u64 = 1_650_000_000;
/// Upper bound on [`COMPACT_MULTIPLY_ADDS`].
pub const COMPACT_MULTIPLY_ADD_BUDGET: u64 = 330_000_000;
/// Most instructions of a Cortex-M7 with DSP for each multiply-add of the embedding, for the largest shape in 8-bit integers
/// and an ordered cloud; simulated, not measured on silicon.
pub const CORTEX_M7_INSTRUCTION_BUDGET: f64 = 0.6;
/// The same for a Cortex-M55 with Helium.
pub const CORTEX_M55_INSTRUCTION_BUDGET: f64 = 0.15;

/// RAM of [`crate::polish::Workspace`], bytes; needed only for refinement.
pub const WORKSPACE_BYTES: usize = core::mem::size_of::<crate::polish::Workspace>();
/// Most RAM of a microcontroller that refines poses and compares them
/// with others, with two clouds of 1024 points and the stack, bytes.
pub const REFINEMENT_RAM_BUDGET: usize = 312 * 1024;
/// Part of it that the stack may take, bytes; the simulated boards reserve it.
pub const REFINEMENT_STACK_BUDGET: usize = 51 * 1024;
/// Most flash of such a program, frames and serial line included, bytes.
pub const REFINEMENT_CODE_BUDGET: usize = 187 * 1024;
/// Most instructions of a Cortex-M7 to prepare a target of 1024 points, to refine a pose on it, and to compare that pose with
/// others; simulated, not measured on silicon.
pub const CORTEX_M7_REFINEMENT_BUDGET: [u64; 3] = [70_000_000, 90_000_000, 620_000_000];
/// The same for a Cortex-M55.
pub const CORTEX_M55_REFINEMENT_BUDGET: [u64; 3] = [75_000_000, 95_000_000, 680_000_000];
/// RAM or flash of [`crate::model::Model`], bytes; needed only for several targets in use at a time.
pub const MODEL_BYTES: usize = core::mem::size_of::<crate::model::Model>();

const _: () = assert!(SCRATCH_BYTES < 96 * 1024);
const _: () = assert!(POLICY_BYTES <= FLASH_BUDGET);
const _: () = assert!(COMPACT_POLICY_BYTES <= COMPACT_FLASH_BUDGET);
const _: () = assert!(MULTIPLY_ADDS <= MULTIPLY_ADD_BUDGET);
const _: () = assert!(COMPACT_MULTIPLY_ADDS <= COMPACT_MULTIPLY_ADD_BUDGET);
// Hosts have larger tiles.
const _: () = assert!(
    !cfg!(target_os = "none")
        || SCRATCH_BYTES + REGISTRATION_BYTES + CLOUD_BYTES + RAM_REST <= RAM_BUDGET
);
const _: () = assert!(WORKSPACE_BYTES < 237 * 1024);
const _: () =
    assert!(WORKSPACE_BYTES + CLOUD_BYTES + REFINEMENT_STACK_BUDGET <= REFINEMENT_RAM_BUDGET);
const _: () = assert!(MODEL_BYTES < 116 * 1024);
