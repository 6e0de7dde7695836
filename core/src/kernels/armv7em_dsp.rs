//! Integer layers for Cortex-M4, M7 and M33, by `smlad`: two products of 16 bits and their sum in one
//! instruction.
//!
//! Codes of a block of points are spread to 16 bits once, in pairs as `sxtb16` gives those of weights,
//! and meet all outputs; four weights are loaded and spread for four points at a time. That makes 13
//! instructions for 16 products, besides a loop over inputs that is unrolled four times.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::bytes;
use super::search::{Codes, QUAD};
use crate::dims::PANEL;
use crate::quant::Requantise;
use core::arch::{asm, naked_asm};
use core::ops::Range;

/// Points that one pass over the weights serves.
const BLOCK: usize = 8;
/// Points of one call of [`four_points`].
const POINTS: usize = 4;
/// Most inputs of a layer of rows.
const INPUTS: usize = 128;
/// Columns of a head that are spread at once.
const COLUMNS: usize = 256;

/// Four codes of 16 bits: the first and third, the second and fourth.
type Pairs = [u32; 2];

/// Bytes spread to 16 bits.
#[inline(always)]
fn spread(four: u32) -> Pairs {
    [four & 0x00ff_00ff, four >> 8 & 0x00ff_00ff]
}

/// Adds the products of one output with four points to `sums`.
///
/// # Safety
/// `weights` holds groups of four codes, [`PANEL`] groups apart, one for each four pairs from `x` to
/// `end`, whose number is a positive multiple of four; `sums` holds four values.
#[unsafe(naked)]
unsafe extern "C" fn four_points(
    weights: *const i8,
    x: *const [Pairs; POINTS],
    end: *const [Pairs; POINTS],
    sums: *mut [i32; POINTS],
) {
    naked_asm!(
        "push {{r3-r11, lr}}",
        "ldm r3, {{r3, r4, r5, r6}}",
        "2:",
        ".rept 4",
        "ldr r12, [r0], #64",
        "ldm r1!, {{r7, r8, r9, r10}}",
        "sxtb16 r11, r12",
        "sxtb16 r12, r12, ror #8",
        "smlad r3, r7, r11, r3",
        "smlad r4, r9, r11, r4",
        "smlad r3, r8, r12, r3",
        "smlad r4, r10, r12, r4",
        "ldm r1!, {{r7, r8, r9, r10}}",
        "smlad r5, r7, r11, r5",
        "smlad r6, r9, r11, r6",
        "smlad r5, r8, r12, r5",
        "smlad r6, r10, r12, r6",
        ".endr",
        "cmp r1, r2",
        "bne 2b",
        "ldr r7, [sp]",
        "stm r7, {{r3, r4, r5, r6}}",
        "pop {{r3-r11, pc}}",
    )
}

/// A block of points, spread; points that are missing are zero.
struct Block([[[Pairs; POINTS]; INPUTS / QUAD]; BLOCK / POINTS]);

impl Block {
    const ZERO: Block = Block([[[[0; 2]; POINTS]; INPUTS / QUAD]; BLOCK / POINTS]);

    fn fill(&mut self, inputs: usize, x: &[u8]) {
        for (n, row) in x.chunks_exact(inputs).enumerate() {
            let quads = self.0[n / POINTS].iter_mut();
            for (pairs, four) in quads.zip(row.as_chunks::<QUAD>().0) {
                pairs[n % POINTS] = spread(u32::from_le_bytes(*four));
            }
        }
    }

    /// Sums of one output with the four points of `half`.
    #[inline(always)]
    fn sums(&self, layer: &Codes<'_>, output: usize, half: usize) -> [i32; POINTS] {
        let mut sums = [0; POINTS];
        let at = output / PANEL * layer.inputs * PANEL + output % PANEL * QUAD;
        let x = self.0[half][..layer.inputs / QUAD].as_ptr_range();
        // SAFETY: the layer holds a multiple of 64 inputs, at most `INPUTS`, of this output.
        unsafe {
            four_points(layer.panels.as_ptr().add(at), x.start, x.end, &raw mut sums);
        }
        sums
    }
}

/// As [`bytes::dense_codes_max`].
pub(super) unsafe fn dense_codes_max(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    if layer.inputs > INPUTS {
        return bytes::dense_codes_max(layer, panels, x, max);
    }
    let mut block = Block::ZERO;
    for x in x.chunks(BLOCK * layer.inputs) {
        block.fill(layer.inputs, x);
        let points = x.len() / layer.inputs;
        for output in panels.start * PANEL..panels.end * PANEL {
            let mut best = max[output];
            for half in 0..points.div_ceil(POINTS) {
                let sums = block.sums(layer, output, half);
                for &sum in sums.iter().take(points - half * POINTS) {
                    best = best.max(sum);
                }
            }
            max[output] = best;
        }
    }
}

/// As [`bytes::dense_codes`].
pub(super) unsafe fn dense_codes(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    if layer.inputs > INPUTS {
        return bytes::dense_codes(layer, bias, requantise, x, y);
    }
    let mut block = Block::ZERO;
    let blocks = x.chunks(BLOCK * layer.inputs);
    for (x, y) in blocks.zip(y.chunks_mut(BLOCK * layer.outputs)) {
        block.fill(layer.inputs, x);
        let points = (x.len() / layer.inputs).min(y.len() / layer.outputs);
        for (output, (&bias, &r)) in bias.iter().zip(requantise).enumerate() {
            for half in 0..points.div_ceil(POINTS) {
                let sums = block.sums(layer, output, half);
                let rows = y[half * POINTS * layer.outputs..].chunks_exact_mut(layer.outputs);
                for (row, sum) in rows.zip(sums) {
                    row[output] = Requantise(r).apply_32(sum + bias, 255) as u8;
                }
            }
        }
    }
}

/// `sum + Σ x w` of a pair of 16-bit numbers each.
#[inline(always)]
fn smlad(x: u32, w: u32, mut sum: i32) -> i32 {
    // SAFETY: computes on registers only, by an instruction of the target.
    unsafe {
        asm!("smlad {s}, {x}, {w}, {s}", s = inout(reg) sum, x = in(reg) x, w = in(reg) w,
            options(pure, nomem, nostack));
    }
    sum
}

/// Signed bytes spread to 16 bits.
#[inline(always)]
fn spread_signed(four: u32) -> Pairs {
    let (first, second): (u32, u32);
    // SAFETY: computes on registers only, by an instruction of the target.
    unsafe {
        asm!("sxtb16 {a}, {w}", "sxtb16 {b}, {w}, ror #8",
            a = out(reg) first, b = lateout(reg) second, w = in(reg) four,
            options(pure, nomem, nostack));
    }
    [first, second]
}

/// As [`bytes::gemv_codes`].
pub(super) unsafe fn gemv_codes(
    layer: &Codes<'_>,
    columns: Range<usize>,
    [high, low]: [&[u8]; 2],
    y: &mut [i32],
) {
    let mut wide = [[0u32; 2]; COLUMNS / QUAD];
    let planes = high.chunks(COLUMNS).zip(low.chunks(COLUMNS));
    for ((high, low), first) in planes.zip((columns.start..).step_by(COLUMNS)) {
        let quads = high.as_chunks::<QUAD>().0.iter().zip(low.as_chunks().0);
        for (wide, (high, low)) in wide.iter_mut().zip(quads) {
            let high = spread(u32::from_le_bytes(*high));
            let low = spread(u32::from_le_bytes(*low));
            *wide = [high[0] << 6 | low[0], high[1] << 6 | low[1]];
        }
        let wide = &wide[..high.len() / QUAD];
        for (panel, y) in y.as_chunks_mut::<PANEL>().0.iter_mut().enumerate() {
            let at = (panel * layer.inputs + first) * PANEL;
            let weights = &layer.panels[at..at + high.len() * PANEL];
            let quads = bytemuck::cast_slice::<i8, u8>(weights)
                .as_chunks::<QUAD>()
                .0;
            for (lane, y) in y.iter_mut().enumerate() {
                for (x, w) in wide.iter().zip(quads.iter().skip(lane).step_by(PANEL)) {
                    let w = spread_signed(u32::from_le_bytes(*w));
                    *y = smlad(x[1], w[1], smlad(x[0], w[0], *y));
                }
            }
        }
    }
}
