//! Sixteen sums of products of bytes: the vector that the kernels in integers are written on.

/// Sixteen sums of 32 bits: those of a panel's outputs.
///
/// # Safety
/// Of every function: the machine runs the instruction set of the type, and a pointer leads to sixteen values where nothing
/// else is said. Each is inlined into an entry of that `target_feature`, as all that calls it is.
pub(in crate::kernels) trait Sums: Copy {
    /// Sums under way.
    type Partial: Copy;
    /// Four weights of each output.
    type Weights: Copy;
    /// Codes of one row, as products take them.
    type Codes: Copy;
    /// Whether codes are loaded by sixteen, of which products take four.
    const BY_SIXTEEN: bool = false;

    unsafe fn zero() -> Self::Partial;
    /// 64 weights.
    unsafe fn load_weights(from: *const i8) -> Self::Weights;
    /// Four codes. Where the machine multiplies signed bytes only, codes of `EIGHT` bits are taken less 128, others as they are.
    unsafe fn load_four<const EIGHT: bool>(from: *const u8) -> Self::Codes;
    /// Sixteen codes, where they are loaded so.
    #[inline(always)]
    unsafe fn load_sixteen<const EIGHT: bool>(from: *const u8) -> Self::Codes {
        // SAFETY: as the caller guarantees.
        unsafe { Self::load_four::<EIGHT>(from) }
    }
    /// Adds the products with four codes: group `WHICH` of those that were loaded.
    unsafe fn add_products<const WHICH: i32>(
        sum: Self::Partial,
        w: Self::Weights,
        x: Self::Codes,
    ) -> Self::Partial;
    unsafe fn total(sum: Self::Partial) -> Self;
    /// What the sums of `inputs` codes of eight bits lack, with a panel's weights.
    #[inline(always)]
    unsafe fn lacking(inputs: usize, weights: *const i8) -> Self {
        let _ = (inputs, weights);
        // SAFETY: as the caller guarantees.
        unsafe { Self::splat(0) }
    }

    unsafe fn splat(value: i32) -> Self;
    unsafe fn load(from: *const i32) -> Self;
    unsafe fn store(self, to: *mut i32);
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn max(self, other: Self) -> Self;
    unsafe fn shift_left<const BITS: i32>(self) -> Self;
    /// Writes the codes of sums, up to 255: [`crate::layer::Requantise`] of each, whose bits are in `requantise`.
    unsafe fn store_codes(self, requantise: Self, to: *mut u8);
}
