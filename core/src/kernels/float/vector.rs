//! Sixteen values in registers: the vector that the kernels in f32 are written on.

use crate::kernels::pruned::Survivors;

/// Sixteen values of f32: a panel's outputs, or a group's points.
///
/// # Safety
/// Of every function: the machine runs the instruction set of the type, and a pointer leads to sixteen values where nothing
/// else is said. Each is inlined into an entry of that `target_feature`, as all that calls it is.
pub(in crate::kernels) trait Vector: Copy {
    /// Sixteen row numbers.
    type Rows: Copy;
    /// [`Vector::INPUTS`] inputs of one point, as products take them.
    type Inputs: Copy;
    /// How many inputs are loaded at once: one or four.
    const INPUTS: usize;

    unsafe fn splat(value: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    unsafe fn load_rows(from: *const u32) -> Self::Rows;
    unsafe fn store_rows(rows: Self::Rows, to: *mut u32);

    /// `self + a b`, rounded once.
    unsafe fn add_product(self, a: Self, b: Self) -> Self;
    /// The larger of each two; `other` where one is no number and the processor does not say so.
    unsafe fn max(self, other: Self) -> Self;
    /// `self`, and `sum` in `row` where that is larger.
    unsafe fn keep_higher(self, rows: Self::Rows, sum: Self, row: u32) -> (Self, Self::Rows);

    /// [`Vector::INPUTS`] inputs at `from`.
    unsafe fn load_inputs(from: *const f32) -> Self::Inputs;
    /// `self + w x`, with one of the inputs.
    unsafe fn add_input<const WHICH: i32>(self, w: Self, x: Self::Inputs) -> Self;

    /// `low` where `self` is negative, else `high`.
    unsafe fn extreme(self, high: Self, low: Self) -> Self;
    /// A bit for each value that is not at most `other`'s.
    unsafe fn exceeds(self, other: Self) -> u16;
    /// Raises `max` to the largest value.
    unsafe fn raise(self, max: &mut f32);

    /// Adds the channels of a panel that a mask tells.
    #[inline(always)]
    unsafe fn add_channels(panel: usize, mask: u16, survivors: &mut Survivors) {
        survivors.add_of(panel, mask);
    }
}
