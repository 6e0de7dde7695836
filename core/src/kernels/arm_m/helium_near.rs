//! The last embedding layer over points that lie close together, with `vmladava`: see [`super::near`].
#![allow(unsafe_code, clippy::indexing_slicing)]

use super::helium::{Block, POINTS, four_sums, panel_codes};
use super::near::{Bounds, MASKS, Masks, NEAR};
use crate::dims::PANEL;
use crate::kernels::byte::portable;
use crate::layer::Codes;
use core::arch::naked_asm;

/// A bit for each of a panel's outputs whose bound is above the maximum.
///
/// # Safety
/// `weights` holds a panel's groups of `inputs` columns, a positive multiple of 32, `bounds` as many inputs; `start` is
/// `-128 Σ low`; `max` holds the panel's maxima.
#[unsafe(naked)]
unsafe extern "C" fn panel_bounds(
    weights: *const i8,
    bounds: *const Bounds,
    max: *const [i32; PANEL],
    inputs: usize,
    start: i32,
) -> u32 {
    naked_asm!(
        ".cpu cortex-m55",
        "push {{r4-r10, lr}}",
        "vpush {{d8, d9}}",
        "ldr r5, [sp, #48]",
        // Addresses of four groups of one output, less one round of half a loop.
        "movs r4, #0",
        "vidup.u32 q3, r4, #8",
        "vshl.i32 q3, q3, #3",
        "sub r0, r0, #256",
        "vadd.i32 q3, q3, r0",
        "vmov.i32 q4, #0",
        // From the last groups of an output to those before the first of the next.
        "lsl r8, r3, #4",
        "subs r8, #4",
        "lsr r3, r3, #5",
        "mov r9, #128",
        "movw r10, #0x8000", // shifted out after sixteen outputs
        "2:",
        "mov r6, r1",
        "add r7, r1, #{range}",
        "mov r4, r5",
        "dls lr, r3",
        "3:",
        ".rept 2",
        "vldrw.u32 q0, [q3, #256]!",
        "vldrb.u8 q1, [r7], #16",
        "vmax.s8 q2, q0, q4",
        "vmladava.u8 r4, q2, q1",
        "vldrb.u8 q1, [r6], #16",
        "vadd.i8 q0, q0, r9",
        "vmladava.u8 r4, q0, q1",
        ".endr",
        "le lr, 3b",
        "vsub.i32 q3, q3, r8",
        "ldr r12, [r2], #4",
        "cmp r4, r12",
        "it gt",
        "orrgt r10, r10, #0x10000",
        "lsrs r10, r10, #1",
        "bcc 2b",
        "mov r0, r10",
        "vpop {{d8, d9}}",
        "pop {{r4-r10, pc}}",
        range = const core::mem::offset_of!(Bounds, range),
    )
}

/// Raises the maxima of the outputs in `mask`, which sets at least one bit, to their sums for a block of points.
///
/// # Safety
/// `weights` holds a panel's groups of `inputs` columns, a positive multiple of 32, each row of `block` as many codes; `max`
/// holds the panel's maxima.
#[unsafe(naked)]
unsafe extern "C" fn panel_some_max(
    weights: *const i8,
    block: *const Block,
    max: *mut [i32; PANEL],
    inputs: usize,
    mask: u32,
) {
    naked_asm!(
        ".cpu cortex-m55",
        "push {{r4-r11, lr}}",
        "vpush {{d8, d9}}",
        "ldr r11, [sp, #52]",
        // Addresses of four groups of the first output, less one round of half a loop.
        "movs r4, #0",
        "vidup.u32 q4, r4, #8",
        "vshl.i32 q4, q4, #3",
        "sub r0, r0, #256",
        "vadd.i32 q4, q4, r0",
        "mov r0, r3",
        "mov r12, r1",
        "ldrd r1, r3, [r12]",
        "ldrd r5, r7, [r12, #8]",
        "mov r9, #128",
        "2:",
        "rbit r4, r11",
        "clz r4, r4",
        "sub r6, r11, #1",
        "ands r11, r11, r6",
        "lsl r4, r4, #2",
        "vadd.i32 q3, q4, r4",
        "add r4, r2, r4",
        "push {{r4, r11}}",
        four_sums!(),
        "pop {{r4, r11}}",
        "ldr lr, [r4]",
        "vmaxv.s32 lr, q0",
        "str lr, [r4]",
        "subs r1, r1, r0",
        "subs r3, r3, r0",
        "subs r5, r5, r0",
        "subs r7, r7, r0",
        "cmp r11, #0",
        "bne 2b",
        "vpop {{d8, d9}}",
        "pop {{r4-r11, pc}}",
    )
}

/// Sets the bounds of rows; returns the sum of all ranges.
///
/// # Safety
/// `x` holds `rows` rows, at least one, of `inputs` codes, a positive multiple of 16 and at most [`super::near::INPUTS`].
#[unsafe(naked)]
unsafe extern "C" fn fill(bounds: *mut Bounds, x: *const u8, inputs: usize, rows: usize) -> u32 {
    naked_asm!(
        ".cpu cortex-m55",
        "push {{r4, r5, r6, lr}}",
        "movs r4, #0",
        "mov r5, r2",
        "2:",
        "mov r6, r1",
        "vmov.i8 q0, #255",
        "vmov.i8 q1, #0",
        "dls lr, r3",
        "3:",
        "vldrb.u8 q2, [r6]",
        "add r6, r6, r2",
        "vmin.u8 q0, q0, q2",
        "vmax.u8 q1, q1, q2",
        "le lr, 3b",
        "vsub.i8 q1, q1, q0",
        "vaddva.u8 r4, q1",
        "add r6, r0, #{range}",
        "vstrb.8 q1, [r6]",
        "vstrb.8 q0, [r0], #16",
        "adds r1, #16",
        "subs r5, #16",
        "bne 2b",
        "mov r0, r4",
        "pop {{r4, r5, r6, pc}}",
        range = const core::mem::offset_of!(Bounds, range),
    )
}

/// As [`portable::dense_codes_max`], but faster if consecutive rows are similar.
pub(in crate::kernels) unsafe fn dense_codes_max_near(
    layer: &Codes<'_>,
    x: &[u8],
    max: &mut [i32],
) {
    let (inputs, panels) = (layer.inputs(), layer.outputs() / PANEL);
    if panels > MASKS {
        return portable::dense_codes_max(false, layer, 0..panels, x, max);
    }
    let whole = x.len() / inputs.max(1) * inputs;
    let rows = x.get(..whole).unwrap_or(&[]);
    for x in rows.chunks((NEAR * inputs).max(1)) {
        let masks = masks(layer, x, max);
        for x in x.chunks((POINTS * inputs).max(1)) {
            let Some(block) = Block::of(x, inputs) else {
                return;
            };
            let maxima = max.as_chunks_mut::<PANEL>().0.iter_mut().zip(masks);
            for (panel, (max, mask)) in maxima.enumerate().filter(|(_, (_, mask))| *mask != 0) {
                let Some(weights) = panel_codes(layer, panel, 0, inputs) else {
                    return;
                };
                // SAFETY: one panel of a layer of a multiple of 64 inputs, rows as long, and its maxima.
                unsafe {
                    panel_some_max(weights.as_ptr(), &raw const block, max, inputs, mask.into());
                }
            }
        }
    }
}

/// Outputs for which these rows must be summed.
#[inline(never)] // its stack is free again before that of the sums is needed
fn masks(layer: &Codes<'_>, x: &[u8], max: &[i32]) -> Masks {
    let inputs = layer.inputs();
    let mut masks = [u16::MAX; MASKS];
    let Some(bounds) = Bounds::of(inputs, max, |bounds| {
        let rows = x.len() / inputs.max(1);
        // SAFETY: whole rows of a multiple of 64 inputs, at most as many as there is room for.
        unsafe { fill(bounds, x.as_ptr(), inputs, rows) }
    }) else {
        return masks;
    };
    let low = bounds.low.iter().take(inputs);
    let start = -128 * low.map(|&x| i32::from(x)).sum::<i32>();
    let panels = masks.iter_mut().zip(max.as_chunks::<PANEL>().0);
    for (panel, (mask, max)) in panels.enumerate() {
        let Some(weights) = panel_codes(layer, panel, 0, inputs) else {
            break;
        };
        // SAFETY: a panel of a layer of a multiple of 64 inputs, at most as many as there is room for, and its maxima.
        *mask =
            unsafe { panel_bounds(weights.as_ptr(), &raw const bounds, max, inputs, start) } as u16;
    }
    masks
}
