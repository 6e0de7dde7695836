//! The last embedding layer in f32, packed for fast machines into memory that the caller gives: as parts of bf16
//! ([`super::split`]) if there are tiles for them, behind an integer sieve ([`super::sieve`]) if integers are fast.

#![allow(unsafe_code)]

use super::sieve::{self, SieveDense};
use super::split::{self, SplitDense, Tile};
use crate::kernels::Isa;
#[cfg(target_arch = "x86_64")]
use crate::kernels::{
    Kind, rows,
    x86::{amx_split, avx512_vnni_sieve},
};
use crate::layer::Dense;

/// A layer in f32, with its packed form.
#[derive(Clone, Copy, Debug)]
pub enum PackedDense<'a> {
    /// Split into parts of bf16.
    Split(SplitDense<'a>),
    /// Behind a sieve.
    Sieve(SieveDense<'a>),
}

impl<'a> PackedDense<'a> {
    /// Tiles of memory that packing a layer takes for some kernels; `None` if they gain nothing from it.
    pub fn tiles(isa: Isa, layer: &Dense<'_>) -> Option<usize> {
        if isa.has_fast_splits() {
            split::packed_tiles(layer)
        } else if isa.has_fast_sieves() {
            sieve::packed_tiles(layer)
        } else {
            None
        }
    }

    /// Fills [`PackedDense::tiles`] tiles.
    pub fn pack(isa: Isa, layer: &Dense<'_>, memory: &mut [Tile]) {
        if isa.has_fast_splits() {
            split::pack(layer, memory);
        } else {
            sieve::pack(layer, memory);
        }
    }

    /// The layer with memory that [`PackedDense::pack`] filled from it for these kernels; `None` for another length.
    pub fn new(isa: Isa, layer: &Dense<'a>, packed: &'a [Tile]) -> Option<Self> {
        if isa.has_fast_splits() {
            SplitDense::new(layer, packed).map(PackedDense::Split)
        } else {
            SieveDense::new(layer, packed).map(PackedDense::Sieve)
        }
    }

    /// Whether these kernels gain from it.
    pub fn is_fast(&self, isa: Isa) -> bool {
        match self {
            PackedDense::Split(_) => isa.has_fast_splits(),
            PackedDense::Sieve(_) => isa.has_fast_sieves(),
        }
    }
}

impl Isa {
    /// Whether bf16 tiles are fast here: then splitting a layer is worthwhile.
    pub fn has_fast_splits(self) -> bool {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Amx => true,
            _ => false,
        }
    }

    /// Whether integers are much faster than floats here and there are no tiles: then a sieve is worth its memory.
    pub fn has_fast_sieves(self) -> bool {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => true,
            _ => false,
        }
    }

    /// As [`Isa::dense_max`], for activations that are not negative; no faster if [`PackedDense::is_fast`] is false.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; a shorter `max` is left unchanged.
    pub fn dense_max_packed(self, layer: &PackedDense<'_>, x: &[f32], max: &mut [f32]) {
        match layer {
            PackedDense::Split(layer) => self.dense_max_split(layer, x, max),
            PackedDense::Sieve(layer) => self.dense_max_sieve(layer, x, max),
        }
    }
    /// As [`Isa::dense_max`]; the same if [`Isa::has_fast_splits`] is false.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; a shorter `max` is left unchanged.
    pub fn dense_max_split(self, split: &SplitDense<'_>, x: &[f32], max: &mut [f32]) {
        if max.len() < split.layer.width() {
            return;
        }
        match self.0 {
            // SAFETY: the instruction set was detected, lengths were checked above and when packed.
            #[cfg(target_arch = "x86_64")]
            Kind::Amx => unsafe { amx_split::dense_max(split, x, max) },
            _ => self.dense_max(&split.layer, x, max),
        }
    }

    /// As [`Isa::dense_max_near`] but for rounding, for activations that are not negative; the same if [`Isa::has_fast_sieves`]
    /// is false.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; a shorter `max` is left unchanged.
    pub fn dense_max_sieve(self, sieve: &SieveDense<'_>, x: &[f32], max: &mut [f32]) {
        if max.len() < sieve.layer.width() {
            return;
        }
        match self.0 {
            // SAFETY: the instruction set was detected, lengths were checked above and when packed.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => unsafe {
                avx512_vnni_sieve::dense_max(sieve, rows(&sieve.layer, x), x, max);
            },
            _ => self.dense_max_near(&sieve.layer, x, max),
        }
    }
}
