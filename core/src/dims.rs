//! Every size of the largest network and of the protocol, checked against each other at compile time.

use crate::shape::Shape;
use crate::weights::{FORMAT_INT8, file_len};

/// Widths of the pointwise embedding layers, 3 -> 64 -> 128 -> 1024 (paper, implementation details).
pub const EMBED: [usize; 3] = Shape::FULL.embed;
/// Length of one cloud's global feature vector.
pub const FEATURES: usize = EMBED[2];
/// Length of the state: feature of the source, then feature of the target.
pub const STATE: usize = 2 * FEATURES;
/// Hidden widths of each policy head.
pub const HEAD: [usize; 2] = Shape::FULL.head;
/// Axes of one action vector (x, y, z).
pub const AXES: usize = 3;
/// Step sizes an axis can take: five magnitudes, both signs, and stop.
pub const STEP_SIZES: usize = 11;
/// Logits of one head, axis-major: x's 11, y's 11, z's 11.
pub const LOGITS: usize = AXES * STEP_SIZES;
/// Refinement steps of one registration, `n` in the paper.
pub const STEPS: usize = 10;
/// Steps before those in which a policy that decides so looks both ways ([`crate::Decision::BothWays`]).
pub const STEPS_ONE_WAY: usize = 4;

/// Fewest points that fix a rigid transform.
pub const MIN_POINTS: usize = 3;
/// Most points in one cloud; bounds the time of one step.
pub const MAX_POINTS: usize = 4096;

/// Points of each cloud that polishing and verification use; larger clouds are thinned evenly.
pub const SURFACE_POINTS: usize = 2048;

/// Outputs that share one block of a weight matrix: the file stores `[outputs / PANEL][inputs][PANEL]`.
pub const PANEL: usize = 16;
/// Points whose hidden activations are held at once: the tile stays in the L1 cache of a host and in
/// the few KiB of a microcontroller.
pub const TILE: usize = if HOST { 48 } else { 4 };

/// Panels of a head's layer that several registrations in step take at a time: half a MiB in f32.
pub(crate) const PANELS_TOGETHER: usize = 8;

/// Points whose 8-bit codes are held at once.
pub const QUANT_TILE: usize = if HOST { 192 } else { 8 };

/// Heads for which a registration keeps what its target adds to their first layer; where memory is short it is
/// computed in every step.
pub(crate) const TARGETS_KEPT: usize = if HOST { 2 } else { 0 };

/// Points for whose order there is room in a registration.
pub(crate) const POINTS_ORDERED: usize = if HOST { MAX_POINTS } else { 0 };

/// Whether there is memory for large tiles.
const HOST: bool = cfg!(any(target_arch = "x86_64", target_arch = "aarch64"));

/// Layers of a policy file: three of the embedding, three of each head.
pub const LAYERS: usize = 9;

/// Outputs rounded up to whole panels.
pub const fn padded(outputs: usize) -> usize {
    outputs.div_ceil(PANEL) * PANEL
}

/// RAM of [`crate::net::Scratch`], bytes.
pub const SCRATCH_BYTES: usize = core::mem::size_of::<crate::net::Scratch>();
/// RAM of [`crate::register::Registration`], bytes.
pub const REGISTRATION_BYTES: usize = core::mem::size_of::<crate::register::Registration<'_>>();
/// RAM of two clouds of the paper's 1024 points, bytes.
pub const CLOUD_BYTES: usize = 2 * 1024 * 3 * core::mem::size_of::<f32>();
/// RAM of the same on a grid of 16-bit codes ([`crate::cloud::Cloud::Grid`]), bytes.
pub const GRID_CLOUD_BYTES: usize = 2 * 1024 * 3 * core::mem::size_of::<i16>();
/// Flash of a policy of the largest shape in 8-bit integers, bytes.
pub const POLICY_BYTES: usize = file_len(&Shape::FULL, FORMAT_INT8);
/// Flash of a policy of the compact shape in 8-bit integers, bytes.
pub const COMPACT_POLICY_BYTES: usize = file_len(&Shape::COMPACT, FORMAT_INT8);

/// Most RAM beyond the policy for two clouds of 1024 points on a microcontroller, stack included, bytes.
pub const RAM_BUDGET: usize = 48 * 1024;
/// The same where the clouds are on a grid of 16-bit codes, bytes.
pub const GRID_RAM_BUDGET: usize = RAM_BUDGET - (CLOUD_BYTES - GRID_CLOUD_BYTES);
/// Of both, what is left for frames on the line and the rest of the stack.
pub const RAM_REST: usize = 8 * 1024 + 512;
/// Of both, what the stack may take, bytes: the simulated boards reserve it.
pub const STACK_BUDGET: usize = 13 * 1024;
/// Most flash of a policy in 8-bit integers, bytes.
pub const FLASH_BUDGET: usize = 2_700_000;
/// Most flash that this library adds to a program for a microcontroller, its constants included, bytes.
pub const CODE_BUDGET: usize = 40 * 1024;
/// Most flash of a policy of the compact shape in 8-bit integers, bytes.
pub const COMPACT_FLASH_BUDGET: usize = 256 * 1024;

/// Multiply-adds of a registration of two clouds of 1024 points in [`STEPS`] steps that all look at all points.
pub const MULTIPLY_ADDS: u64 = Shape::FULL.macs_registration(1024, STEPS);
/// The same of the compact shape.
pub const COMPACT_MULTIPLY_ADDS: u64 = Shape::COMPACT.macs_registration(1024, STEPS);
/// Most of [`MULTIPLY_ADDS`].
pub const MULTIPLY_ADD_BUDGET: u64 = 1_650_000_000;
/// Most of [`COMPACT_MULTIPLY_ADDS`].
pub const COMPACT_MULTIPLY_ADD_BUDGET: u64 = 330_000_000;
/// Most instructions of a Cortex-M7, with DSP, for a multiply-add of the embedding of the largest shape in 8-bit
/// integers; simulated, not silicon.
pub const CORTEX_M7_INSTRUCTION_BUDGET: f64 = 1.2;
/// The same of a Cortex-M55, with Helium.
pub const CORTEX_M55_INSTRUCTION_BUDGET: f64 = 0.25;

/// RAM of [`crate::polish::Workspace`], bytes: only for who polishes.
pub const WORKSPACE_BYTES: usize = core::mem::size_of::<crate::polish::Workspace>();

const _: () = assert!(FEATURES.is_multiple_of(PANEL) && HEAD[0].is_multiple_of(PANEL));
const _: () = assert!(SCRATCH_BYTES < 96 * 1024);
const _: () = assert!(POLICY_BYTES <= FLASH_BUDGET);
const _: () = assert!(COMPACT_POLICY_BYTES <= COMPACT_FLASH_BUDGET);
const _: () = assert!(MULTIPLY_ADDS <= MULTIPLY_ADD_BUDGET);
const _: () = assert!(COMPACT_MULTIPLY_ADDS <= COMPACT_MULTIPLY_ADD_BUDGET);
// The tiles of hosts are larger.
const _: () = assert!(
    !cfg!(target_os = "none")
        || SCRATCH_BYTES + REGISTRATION_BYTES + CLOUD_BYTES + RAM_REST <= RAM_BUDGET
);
const _: () = assert!(WORKSPACE_BYTES < 192 * 1024);
const _: () = assert!(SURFACE_POINTS <= MAX_POINTS && SURFACE_POINTS.is_multiple_of(64));
