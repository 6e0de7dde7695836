//! The int8 search on AMX tiles: 32 outputs by 32 points in four tiles of 16 x 16 sums.
//!
//! The tile instructions have no stable intrinsics, so they are in three short `asm!` blocks. Between two of them no tile is
//! live except the configuration, which [`Tiles`] sets and releases.
#![allow(unsafe_code, clippy::indexing_slicing)]

use super::avx512_vnni::{self, Whole};
use crate::dims::PANEL;
use crate::kernels::byte::dense::marked;
use crate::kernels::search::{GROUPS, NONE, PanelBest, merge};
use crate::layer::Codes;
use core::arch::asm;
use core::arch::x86_64::*;
use core::ops::Range;

/// Points, and outputs, in one block.
const BLOCK: usize = 32;
/// Rows of one tile, and lanes of one row of sums.
const ROWS: usize = 16;
/// Bytes of one row of a tile.
const ROW_BYTES: usize = 64;

const _: () = assert!(ROWS.is_multiple_of(GROUPS) && BLOCK == 2 * PANEL);

/// Asks Linux for permission to use tile data; other systems have no such request.
pub(in crate::kernels) fn permitted() -> bool {
    #[cfg(target_os = "linux")]
    {
        const ARCH_PRCTL: i64 = 158;
        const ARCH_REQ_XCOMP_PERM: i64 = 0x1023;
        const XFEATURE_XTILEDATA: i64 = 18;
        let answer: i64;
        // SAFETY: arch_prctl(2) with this code reads and writes no memory of the process.
        unsafe {
            asm!(
                "syscall",
                inlateout("rax") ARCH_PRCTL => answer,
                in("rdi") ARCH_REQ_XCOMP_PERM,
                in("rsi") XFEATURE_XTILEDATA,
                out("rcx") _,
                out("r11") _,
                options(nostack),
            );
        }
        answer == 0
    }
    #[cfg(not(target_os = "linux"))]
    false
}

/// Layout of `ldtilecfg`: palette 1, eight tiles of 16 rows by 64 bytes.
#[repr(C, align(64))]
struct Configuration([u8; 64]);

const CONFIGURATION: Configuration = {
    let mut bytes = [0u8; 64];
    bytes[0] = 1;
    let mut tile = 0;
    while tile < 8 {
        bytes[16 + 2 * tile] = ROW_BYTES as u8;
        bytes[48 + tile] = ROWS as u8;
        tile += 1;
    }
    Configuration(bytes)
};

/// The tile registers of this thread, from their configuration to their release.
pub(in crate::kernels) struct Tiles;

impl Tiles {
    /// # Safety
    /// AMX was detected and [`permitted`].
    pub(in crate::kernels) unsafe fn configure() -> Tiles {
        // SAFETY: the constant is a valid configuration of palette 1; the caller guarantees AMX.
        unsafe {
            asm!("ldtilecfg [{}]", in(reg) &CONFIGURATION, options(nostack, readonly));
        }
        Tiles
    }

    /// Sums of 32 points and 32 outputs into four tiles: points 0..16, then 16..32, with each of the two panels.
    ///
    /// # Safety
    /// `x` holds 32 rows of `inputs` bytes, `weights` two panels, `inputs` is a positive multiple of 64.
    unsafe fn sums(&self, inputs: usize, x: *const u8, weights: *const i8, sums: &mut [Sums; 4]) {
        // SAFETY: reads what the caller guarantees, writes four tiles of 1 KiB to `sums`; every tile
        // register that is used is declared.
        unsafe {
            asm!(
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                "2:",
                "tileloadd tmm4, [{x} + {inputs}*1]",
                "tileloadd tmm6, [{w} + {row}*1]",
                "tdpbusd tmm0, tmm4, tmm6",
                "tileloadd tmm7, [{w2} + {row}*1]",
                "tdpbusd tmm1, tmm4, tmm7",
                "tileloadd tmm5, [{x2} + {inputs}*1]",
                "tdpbusd tmm2, tmm5, tmm6",
                "tdpbusd tmm3, tmm5, tmm7",
                "add {x}, 64",
                "add {x2}, 64",
                "add {w}, 1024",
                "add {w2}, 1024",
                "dec {steps}",
                "jnz 2b",
                "tilestored [{sums} + {row}*1], tmm0",
                "tilestored [{sums} + {row}*1 + 1024], tmm1",
                "tilestored [{sums} + {row}*1 + 2048], tmm2",
                "tilestored [{sums} + {row}*1 + 3072], tmm3",
                x = inout(reg) x => _,
                x2 = inout(reg) x.add(ROWS * inputs) => _,
                w = inout(reg) weights => _,
                w2 = inout(reg) weights.add(PANEL * inputs) => _,
                steps = inout(reg) inputs / ROW_BYTES => _,
                inputs = in(reg) inputs,
                row = in(reg) ROW_BYTES,
                sums = in(reg) sums.as_mut_ptr(),
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack),
            );
        }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        // SAFETY: `Tiles` exists only after `configure`.
        unsafe { asm!("tilerelease", options(nostack, nomem)) }
    }
}

/// One tile of sums, `[points, outputs]`.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Sums([[i32; PANEL]; ROWS]);

/// As [`avx512_vnni::search`], whose conditions hold, with AMX permitted as well.
#[target_feature(enable = "avx512f,avx512vnni")]
#[allow(clippy::too_many_arguments)]
pub(in crate::kernels) unsafe fn search(
    layer: &Codes<'_>,
    points: Range<usize>,
    panels: Range<usize>,
    codes: &[u8],
    scales: &[f32],
    best: &mut [f32],
    winner: &mut [u32],
) {
    let whole_points = points.start + points.len() / BLOCK * BLOCK;
    let whole_panels = panels.start + panels.len() / 2 * 2;
    // SAFETY: blocks cover the given panels and points only; `avx512_vnni::search` does the rest.
    unsafe {
        {
            let tiles = Tiles::configure();
            let mut sums = [[Sums([[0; PANEL]; ROWS]); 4]; 2];
            for panel in (panels.start..whole_panels).step_by(2) {
                let weights = layer.panels().as_ptr().add(panel * layer.inputs() * PANEL);
                let mut best_of_tile = [NONE; 2];
                let mut next = points.start;
                let mut slot = 0;
                // While the tiles of one block are multiplied, those of the previous one are compared.
                while next < whole_points + BLOCK {
                    if next < whole_points {
                        let x = codes.as_ptr().add(next * layer.inputs());
                        tiles.sums(layer.inputs(), x, weights, &mut sums[slot]);
                    }
                    slot = 1 - slot;
                    if next > points.start {
                        let first = next - BLOCK;
                        let scales = scales.as_ptr().add(first);
                        take(
                            &sums[slot],
                            first,
                            first - points.start,
                            scales,
                            &mut best_of_tile,
                        );
                    }
                    next += BLOCK;
                }
                for (p, tile) in best_of_tile.iter().enumerate() {
                    merge(tile, points.start, panel + p, layer.outputs(), best, winner);
                }
            }
        }
        avx512_vnni::search(
            layer,
            points.start,
            points.clone(),
            whole_panels..panels.end,
            codes,
            scales,
            best,
            winner,
        );
        let rest = whole_points..points.end;
        avx512_vnni::search(
            layer,
            points.start,
            rest,
            panels.start..whole_panels,
            codes,
            scales,
            best,
            winner,
        );
    }
}

/// Folds the sums of 32 points and two panels into the best of the tile.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn take(
    sums: &[Sums; 4],
    first: usize,
    place: usize,
    scales: *const f32,
    best: &mut [PanelBest; 2],
) {
    // SAFETY: the caller guarantees 32 scales; the arrays have the lengths of their registers.
    unsafe {
        for (p, best) in best.iter_mut().enumerate() {
            let mut kept: [__m512; GROUPS] =
                core::array::from_fn(|group| _mm512_loadu_ps(best[group].as_ptr()));
            for half in 0..2 {
                for (row, sum) in sums[2 * half + p].0.iter().enumerate() {
                    let n = half * ROWS + row;
                    let sum = _mm512_load_si512(sum.as_ptr().cast());
                    let place = _mm512_set1_epi32((place + n) as i32);
                    let group = (first + n) % GROUPS;
                    kept[group] =
                        _mm512_max_ps(avx512_vnni::score(sum, *scales.add(n), place), kept[group]);
                }
            }
            for (best, kept) in best.iter_mut().zip(kept) {
                _mm512_storeu_ps(best.as_mut_ptr(), kept);
            }
        }
    }
}

/// As [`avx512_vnni::dense_codes_max`], whose conditions hold, with AMX permitted as well.
#[target_feature(enable = "avx512f,avx512vnni")]
pub(in crate::kernels) unsafe fn dense_codes_max<const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    let inputs = layer.inputs();
    let whole_points = x.len() / inputs / BLOCK * BLOCK;
    let whole_panels = panels.start + panels.len() / 2 * 2;
    // SAFETY: blocks cover the given panels and whole rows of `x` only; `avx512_vnni::dense_codes_max` does the rest.
    unsafe {
        {
            let tiles = Tiles::configure();
            let mut sums = [[Sums([[0; PANEL]; ROWS]); 4]; 2];
            for panel in (panels.start..whole_panels).step_by(2) {
                let weights = layer.panels().as_ptr().add(panel * inputs * PANEL);
                let max = max.as_mut_ptr().add(panel * PANEL).cast::<__m512i>();
                let mut best = [_mm512_loadu_si512(max), _mm512_loadu_si512(max.add(1))];
                let mut slot = 0;
                for next in (0..whole_points + BLOCK).step_by(BLOCK) {
                    if next < whole_points {
                        tiles.sums(
                            inputs,
                            x.as_ptr().add(next * inputs),
                            weights,
                            &mut sums[slot],
                        );
                    }
                    slot = 1 - slot;
                    if next > 0 {
                        for (tile, sums) in sums[slot].iter().enumerate() {
                            let first = next - BLOCK + tile / 2 * ROWS;
                            for (n, row) in sums.0.iter().enumerate() {
                                let row = Whole(_mm512_load_si512(row.as_ptr().cast()));
                                let row = marked::<_, MARK>(row, first + n);
                                best[tile % 2] = _mm512_max_epi32(best[tile % 2], row.0);
                            }
                        }
                    }
                }
                _mm512_storeu_si512(max, best[0]);
                _mm512_storeu_si512(max.add(1), best[1]);
            }
        }
        let rest = &x[whole_points * inputs..];
        let paired = panels.start..whole_panels;
        avx512_vnni::dense_codes_max::<MARK>(layer, paired, rest, whole_points, max);
        avx512_vnni::dense_codes_max::<MARK>(layer, whole_panels..panels.end, x, 0, max);
    }
}

/// Multiplies tiles on registers only, for [`crate::kernels::Isa::multiply_adds`].
///
/// # Safety
/// AMX was detected and [`permitted`].
pub(in crate::kernels) unsafe fn multiply_adds(rounds: u64) -> u64 {
    // SAFETY: the caller guarantees AMX; every tile register that is used is declared.
    unsafe {
        let _tiles = Tiles::configure();
        for _ in 0..rounds {
            asm!(
                "tdpbusd tmm0, tmm4, tmm6",
                "tdpbusd tmm1, tmm4, tmm7",
                "tdpbusd tmm2, tmm5, tmm6",
                "tdpbusd tmm3, tmm5, tmm7",
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                options(nostack, nomem),
            );
        }
    }
    rounds * 4 * (ROWS * PANEL * ROW_BYTES) as u64
}
