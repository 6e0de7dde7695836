//! Integer layers for Cortex-M55, M52 and M85 with `vmladava`: sixteen byte products and their sum in one instruction.
//!
//! Both operands must have the same signedness, so 128 is added to weight codes, and sums start at `-128 Σ x`, one value for
//! each point: the same integers as everywhere. Sixteen inputs of one output are gathered, since they lie in groups of four,
//! and used for four points: 10 instructions for 64 products, plus a loop over inputs that is unrolled twice.
#![allow(unsafe_code, clippy::indexing_slicing)]

use crate::dims::PANEL;
use crate::kernels::byte::portable;
use crate::layer::Codes;
use core::arch::naked_asm;
use core::ops::Range;

/// Points in one block.
pub(super) const POINTS: usize = 4;
/// Inputs in one round of the loop.
const ROUND: usize = 32;

/// Sums of a panel's outputs for four points.
type Sums = [[i32; POINTS]; PANEL];

/// Four rows of codes.
#[repr(C)]
pub(super) struct Block {
    rows: [*const u8; POINTS],
    /// `-128 Σ x` of each row.
    start: [i32; POINTS],
    /// [`portable::row_mark`] of each row.
    marks: [i32; POINTS],
    /// Bias and requantisation of [`panel_codes_of`]'s next output, and offsets from there at which each row's codes go.
    scales: [*const u32; 2],
    places: [u32; POINTS],
}

impl Block {
    /// Rows of `inputs` codes each; if there are fewer than four, the last is repeated. `None` without any.
    pub(super) fn of(x: &[u8], inputs: usize) -> Option<Block> {
        let mut rows = x.chunks_exact(inputs.max(1));
        let last = rows.clone().next_back()?;
        let rows: [&[u8]; POINTS] = core::array::from_fn(|_| rows.next().unwrap_or(last));
        Some(Block::new(rows))
    }

    fn new(rows: [&[u8]; POINTS]) -> Block {
        Block {
            rows: rows.map(<[u8]>::as_ptr),
            start: rows.map(|row| -128 * row.iter().map(|&x| i32::from(x)).sum::<i32>()),
            marks: [0; POINTS],
            scales: [core::ptr::null(); 2],
            places: [0; POINTS],
        }
    }
}

/// Sums of one output for the points of the block at `r12`, to `q0`. Weights are at the addresses in `q3`, less one round of
/// half a loop; rows are at `r1`, `r3`, `r5` and `r7`, which advance by the `r0` inputs; `r9` is 128.
macro_rules! four_sums {
    () => {
        concat!(
            "ldrd r4, r6, [r12, #16]\n",
            "ldrd r8, r10, [r12, #24]\n",
            "lsr lr, r0, #5\n",
            "dls lr, lr\n",
            "3:\n",
            ".rept 2\n",
            "vldrw.u32 q0, [q3, #256]!\n",
            "vldrb.u8 q1, [r1], #16\n",
            "vadd.i8 q0, q0, r9\n",
            "vmladava.u8 r4, q0, q1\n",
            "vldrb.u8 q2, [r3], #16\n",
            "vmladava.u8 r6, q0, q2\n",
            "vldrb.u8 q1, [r5], #16\n",
            "vmladava.u8 r8, q0, q1\n",
            "vldrb.u8 q2, [r7], #16\n",
            "vmladava.u8 r10, q0, q2\n",
            ".endr\n",
            "le lr, 3b\n",
            "vmov q0[2], q0[0], r4, r8\n",
            "vmov q0[3], q0[1], r6, r10\n",
        )
    };
}
pub(super) use four_sums;

/// Defines a function over a panel's outputs. `$take` stores the sums of one output, in `q0`, to where `r2` points, and
/// advances `r2` by `$step` bytes.
macro_rules! panel {
    ($(#[$docs:meta])* $name:ident, $out:ty, $step:literal, $($take:literal),+) => {
        $(#[$docs])*
        #[unsafe(naked)]
        unsafe extern "C" fn $name(
            weights: *const i8,
            block: *mut Block,
            out: *mut $out,
            inputs: usize,
        ) {
            naked_asm!(
                ".cpu cortex-m55",
                "push {{r4-r11, lr}}",
                // Addresses of four groups of one output, less one round of half a loop.
                "movs r4, #0",
                "vidup.u32 q3, r4, #8",
                "vshl.i32 q3, q3, #3",
                "sub r0, r0, #256",
                "vadd.i32 q3, q3, r0",
                // From the last groups of an output to those before the first of the next.
                "mov r0, r3",
                "lsl r11, r0, #4",
                "subs r11, #4",
                "mov r12, r1",
                "ldrd r1, r3, [r12]",
                "ldrd r5, r7, [r12, #8]",
                "mov r9, #128",
                "add lr, r2, #{bytes}",
                "push {{r2, lr}}",
                "2:",
                four_sums!(),
                $($take,)+
                "subs r1, r1, r0",
                "subs r3, r3, r0",
                "subs r5, r5, r0",
                "subs r7, r7, r0",
                "vsub.i32 q3, q3, r11",
                "ldr lr, [sp, #4]",
                "cmp r2, lr",
                "bne 2b",
                "add sp, #8",
                "pop {{r4-r11, pc}}",
                bytes = const $step * PANEL,
            )
        }
    };
}

panel! {
    /// Writes the sums of a panel's outputs for a block of points.
    ///
    /// # Safety
    /// `weights` holds a panel's groups of `inputs` columns, each row of `block` as many codes, and
    /// `inputs` is a positive multiple of [`ROUND`].
    panel_sums, Sums, 16,
    "vstrw.32 q0, [r2], #16"
}

panel! {
    /// Raises the maxima of a panel's outputs to its sums for a block of points.
    ///
    /// # Safety
    /// As for [`panel_sums`].
    panel_max, [i32; PANEL], 4,
    "ldr lr, [r2]",
    "vmaxv.s32 lr, q0",
    "str lr, [r2], #4"
}

panel! {
    /// As [`panel_max`], for sums marked with their rows ([`portable::marked`]).
    ///
    /// # Safety
    /// As for [`panel_sums`].
    panel_marked_max, [i32; PANEL], 4,
    "vldrw.u32 q1, [r12, #32]",
    "vshl.i32 q0, q0, #8",
    "vorr q0, q0, q1",
    "ldr lr, [r2]",
    "vmaxv.s32 lr, q0",
    "str lr, [r2], #4"
}

panel! {
    /// Writes codes of a panel's outputs: `R(a)` clamped to 0..=255 ([`crate::quant`]), a byte each, at `places` from `out` on.
    ///
    /// As for [`panel_sums`]; `scales` of the block points to the bias and requantisation of the panel's outputs, and `places`
    /// to room for as many codes of each row.
    panel_codes_of, u8, 1,
    "ldrd r4, r6, [r12, #48]",
    "ldr r8, [r4], #4",
    "ldr r10, [r6], #4",
    "strd r4, r6, [r12, #48]",
    "vadd.i32 q0, q0, r8",
    "uxth r4, r10",
    "vmul.i32 q0, q0, r4",
    "lsrs r10, r10, #16",
    "rsbs r10, r10, #0",
    "vrshl.s32 q0, r10", // right, with rounding
    "vmov.i32 q1, #0",
    "vmax.s32 q0, q0, q1",
    "vmov.i32 q1, #255",
    "vmin.s32 q0, q0, q1",
    "vldrw.u32 q1, [r12, #56]",
    "vstrb.32 q0, [r2, q1]",
    "adds r2, #1"
}

const _: () = assert!(portable::ROW_BITS == 8);

/// A panel's weights from column `from` on.
pub(super) fn panel_codes<'a>(
    layer: &Codes<'a>,
    panel: usize,
    from: usize,
    inputs: usize,
) -> Option<&'a [i8]> {
    let at = (panel * layer.inputs() + from) * PANEL;
    layer.panels().get(at..at + inputs * PANEL)
}

/// As [`portable::dense_codes_max`].
pub(in crate::kernels) unsafe fn dense_codes_max<const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    let inputs = layer.inputs();
    for (round, x) in x.chunks((POINTS * inputs).max(1)).enumerate() {
        let Some(mut block) = Block::of(x, inputs) else {
            return;
        };
        // A repeated last row has a later mark, with which it never wins.
        block.marks = core::array::from_fn(|n| portable::row_mark(round * POINTS + n));
        let maxima = max.as_chunks_mut::<PANEL>().0.iter_mut();
        for (panel, max) in panels.clone().zip(maxima.skip(panels.start)) {
            let Some(weights) = panel_codes(layer, panel, 0, inputs) else {
                return;
            };
            // SAFETY: one panel of a layer of a multiple of 64 inputs, rows as long, and its maxima.
            unsafe {
                if MARK {
                    panel_marked_max(weights.as_ptr(), &raw mut block, max, inputs);
                } else {
                    panel_max(weights.as_ptr(), &raw mut block, max, inputs);
                }
            }
        }
    }
}

/// As [`portable::dense_codes`].
pub(in crate::kernels) unsafe fn dense_codes(
    layer: &Codes<'_>,
    bias: &[i32],
    requantise: &[u32],
    x: &[u8],
    y: &mut [u8],
) {
    let (inputs, outputs) = (layer.inputs().max(1), layer.outputs().max(1));
    let blocks = x.chunks((POINTS * inputs).max(1));
    for (x, y) in blocks.zip(y.chunks_mut((POINTS * outputs).max(1))) {
        let Some(mut block) = Block::of(x, inputs) else {
            return;
        };
        // The codes of a repeated row overwrite those of the last row, which are the same.
        let rows = (y.len() / outputs).min(x.len() / inputs);
        let Some(last) = rows.checked_sub(1) else {
            return;
        };
        block.places = core::array::from_fn(|n| (n.min(last) * outputs) as u32);
        let scales = bias.as_chunks::<PANEL>().0.iter();
        let scales = scales.zip(requantise.as_chunks::<PANEL>().0);
        for (panel, (bias, requantise)) in scales.enumerate() {
            let Some(weights) = panel_codes(layer, panel, 0, inputs) else {
                return;
            };
            block.scales = [bias.as_ptr().cast(), requantise.as_ptr()];
            let out = y.as_mut_ptr().wrapping_add(panel * PANEL);
            // SAFETY: one panel of a layer of a multiple of 64 inputs, rows as long, and a row of codes for each at least.
            unsafe { panel_codes_of(weights.as_ptr(), &raw mut block, out, inputs) }
        }
    }
}

/// Writes the codes of one point for a panel's outputs: `((b + w₀ x) + w₁ y) + w₂ z`, clamped to 0..=255 and rounded to even.
///
/// Subnormal numbers count as zero here, which changes no code.
///
/// # Safety
/// `weights` holds the three columns of a panel, `bias` and `codes` its outputs; `point` has three coordinates.
#[unsafe(naked)]
unsafe extern "C" fn panel_point_codes(
    weights: *const [[f32; PANEL]; 3],
    bias: *const [f32; PANEL],
    point: *const [f32; 3],
    codes: *mut [u8; PANEL],
) {
    naked_asm!(
        ".cpu cortex-m55",
        "push {{r4, r5, r6, lr}}",
        "ldm r2, {{r4, r5, r6}}",
        "vmov.i32 q2, #0",
        "movw r2, #0x437f", // 255
        "lsl r2, r2, #16",
        "vdup.32 q3, r2",
        "movw r2, #0x4b40", // 1.5 * 2^23: the last bit of a sum with it stands for 1
        "lsl r2, r2, #16",
        "mov lr, #4",
        "dls lr, lr",
        "2:",
        "vldrw.u32 q0, [r1], #16",
        "vldrw.u32 q1, [r0], #16",
        "vmul.f32 q1, q1, r4",
        "vadd.f32 q0, q0, q1",
        "vldrw.u32 q1, [r0, #48]",
        "vmul.f32 q1, q1, r5",
        "vadd.f32 q0, q0, q1",
        "vldrw.u32 q1, [r0, #112]",
        "vmul.f32 q1, q1, r6",
        "vadd.f32 q0, q0, q1",
        "vmaxnm.f32 q0, q0, q2",
        "vminnm.f32 q0, q0, q3",
        "vadd.f32 q0, q0, r2",
        "vstrb.32 q0, [r3], #4",
        "le lr, 2b",
        "pop {{r4, r5, r6, pc}}",
    )
}

/// As [`portable::point_codes`].
pub(in crate::kernels) unsafe fn point_codes(
    panels: &[f32],
    bias: &[f32],
    points: &[[f32; 3]],
    codes: &mut [u8],
) {
    let width = bias.len();
    let columns = panels.as_chunks::<PANEL>().0.as_chunks::<3>().0;
    for (point, codes) in points.iter().zip(codes.chunks_exact_mut(width.max(1))) {
        let panels = columns.iter().zip(bias.as_chunks().0);
        for ((weights, bias), codes) in panels.zip(codes.as_chunks_mut().0) {
            // SAFETY: arrays of these lengths.
            unsafe { panel_point_codes(weights, bias, point, codes) }
        }
    }
}

/// As [`portable::gemv_codes`].
pub(in crate::kernels) unsafe fn gemv_codes(
    layer: &Codes<'_>,
    columns: Range<usize>,
    [high, low]: [&[u8]; 2],
    y: &mut [i32],
) {
    let whole = columns.len() / ROUND * ROUND;
    let split = high
        .split_at_checked(whole)
        .zip(low.split_at_checked(whole));
    let Some(((high, high_rest), (low, low_rest))) = split else {
        return;
    };
    if whole > 0 {
        let mut block = Block::new([high, low, low, low]);
        for (panel, y) in y.as_chunks_mut::<PANEL>().0.iter_mut().enumerate() {
            let Some(weights) = panel_codes(layer, panel, columns.start, whole) else {
                return;
            };
            let mut sums: Sums = [[0; POINTS]; PANEL];
            // SAFETY: the caller guarantees these columns of the panel; planes are as long.
            unsafe { panel_sums(weights.as_ptr(), &raw mut block, &raw mut sums, whole) }
            for (y, [high, low, ..]) in y.iter_mut().zip(sums) {
                *y += 64 * high + low;
            }
        }
    }
    let rest = columns.start + whole..columns.end;
    portable::gemv_codes(layer, rest, [high_rest, low_rest], y);
}
