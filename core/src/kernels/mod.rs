//! Dense kernels, one file per target; the only place with `unsafe`.
//!
//! Three operations cover the network: a dense layer with ReLU over a tile of points, the last
//! embedding layer fused with the max over points (so that 1024 running maxima take the place of a
//! `[1024, N]` buffer), and a matrix-vector product for the heads. Weights come in panels of
//! [`PANEL`] outputs (see [`crate::weights`]); lanes are outputs, and sums run over the inputs in order.
//!
//! Kernels with fused multiply-add round once where the portable one rounds twice: they agree to
//! 1e-5, not bit by bit.

#![allow(unsafe_code, clippy::indexing_slicing)]

use crate::dims::PANEL;
use crate::weights::Dense;

mod nearest;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86_avx2;
#[cfg(target_arch = "x86_64")]
mod x86_avx512;

pub use nearest::Queries;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// A set of kernels that this machine is known to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Kind);

#[cfg(target_arch = "x86_64")]
cpufeatures::new!(has_avx2, "avx2", "fma");
#[cfg(target_arch = "x86_64")]
cpufeatures::new!(has_avx512, "avx512f");

impl Isa {
    /// The kernels that run everywhere.
    pub const PORTABLE: Isa = Isa(Kind::Portable);

    /// The fastest kernels of this machine.
    pub fn best() -> Isa {
        #[cfg(target_arch = "x86_64")]
        {
            if has_avx512::get() {
                return Isa(Kind::Avx512);
            }
            if has_avx2::get() {
                return Isa(Kind::Avx2);
            }
        }
        Isa::PORTABLE
    }

    /// AVX2 and FMA kernels, where the machine has them.
    #[cfg(target_arch = "x86_64")]
    pub fn avx2() -> Option<Isa> {
        has_avx2::get().then_some(Isa(Kind::Avx2))
    }

    /// AVX-512F kernels, where the machine has them.
    #[cfg(target_arch = "x86_64")]
    pub fn avx512() -> Option<Isa> {
        has_avx512::get().then_some(Isa(Kind::Avx512))
    }

    /// All kernels that this machine runs, the portable ones first.
    pub fn all() -> impl Iterator<Item = Isa> {
        #[cfg(target_arch = "x86_64")]
        let others = [Isa::avx2(), Isa::avx512()];
        #[cfg(not(target_arch = "x86_64"))]
        let others = [None];
        [Isa::PORTABLE]
            .into_iter()
            .chain(others.into_iter().flatten())
    }

    /// Name of the instruction set.
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2+fma",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512f",
        }
    }

    /// `y = max(0, W x + b)` for each row of `x`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `y [points, padded outputs]`; rows beyond either are left alone.
    pub fn dense_relu(self, layer: &Dense<'_>, x: &[f32], y: &mut [f32]) {
        let points = rows(layer, x).min(y.len() / layer.bias.len().max(1));
        match self.0 {
            Kind::Portable => portable::dense_relu(layer, points, x, y),
            // SAFETY: `Kind::Avx2` exists only where detection found AVX2 and FMA; `points` rows
            // of `x` and `y` are in bounds as counted above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { x86_avx2::dense_relu(layer, points, x, y) },
            // SAFETY: as above, with AVX-512F.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { x86_avx512::dense_relu(layer, points, x, y) },
        }
    }

    /// `max[o] = max(max[o], max over rows of (W x + b)[o])`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [padded outputs]`; a shorter `max` leaves everything as it is.
    pub fn dense_max(self, layer: &Dense<'_>, x: &[f32], max: &mut [f32]) {
        if max.len() < layer.bias.len() {
            return;
        }
        let points = rows(layer, x);
        match self.0 {
            Kind::Portable => portable::dense_max::<false>(layer, points, x, 0, max, &mut []),
            // SAFETY: features detected; `points` rows of `x` and all of `max` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe {
                x86_avx2::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe {
                x86_avx512::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
        }
    }

    /// As [`Isa::dense_max`], with `argmax[o]` set to the index of the row that raised `max[o]`
    /// last; rows count from `first`.
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
        if max.len() < layer.bias.len() || argmax.len() < layer.bias.len() {
            return;
        }
        let points = rows(layer, x);
        match self.0 {
            Kind::Portable => portable::dense_max::<true>(layer, points, x, first, max, argmax),
            // SAFETY: features detected; `points` rows of `x`, `max` and `argmax` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe {
                x86_avx2::dense_max::<true>(layer, points, x, first, max, argmax);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe {
                x86_avx512::dense_max::<true>(layer, points, x, first, max, argmax);
            },
        }
    }

    /// `y = start + W[:, from..from + len(x)] x`: a product with some of the layer's columns.
    ///
    /// # Shapes
    /// `start` and `y [padded outputs]`, `x [n]` with `from + n <= inputs`; other lengths leave `y`
    /// as it is.
    pub fn gemv(self, layer: &Dense<'_>, start: &[f32], from: usize, x: &[f32], y: &mut [f32]) {
        let outputs = layer.bias.len();
        if y.len() < outputs || start.len() < outputs || from + x.len() > layer.inputs {
            return;
        }
        match self.0 {
            Kind::Portable => portable::gemv(layer, start, from, x, y),
            // SAFETY: features detected; lengths checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { x86_avx2::gemv(layer, start, from, x, y) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { x86_avx512::gemv(layer, start, from, x, y) },
        }
    }

    /// Squared distance from each query to the nearest of `others`, infinite where there is none.
    /// The same bits on every kernel.
    pub fn nearest_squared(self, queries: &mut Queries, others: &[[f32; 3]]) {
        match self.0 {
            Kind::Portable => nearest::portable::<16>(queries, others),
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { nearest::avx2(queries, others) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { nearest::avx512(queries, others) },
        }
    }
}

/// Whole rows in `x`; zero where the layer's arrays do not have their padded lengths.
fn rows(layer: &Dense<'_>, x: &[f32]) -> usize {
    let whole = layer.bias.len().is_multiple_of(PANEL)
        && layer.panels.len() == layer.inputs * layer.bias.len();
    if whole && layer.inputs > 0 {
        x.len() / layer.inputs
    } else {
        0
    }
}

#[cfg(test)]
mod tests;
