//! Layers of split numbers ([`crate::kernels::float::split`]) on AMX tiles of bf16: four tiles of 16 x 16 sums, with six products for
//! each block of 32 inputs.
#![allow(unsafe_code, clippy::indexing_slicing)]

use super::amx::Tiles;
use crate::dims::{PANEL, TILE};
use crate::kernels::float::split::{INPUTS, PARTS, SplitDense, TILE_INPUTS, Tile};
use core::arch::asm;
use core::arch::x86_64::*;

/// Points in one tile.
const ROWS: usize = 16;
/// Tiles that hold 16 points.
const ROW_TILES: usize = INPUTS / TILE_INPUTS * PARTS;

const _: () = assert!(TILE.is_multiple_of(ROWS));

/// One tile of sums, `[points, outputs]`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Sums([[f32; PANEL]; ROWS]);

/// Defines a function that writes the sums of four pairs of tiles. `$points` are the asm lines that load the tiles of points at
/// an offset, `$products` those that multiply them by the outputs at an offset.
macro_rules! block {
    ($(#[$docs:meta])* $name:ident, [$($pointer:ident),+; $count:literal], $points:ident, $products:ident) => {
        $(#[$docs])*
        ///
        /// # Safety
        /// Each pointer leads to `steps * PARTS` tiles, and `steps` is positive.
        unsafe fn $name(
            _configured: &Tiles,
            steps: usize,
            [$($pointer),+]: [*const Tile; $count],
            sums: &mut [Sums; 4],
        ) {
            // SAFETY: reads what the caller guarantees, writes four tiles of 1 KiB to `sums`; every tile
            // register that is used is declared.
            unsafe {
                asm!(
                    "tilezero tmm0",
                    "tilezero tmm1",
                    "tilezero tmm2",
                    "tilezero tmm3",
                    // The small products first, while the sums are small.
                    "2:",
                    $points!("0"),
                    $products!("1024"),
                    $products!("2048"),
                    $points!("1024"),
                    $products!("0"),
                    $products!("1024"),
                    $points!("2048"),
                    $products!("0"),
                    $(concat!("add {", stringify!($pointer), "}, 3072"),)+
                    "dec {steps}",
                    "jnz 2b",
                    $(concat!("sub {", stringify!($pointer), "}, {bytes}"),)+
                    "3:",
                    $points!("0"),
                    $products!("0"),
                    $(concat!("add {", stringify!($pointer), "}, 3072"),)+
                    "sub {bytes}, 3072",
                    "jnz 3b",
                    "tilestored [{sums} + {row}*1], tmm0",
                    "tilestored [{sums} + {row}*1 + 1024], tmm1",
                    "tilestored [{sums} + {row}*1 + 2048], tmm2",
                    "tilestored [{sums} + {row}*1 + 3072], tmm3",
                    $($pointer = inout(reg) $pointer => _,)+
                    steps = inout(reg) steps => _,
                    bytes = inout(reg) steps * PARTS * size_of::<Tile>() => _,
                    row = in(reg) 2 * TILE_INPUTS,
                    sums = in(reg) sums.as_mut_ptr(),
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                    options(nostack),
                );
            }
        }
    };
}

macro_rules! two_points {
    ($at:literal) => {
        concat!(
            "tileloadd tmm4, [{x0} + {row}*1 + ",
            $at,
            "]\n",
            "tileloadd tmm5, [{x1} + {row}*1 + ",
            $at,
            "]\n",
        )
    };
}

macro_rules! by_two_outputs {
    ($at:literal) => {
        concat!(
            "tileloadd tmm6, [{w0} + {row}*1 + ",
            $at,
            "]\n",
            "tdpbf16ps tmm0, tmm4, tmm6\n",
            "tileloadd tmm7, [{w1} + {row}*1 + ",
            $at,
            "]\n",
            "tdpbf16ps tmm1, tmm4, tmm7\n",
            "tdpbf16ps tmm2, tmm5, tmm6\n",
            "tdpbf16ps tmm3, tmm5, tmm7\n",
        )
    };
}

block! {
    /// Sums of 32 points and two panels: points 0..16, then 16..32, with each panel.
    two_by_two, [x0, x1, w0, w1; 4], two_points, by_two_outputs
}

macro_rules! one_point {
    ($at:literal) => {
        concat!("tileloadd tmm4, [{x} + {row}*1 + ", $at, "]\n")
    };
}

macro_rules! by_four_outputs {
    ($at:literal) => {
        concat!(
            "tileloadd tmm5, [{w0} + {row}*1 + ",
            $at,
            "]\n",
            "tdpbf16ps tmm0, tmm4, tmm5\n",
            "tileloadd tmm6, [{w1} + {row}*1 + ",
            $at,
            "]\n",
            "tdpbf16ps tmm1, tmm4, tmm6\n",
            "tileloadd tmm7, [{w2} + {row}*1 + ",
            $at,
            "]\n",
            "tdpbf16ps tmm2, tmm4, tmm7\n",
            "tileloadd tmm5, [{w3} + {row}*1 + ",
            $at,
            "]\n",
            "tdpbf16ps tmm3, tmm4, tmm5\n",
        )
    };
}

block! {
    /// Sums of 16 points and four panels.
    one_by_four, [x, w0, w1, w2, w3; 5], one_point, by_four_outputs
}

/// Splits at most 16 rows, each part as [`crate::kernels::float::split::split`] does.
#[target_feature(enable = "avx512f")]
fn split_rows(inputs: usize, x: &[f32], tiles: &mut [Tile; ROW_TILES]) {
    let upper = |x| _mm512_and_si512(x, _mm512_set1_epi32(0xffff_0000_u32 as i32));
    for (n, row) in x.chunks_exact(inputs).enumerate() {
        for (group, x) in row.as_chunks::<PANEL>().0.iter().enumerate() {
            let first = group * PANEL / TILE_INPUTS * PARTS;
            let place = n * TILE_INPUTS + group * PANEL % TILE_INPUTS;
            // SAFETY: sixteen numbers are read, and as many written to each part.
            unsafe {
                let x = _mm512_loadu_ps(x.as_ptr());
                let high = upper(_mm512_castps_si512(x));
                let rest = _mm512_sub_ps(x, _mm512_castsi512_ps(high));
                let middle = upper(_mm512_castps_si512(rest));
                let low = _mm512_sub_ps(rest, _mm512_castsi512_ps(middle));
                let parts = [high, middle, _mm512_castps_si512(low)];
                for (tile, part) in tiles[first..first + PARTS].iter_mut().zip(parts) {
                    let bits = _mm512_cvtepi32_epi16(_mm512_srli_epi32::<16>(part));
                    let to = tile.0[place..place + PANEL].as_mut_ptr();
                    _mm256_storeu_si256(to.cast(), bits);
                }
            }
        }
    }
}

/// Raises the maxima of panels to the sums of `rows` points of each tile; `panels` says which panel a tile is of.
#[target_feature(enable = "avx512f")]
#[inline]
fn raise(sums: &[Sums; 4], (rows, panels): ([usize; 4], [usize; 4]), best: &mut [__m512; 4]) {
    for ((sums, rows), panel) in sums.iter().zip(rows).zip(panels) {
        let mut highest = best[panel];
        for row in sums.0.iter().take(rows) {
            // SAFETY: a row is as long as a register, and aligned as one.
            let row = unsafe { _mm512_load_ps(row.as_ptr()) };
            highest = _mm512_max_ps(row, highest);
        }
        best[panel] = highest;
    }
}

/// See [`crate::kernels::Isa::dense_max_split`].
///
/// # Safety
/// AMX was detected and permitted; `max` holds as many values as the layer has outputs.
#[target_feature(enable = "avx512f")]
pub(in crate::kernels) unsafe fn dense_max(layer: &SplitDense<'_>, x: &[f32], max: &mut [f32]) {
    let (inputs, bias) = (layer.layer.inputs(), layer.layer.bias());
    let steps = inputs / TILE_INPUTS;
    let panel_tiles = steps * PARTS;
    let mut split = [[Tile::ZERO; ROW_TILES]; TILE / ROWS];
    let mut sums = [[Sums([[0.0; PANEL]; ROWS]); 4]; 2];
    for x in x.chunks(TILE * inputs) {
        let points = x.len() / inputs;
        for (tiles, x) in split.iter_mut().zip(x.chunks(ROWS * inputs)) {
            split_rows(inputs, x, tiles);
        }
        // SAFETY: tiles of points as filled above, four panels of the layer's, and their maxima.
        unsafe {
            let configured = Tiles::configure();
            let outputs = bias
                .chunks_exact(4 * PANEL)
                .zip(max.chunks_exact_mut(4 * PANEL));
            for (weights, (bias, max)) in layer.tiles.chunks_exact(4 * panel_tiles).zip(outputs) {
                let panel = |p: usize| weights.as_ptr().add(p * panel_tiles);
                let mut best = [_mm512_set1_ps(f32::NEG_INFINITY); 4];
                // While the tiles of one block are multiplied, those of the previous one are compared.
                let mut slot = 0;
                let mut before = ([0; 4], [0; 4]);
                for first in (0..points).step_by(2 * ROWS) {
                    let rows = |t: usize| split[first / ROWS + t].as_ptr();
                    let left = points - first;
                    if left > ROWS {
                        for p in [0, 2] {
                            let pointers = [rows(0), rows(1), panel(p), panel(p + 1)];
                            two_by_two(&configured, steps, pointers, &mut sums[slot]);
                            slot = 1 - slot;
                            raise(&sums[slot], before, &mut best);
                            let rows = [ROWS, ROWS, left - ROWS, left - ROWS];
                            before = (rows, [p, p + 1, p, p + 1]);
                        }
                    } else {
                        let pointers = [rows(0), panel(0), panel(1), panel(2), panel(3)];
                        one_by_four(&configured, steps, pointers, &mut sums[slot]);
                        slot = 1 - slot;
                        raise(&sums[slot], before, &mut best);
                        before = ([left; 4], [0, 1, 2, 3]);
                    }
                }
                raise(&sums[1 - slot], before, &mut best);
                for (p, best) in best.into_iter().enumerate() {
                    let sum = _mm512_add_ps(best, _mm512_loadu_ps(bias.as_ptr().add(p * PANEL)));
                    let max = max.as_mut_ptr().add(p * PANEL);
                    _mm512_storeu_ps(max, _mm512_max_ps(sum, _mm512_loadu_ps(max)));
                }
            }
        }
    }
}
