//! Sixteen sums of byte products: the vector on which the integer kernels are written.

/// Sixteen sums of 32 bits, one for each output of a panel.
///
/// # Safety
/// For every function: the machine runs the type's instruction set, and a pointer leads to sixteen values unless stated
/// otherwise. Each is inlined into an entry with that `target_feature`, as are all its callers.
pub(in crate::kernels) trait Sums: Copy {
    /// Sums in progress.
    type Partial: Copy;
    /// Four weights of each output.
    type Weights: Copy;
    /// Codes of one row, in the form that products take.
    type Codes: Copy;
    /// Whether sixteen codes are loaded at once, of which each product takes four.
    const BY_SIXTEEN: bool = false;

    unsafe fn zero() -> Self::Partial;
    /// 64 weights.
    unsafe fn load_weights(from: *const i8) -> Self::Weights;
    /// Loads four codes. If the machine multiplies signed bytes only, 128 is subtracted from codes of `EIGHT` bits; others stay
    /// as they are.
    unsafe fn load_four<const EIGHT: bool>(from: *const u8) -> Self::Codes;
    /// Loads sixteen codes, if they are loaded by sixteen.
    #[inline(always)]
    unsafe fn load_sixteen<const EIGHT: bool>(from: *const u8) -> Self::Codes {
        // SAFETY: as the caller guarantees.
        unsafe { Self::load_four::<EIGHT>(from) }
    }
    /// Adds the products with four codes: group `WHICH` of the loaded ones.
    unsafe fn add_products<const WHICH: i32>(
        sum: Self::Partial,
        w: Self::Weights,
        x: Self::Codes,
    ) -> Self::Partial;
    unsafe fn total(sum: Self::Partial) -> Self;
    /// What must be added to sums of `inputs` codes of eight bits with a panel's weights, to undo the subtraction.
    #[inline(always)]
    unsafe fn sign_correction(inputs: usize, weights: *const i8) -> Self {
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
    /// Writes the code of each sum, up to 255, by its [`crate::layer::Requantise`], whose bits are in `requantise`.
    unsafe fn store_codes(self, requantise: Self, to: *mut u8);
}
