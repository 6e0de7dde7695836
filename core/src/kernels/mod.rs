//! Kernels of the machine. No other module of this crate has `unsafe` code. Around the crate, the C interface (`core/capi`) and
//! the microcontroller images have some, for pointers and for starting a board.
//!
//! An algorithm is written once, on a vector of sixteen values (`float`, `byte`). An instruction set (`x86`, `aarch64`, `wasm`)
//! defines such a vector and thin entries with its `target_feature`, into which all the rest is inlined. Code for one
//! instruction set alone is there too, and in `arm_m`.
//!
//! - **Network in f32** (`float`): a dense layer with ReLU over a tile of points, the last embedding layer fused with
//!   the max over points (so that 1024 running maxima take the place of a `[1024, N]` buffer), and a matrix-vector
//!   product for the heads. Weights come in panels of [`crate::dims::PANEL`] outputs (see [`crate::layer`]); lanes are outputs,
//!   and sums run over the inputs in order.
//! - **Network in integers** (`byte`): points to codes, and the same three on codes; [`crate::quant`] defines the numbers.
//! - **Training** (`critical`): the search for critical points in bytes, and the gradient through them.
//! - **Refinement** (on `lanes`): nearest points in boxes (`matching`), plane fits over neighbours (`neighbours`), normal
//!   equations of matched points (`equations`), their losses (`losses`), steps and losses on few points in a grid (`coarse`),
//!   similar pairs of points (`alike`).
//! - **Metrics**: distances to the nearest points (`nearest`).
//! - **Measurement** (`peak`): multiply-adds on registers, at the core's peak.
//!
//! If a machine multiplies bf16 in tiles (AMX), the last embedding layer may be split into parts of bf16 ([`SplitDense`]): the
//! numbers of f32 in about 60 % of the time. If it multiplies bytes fast, they rule out most sums in f32 ([`SieveDense`]). Both
//! take memory ([`PackedDense`]).
//!
//! Kernels with fused multiply-add round once where the portable one rounds twice: they agree to 1e-5, not to the bit. Integer
//! kernels agree to the bit.
//!
//! On x86-64 and aarch64 the instruction set is detected at run time. On Cortex-M the compiler decides: `thumbv7em` targets
//! (and `-C target-cpu=cortex-m33`) use the DSP kernels; `-C target-cpu=cortex-m55`, `cortex-m52` or `cortex-m85` use the
//! Helium kernels. So it does on wasm32, with `-C target-feature=+simd128`.

#![allow(unsafe_code, clippy::indexing_slicing)]

use crate::layer::Dense;

#[cfg(arm_kernels = "neon")]
mod aarch64;
mod alike;
#[cfg(any(arm_kernels = "dsp", arm_kernels = "helium"))]
mod arm_m;
mod boxes;
mod byte;
mod coarse;
mod critical;
mod equations;
mod float;
mod hidden;
mod lanes;
mod losses;
mod matching;
mod nearest;
mod neighbours;
mod on_lanes;
mod oriented;
mod peak;
mod pruned;
mod search;
#[cfg(wasm_kernels = "simd128")]
mod wasm;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(arm_kernels = "neon")]
use aarch64::detect;
#[cfg(target_arch = "x86_64")]
use x86::detect;

pub use boxes::{BLOCK, BLOCKS, Bits, Boxed, Boxes, Corners, RUN, RUNS};
pub use coarse::{CELLS, GRID, GridLookup, HALF, cell_of};
pub use equations::{Pair, Sums, Weighing};
pub use float::packed::PackedDense;
pub use float::sieve::SieveDense;
pub use float::split::{SplitDense, Tile};
pub use hidden::{Sides, has};
pub use lanes::{LANES, Places, Row};
pub use matching::{BEYOND, NearestQuery};
pub use nearest::Queries;
pub use neighbours::{BATCH, Batch, Moments};
pub use oriented::{Oriented, OrientedPoints};
pub use peak::Arithmetic;
pub(crate) use pruned::NEAR;
pub use search::GROUPS;

/// Instruction sets, from the slowest to the fastest. The first is 1, so that 0 means none: a static
/// [`crate::polish::Workspace`] without one takes no room in a program's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable = 1,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX2 with AVX-VNNI.
    #[cfg(target_arch = "x86_64")]
    AvxVnni,
    /// AVX-512F, with AVX2 and FMA; so have all that follow.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX-512F with AVX-512 VNNI.
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni,
    /// AVX-512F and VNNI with AMX tiles of bytes and bf16.
    #[cfg(target_arch = "x86_64")]
    Amx,
    #[cfg(arm_kernels = "neon")]
    Neon,
    /// NEON with the dot product of bytes.
    #[cfg(arm_kernels = "neon")]
    NeonDot,
    /// The DSP instructions of Armv7E-M.
    #[cfg(arm_kernels = "dsp")]
    Dsp,
    /// The vector instructions of Armv8.1-M.
    #[cfg(arm_kernels = "helium")]
    Helium,
    /// The vector instructions of WebAssembly.
    #[cfg(wasm_kernels = "simd128")]
    Simd128,
}

/// Instruction sets for f32. Several kinds share one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Floats {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(arm_kernels = "neon")]
    Neon,
}

/// A set of kernels that this machine is known to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Kind);

impl Isa {
    /// The kernels that run everywhere.
    pub const PORTABLE: Isa = Isa(Kind::Portable);

    /// The fastest kernels of this machine.
    pub fn best() -> Isa {
        Isa::all().last().unwrap_or(Isa::PORTABLE)
    }

    /// All kernels that this machine runs, from the slowest to the fastest.
    pub fn all() -> impl Iterator<Item = Isa> {
        [
            (Kind::Portable, true),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx2, detect::has(detect::AVX2)),
            #[cfg(target_arch = "x86_64")]
            (Kind::AvxVnni, detect::has(detect::AVX2 | detect::AVX_VNNI)),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx512, detect::has(detect::AVX512)),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx512Vnni, detect::has(detect::AVX512_VNNI)),
            #[cfg(target_arch = "x86_64")]
            (Kind::Amx, detect::has(detect::AMX)),
            #[cfg(arm_kernels = "neon")]
            (Kind::Neon, true),
            #[cfg(arm_kernels = "neon")]
            (Kind::NeonDot, detect::has_dot_product()),
            #[cfg(arm_kernels = "dsp")]
            (Kind::Dsp, true),
            #[cfg(arm_kernels = "helium")]
            (Kind::Helium, true),
            #[cfg(wasm_kernels = "simd128")]
            (Kind::Simd128, true),
        ]
        .into_iter()
        .filter(|(_, runs)| *runs)
        .map(|(kind, _)| Isa(kind))
    }

    /// The kernels of this [`Isa::name`], if the machine runs them.
    pub fn named(name: &str) -> Option<Isa> {
        Isa::all().find(|isa| isa.name() == name)
    }

    /// Whether bytes multiply faster than floats here, which makes [`Isa::search`] worth its rare wrong winners.
    pub fn has_fast_bytes(self) -> bool {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni | Kind::Avx512Vnni | Kind::Amx => true,
            _ => false,
        }
    }

    /// Name of the instruction set.
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2+fma",
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => "avx2+fma+vnni",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512f",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => "avx512f+vnni",
            #[cfg(target_arch = "x86_64")]
            Kind::Amx => "avx512f+vnni+amx",
            #[cfg(arm_kernels = "neon")]
            Kind::Neon => "neon",
            #[cfg(arm_kernels = "neon")]
            Kind::NeonDot => "neon+dotprod",
            #[cfg(arm_kernels = "dsp")]
            Kind::Dsp => "armv7e-m dsp",
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => "helium",
            #[cfg(wasm_kernels = "simd128")]
            Kind::Simd128 => "simd128",
        }
    }

    /// What computes in f32.
    fn floats(self) -> Floats {
        match self.0 {
            Kind::Portable => Floats::Portable,
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => Floats::Avx2,
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => Floats::Avx512,
            #[cfg(arm_kernels = "neon")]
            Kind::Neon | Kind::NeonDot => Floats::Neon,
            #[cfg(arm_kernels = "dsp")]
            Kind::Dsp => Floats::Portable,
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => Floats::Portable,
            #[cfg(wasm_kernels = "simd128")]
            Kind::Simd128 => Floats::Portable,
        }
    }

    /// Squared distance from each query to the nearest of `others`, infinite if there is none.
    /// The same bits on every kernel.
    pub fn nearest_squared(self, queries: &mut Queries, others: &[[f32; 3]]) {
        match self.floats() {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe { nearest::avx2(queries, others) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe { nearest::avx512(queries, others) },
            _ => nearest::portable::<16>(queries, others),
        }
    }
}

/// Number of whole rows in `x`; 0 if the layer has no inputs.
fn rows(layer: &Dense<'_>, x: &[f32]) -> usize {
    x.len().checked_div(layer.inputs()).unwrap_or(0)
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_network;
