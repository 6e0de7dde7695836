//! Integer layers for Cortex-M4, M7 and M33 with `smlad`: two 16-bit products and their sum in one instruction.
//!
//! The codes of a block of points are spread to 16 bits once, in the pairs that `sxtb16` makes of weights, and used for all
//! outputs; four weights are loaded and spread for four points at a time. That makes 13 instructions for 16 products, plus a
//! loop over inputs that is unrolled four times.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use crate::dims::{PANEL, QUAD};
use crate::kernels::byte::portable;
use crate::layer::{Codes, Requantise};
use core::arch::{asm, naked_asm};
use core::ops::Range;

/// Points served by one pass over the weights.
pub(super) const BLOCK: usize = 8;
/// Points of one call of [`four_points`].
const POINTS: usize = 4;
/// Most inputs of a layer that a block holds.
const INPUTS: usize = 128;
/// Columns of a head that are spread at a time.
const COLUMNS: usize = 256;

/// Four codes in 16 bits: the first and third, then the second and fourth.
pub(super) type Pairs = [u32; 2];

/// Spreads four bytes to 16 bits each.
#[inline(always)]
pub(super) fn spread(four: u32) -> Pairs {
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

/// Four points, spread to 16 bits; missing points are leftovers.
type Half = [[Pairs; POINTS]; INPUTS / QUAD];

/// A block of points.
pub(super) struct Block([Half; BLOCK / POINTS]);

impl Block {
    pub(super) const ZERO: Block = Block([[[[0; 2]; POINTS]; INPUTS / QUAD]; BLOCK / POINTS]);

    pub(super) fn fill(&mut self, inputs: usize, x: &[u8]) {
        let mut rows = x.chunks_exact(inputs.max(1));
        for half in &mut self.0 {
            for n in 0..POINTS {
                let Some(row) = rows.next() else { return };
                for (pairs, four) in half.iter_mut().zip(row.as_chunks::<QUAD>().0) {
                    pairs[n] = spread(u32::from_le_bytes(*four));
                }
            }
        }
    }

    /// The halves that hold the first `points` points: their inputs, and their number of points.
    #[inline(always)]
    pub(super) fn halves(
        &self,
        inputs: usize,
        points: usize,
    ) -> impl Iterator<Item = (&[[Pairs; POINTS]], usize)> {
        let halves = self.0.iter().zip((0..points).step_by(POINTS));
        halves.filter_map(move |(half, first)| {
            let x = half.get(..inputs / QUAD)?;
            Some((x, (points - first).min(POINTS)))
        })
    }
}

/// Sums of one output for four points.
#[inline(always)]
pub(super) fn sums(layer: &Codes<'_>, output: usize, x: &[[Pairs; POINTS]]) -> [i32; POINTS] {
    let mut sums = [0; POINTS];
    let at = output / PANEL * layer.inputs() * PANEL + output % PANEL * QUAD;
    let x = x.as_ptr_range();
    // SAFETY: the layer holds a multiple of 64 inputs, at most `INPUTS`, of this output, and `x` as many.
    unsafe {
        four_points(
            layer.panels().as_ptr().add(at),
            x.start,
            x.end,
            &raw mut sums,
        )
    }
    sums
}

/// Whether a block holds rows of this many inputs.
pub(super) fn fits(inputs: usize) -> bool {
    (1..=INPUTS).contains(&inputs)
}

/// As [`portable::dense_codes_max`].
#[inline(never)]
pub(in crate::kernels) unsafe fn dense_codes_max<const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    let inputs = layer.inputs();
    if !fits(inputs) {
        return portable::dense_codes_max(MARK, layer, panels, x, max);
    }
    let outputs = panels.start * PANEL..panels.end * PANEL;
    let mut block = Block::ZERO;
    for (round, x) in x.chunks((BLOCK * inputs).max(1)).enumerate() {
        block.fill(inputs, x);
        let points = x.len() / inputs;
        for (output, best) in outputs.clone().zip(max.iter_mut().skip(outputs.start)) {
            let mut rows = round * BLOCK..;
            for (x, points) in block.halves(inputs, points) {
                let sums = sums(layer, output, x);
                for (&sum, row) in sums.iter().take(points).zip(&mut rows) {
                    *best = portable::marked(MARK, sum, row).max(*best);
                }
            }
        }
    }
}

/// As [`portable::dense_codes`].
#[inline(never)] // its block is gone before that of the next layer is made
pub(in crate::kernels) unsafe fn dense_codes(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    let (inputs, outputs) = (layer.inputs(), layer.outputs());
    if !fits(inputs) || outputs == 0 {
        return portable::dense_codes(layer, bias, requantise, x, y);
    }
    let mut block = Block::ZERO;
    for (x, y) in x
        .chunks((BLOCK * inputs).max(1))
        .zip(y.chunks_mut((BLOCK * outputs).max(1)))
    {
        block.fill(inputs, x);
        let points = x.len() / inputs;
        for (output, (&bias, &r)) in bias.iter().zip(requantise).enumerate() {
            let mut rows = y.chunks_exact_mut(outputs.max(1));
            for (x, points) in block.halves(inputs, points) {
                let sums = sums(layer, output, x);
                for (row, &sum) in rows.by_ref().take(points).zip(&sums) {
                    if let Some(code) = row.get_mut(output) {
                        *code = Requantise(r).apply_32(sum + bias, 255) as u8;
                    }
                }
            }
        }
    }
}

/// `sum + Σ x w` over a pair of 16-bit numbers.
#[inline(always)]
fn smlad(x: u32, w: u32, mut sum: i32) -> i32 {
    // SAFETY: computes on registers only, by an instruction of the target.
    unsafe {
        asm!("smlad {s}, {x}, {w}, {s}", s = inout(reg) sum, x = in(reg) x, w = in(reg) w,
            options(pure, nomem, nostack));
    }
    sum
}

/// Spreads four signed bytes to 16 bits each.
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

/// As [`portable::gemv_codes`].
pub(in crate::kernels) unsafe fn gemv_codes(
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
        for (panel, y) in y.as_chunks_mut::<PANEL>().0.iter_mut().enumerate() {
            let at = (panel * layer.inputs() + first) * PANEL;
            let weights = layer.panels().get(at..at + high.len() * PANEL);
            let weights: &[u8] = bytemuck::cast_slice(weights.unwrap_or(&[]));
            let quads = weights.as_chunks::<QUAD>().0;
            for (lane, y) in y.iter_mut().enumerate() {
                for (x, w) in wide.iter().zip(quads.iter().skip(lane).step_by(PANEL)) {
                    let w = spread_signed(u32::from_le_bytes(*w));
                    *y = smlad(x[1], w[1], smlad(x[0], w[0], *y));
                }
            }
        }
    }
}
