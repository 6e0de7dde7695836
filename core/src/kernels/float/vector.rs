//! Sixteen values in registers: the vector on which the f32 kernels are written.

use crate::kernels::pruned::Survivors;

/// Sixteen f32 values: a panel's outputs, or a group's points.
///
/// # Safety
/// For every function: the machine runs the type's instruction set, and a pointer leads to sixteen values unless stated
/// otherwise. Each is inlined into an entry with that `target_feature`, as are all its callers.
pub(in crate::kernels) trait Vector: Copy {
    /// Sixteen row numbers.
    type Rows: Copy;
    /// [`Vector::INPUTS`] inputs of one point, in the form that products take.
    type Inputs: Copy;
    /// Number of inputs loaded at once: one or four.
    const INPUTS: usize;

    unsafe fn splat(value: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    unsafe fn load_rows(from: *const u32) -> Self::Rows;
    unsafe fn store_rows(rows: Self::Rows, to: *mut u32);

    /// `self + a b`, rounded once.
    unsafe fn add_product(self, a: Self, b: Self) -> Self;
    /// The larger of each pair. If either is NaN: `other` on x86, NaN on NEON.
    unsafe fn max(self, other: Self) -> Self;
    /// The larger of `self` and `sum`, and `row` in place of `rows` where that is `sum`.
    unsafe fn keep_higher(self, rows: Self::Rows, sum: Self, row: u32) -> (Self, Self::Rows);

    /// Loads [`Vector::INPUTS`] inputs.
    unsafe fn load_inputs(from: *const f32) -> Self::Inputs;
    /// `self + w x`, with input `WHICH` of the loaded ones.
    unsafe fn add_input<const WHICH: i32>(self, w: Self, x: Self::Inputs) -> Self;

    /// `low` where `self` is negative, `high` elsewhere.
    unsafe fn extreme(self, high: Self, low: Self) -> Self;
    /// A bit for each value that is not less than or equal to `other`'s, NaN included.
    unsafe fn exceeds(self, other: Self) -> u16;
    /// Raises `max` to the largest value.
    unsafe fn raise(self, max: &mut f32);

    /// Adds the channels of a panel whose bit is set in `mask`.
    #[inline(always)]
    unsafe fn add_channels(panel: usize, mask: u16, survivors: &mut Survivors) {
        survivors.add_of(panel, mask);
    }
}
