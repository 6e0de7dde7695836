//! Layers in f32, dispatched to the machine's kernels.

#![allow(unsafe_code)]

#[cfg(any(arm_kernels = "neon", target_arch = "x86_64"))]
pub(super) mod dense;
pub(super) mod packed;
mod portable;
#[cfg(any(arm_kernels = "neon", target_arch = "x86_64"))]
pub(super) mod pruned;
pub(super) mod sieve;
pub(super) mod split;
#[cfg(any(arm_kernels = "neon", target_arch = "x86_64"))]
pub(super) mod vector;

#[cfg(arm_kernels = "neon")]
use super::aarch64::neon;
#[cfg(target_arch = "x86_64")]
use super::x86::{avx2, avx512};
use super::{Floats, Isa, rows};
use crate::layer::Dense;

impl Isa {
    /// `y = max(0, W x + b)` for each row of `x`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `y [points, padded outputs]`; rows beyond either are left alone.
    pub fn dense_relu(self, layer: &Dense<'_>, x: &[f32], y: &mut [f32]) {
        let points = rows(layer, x).min(y.len().checked_div(layer.width()).unwrap_or(0));
        match self.floats() {
            // SAFETY: `Kind::Avx2` exists only where detection found AVX2 and FMA; `points` rows
            // of `x` and `y` are in bounds as counted above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe { avx2::dense_relu(layer, points, x, y) },
            // SAFETY: as above, with AVX-512F.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe { avx512::dense_relu(layer, points, x, y) },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Floats::Neon => unsafe { neon::dense_relu(layer, points, x, y) },
            Floats::Portable => portable::dense_relu(layer, points, x, y),
        }
    }

    /// `max[o] = max(max[o], max over rows of (W x + b)[o])`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [padded outputs]`; a shorter `max` is left unchanged.
    pub fn dense_max(self, layer: &Dense<'_>, x: &[f32], max: &mut [f32]) {
        if max.len() < layer.width() {
            return;
        }
        let points = rows(layer, x);
        match self.floats() {
            // SAFETY: features detected; `points` rows of `x` and all of `max` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe {
                avx2::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe {
                avx512::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Floats::Neon => unsafe {
                neon::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
            Floats::Portable => portable::dense_max::<false>(layer, points, x, 0, max, &mut []),
        }
    }

    /// Whether [`Isa::dense_max_near`] runs faster on points in spatial order.
    pub(crate) fn prunes_floats(self) -> bool {
        self.floats() != Floats::Portable
    }

    /// As [`Isa::dense_max`], but faster if consecutive points lie close together: it skips sums that cannot raise a maximum.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [padded outputs]`; a shorter `max` is left unchanged.
    pub fn dense_max_near(self, layer: &Dense<'_>, x: &[f32], max: &mut [f32]) {
        let outputs = layer.width();
        if max.len() < outputs || !super::pruned::fits(layer.inputs(), outputs) {
            return self.dense_max(layer, x, max);
        }
        match self.floats() {
            // SAFETY: features detected; `points` rows of `x` and all of `max` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe {
                avx512::dense_max_near(layer, rows(layer, x), x, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe {
                avx2::dense_max_near(layer, rows(layer, x), x, max);
            },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Floats::Neon => unsafe {
                neon::dense_max_near(layer, rows(layer, x), x, max);
            },
            Floats::Portable => self.dense_max(layer, x, max),
        }
    }

    /// As [`Isa::dense_max`], and sets `argmax[o]` to the number of the
    /// row that last raised `max[o]`; rows are numbered from `first`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max` and `argmax [padded outputs]`.
    pub fn dense_argmax(
        self,
        layer: &Dense<'_>,
        x: &[f32],
        first: u32,
        max: &mut [f32],
        argmax: &mut [u32],
    ) {
        if max.len() < layer.width() || argmax.len() < layer.width() {
            return;
        }
        let points = rows(layer, x);
        match self.floats() {
            // SAFETY: features detected; `points` rows of `x`, `max` and `argmax` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe {
                avx2::dense_max::<true>(layer, points, x, first, max, argmax);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe {
                avx512::dense_max::<true>(layer, points, x, first, max, argmax);
            },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Floats::Neon => unsafe {
                neon::dense_max::<true>(layer, points, x, first, max, argmax);
            },
            Floats::Portable => portable::dense_max::<true>(layer, points, x, first, max, argmax),
        }
    }

    /// `y = start + W[:, from..from + len(x)] x`: the product with some columns of the layer.
    ///
    /// # Shapes
    /// `start` and `y [padded outputs]`, `x [n]` with `from + n <= inputs`; other lengths leave `y`
    /// as it is.
    pub fn gemv(self, layer: &Dense<'_>, start: &[f32], from: usize, x: &[f32], y: &mut [f32]) {
        let outputs = layer.width();
        let end = from.checked_add(x.len());
        let beyond = end.is_none_or(|end| end > layer.inputs());
        if y.len() < outputs || start.len() < outputs || beyond {
            return;
        }
        match self.floats() {
            // SAFETY: features detected; lengths checked above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe { avx2::gemv(layer, start, from, x, y) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe { avx512::gemv(layer, start, from, x, y) },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Floats::Neon => unsafe { neon::gemv(layer, start, from, x, y) },
            Floats::Portable => portable::gemv(layer, start, from, x, y),
        }
    }
}
