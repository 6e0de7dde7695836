//! Sizes of the largest network and of the protocol, checked against
//! each other at compile time; their sums are in [`crate::budget`].

/// Widths of the pointwise embedding layers, 3 -> 64 -> 128 -> 1024 (paper, implementation details).
pub const EMBED: [usize; 3] = [64, 128, 1024];
/// Length of one cloud's global feature vector.
pub const FEATURES: usize = EMBED[2];
/// Length of the state: feature of the source, then feature of the target.
pub const STATE: usize = 2 * FEATURES;
/// Hidden widths of each policy head.
pub const HEAD: [usize; 2] = [512, 256];
/// Axes of one action vector (x, y, z).
pub const AXES: usize = 3;
/// Step sizes an axis can take: five magnitudes, both signs, and stop.
pub const STEP_SIZES: usize = 11;
/// Logits of one head, axis-major: x's 11, y's 11, z's 11.
pub const LOGITS: usize = AXES * STEP_SIZES;
/// Refinement steps of one registration, `n` in the paper.
pub const STEPS: usize = 10;
/// First steps that look one way only, under a policy that later looks both ways ([`crate::Decision::BothWays`]).
pub const STEPS_ONE_WAY: usize = 4;

/// Fewest points that fix a rigid transform.
pub const MIN_POINTS: usize = 3;
/// Most points in one cloud; bounds the time of one step.
pub const MAX_POINTS: usize = 4096;

/// Points of each cloud that polishing and verification use; larger clouds are thinned evenly.
pub const SURFACE_POINTS: usize = 2048;

/// Outputs in one block of a weight matrix; the file stores `[outputs / PANEL][inputs][PANEL]`.
pub const PANEL: usize = 16;
/// Rows of 8-bit codes are padded with zeros to a multiple of this.
pub const CODES: usize = 64;
/// Adjacent input codes of one output: one lane of a dot-product instruction.
pub(crate) const QUAD: usize = 4;
/// Points whose hidden activations are held at once: the tile fits a host's L1 cache, and a microcontroller's few KiB.
pub const TILE: usize = if HOST { 48 } else { 4 };

/// Panels of a head's layer applied at a time to several registrations: half a MiB in f32.
pub(crate) const PANELS_TOGETHER: usize = 8;

/// Panels of an integer layer taken at a time when the rows of its maxima are recorded.
pub(crate) const PANELS_MARKED: usize = if HOST { 8 } else { 2 };

/// Points whose 8-bit codes are held at once.
pub const QUANT_TILE: usize = if HOST { 192 } else { 16 };

/// Heads for which a registration caches the target's share of the first layer; without the memory, every step computes it.
pub(crate) const TARGETS_KEPT: usize = if HOST { 2 } else { 0 };

/// Points for whose order a registration has room.
pub(crate) const POINTS_ORDERED: usize = if HOST { MAX_POINTS } else { 0 };

/// Whether there is memory for large tiles.
const HOST: bool = cfg!(any(
    target_arch = "x86_64",
    target_arch = "aarch64",
    target_arch = "wasm32"
));

/// Layers of a policy file: three of the embedding, three of each head.
pub const LAYERS: usize = 9;

/// Outputs rounded up to whole panels.
pub const fn padded(outputs: usize) -> usize {
    outputs.div_ceil(PANEL) * PANEL
}

const _: () = assert!(FEATURES.is_multiple_of(PANEL) && HEAD[0].is_multiple_of(PANEL));
const _: () = assert!(SURFACE_POINTS <= MAX_POINTS && SURFACE_POINTS.is_multiple_of(64));
