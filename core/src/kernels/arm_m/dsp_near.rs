//! The last embedding layer over points that lie close together, with `smlad`: see [`super::near`].
#![allow(unsafe_code, clippy::indexing_slicing)]

use super::dsp::{BLOCK, Block, Pairs, fits, spread, sums};
use super::near::{Bounds, INPUTS, MASKS, Masks, NEAR, lanes};
use crate::dims::{PANEL, QUAD};
use crate::kernels::byte::portable;
use crate::layer::Codes;
use core::arch::{asm, naked_asm};

/// Four inputs: the lowest codes, and the ranges up to the highest.
type Spread = [Pairs; 2];

/// A bit for each of a panel's outputs whose bound is above the maximum.
///
/// # Safety
/// `weights` holds a panel's groups of four codes, one for each of `bounds` to `end`, whose number is a positive multiple of
/// four; `max` holds the panel's maxima.
#[unsafe(naked)]
unsafe extern "C" fn panel_bounds(
    weights: *const i8,
    bounds: *const Spread,
    end: *const Spread,
    max: *const i32,
) -> u32 {
    naked_asm!(
        "push {{r4-r11, lr}}",
        "movw r10, #0x8000", // shifted out after sixteen outputs
        "2:",
        "mov r11, r1",
        "mov lr, #0",
        "3:",
        ".rept 4",
        "ldr r8, [r0], #64",
        "ldm r11!, {{r4, r5, r6, r7}}",
        "sxtb16 r9, r8",
        "sxtb16 r8, r8, ror #8",
        "smlad lr, r4, r9, lr",
        "smlad lr, r5, r8, lr",
        "usat16 r9, #15, r9", // negative values to 0
        "usat16 r8, #15, r8",
        "smlad lr, r6, r9, lr",
        "smlad lr, r7, r8, lr",
        ".endr",
        "cmp r11, r2",
        "bne 3b",
        // To the first group of the next output.
        "sub r4, r2, r1",
        "sub r0, r0, r4, lsl #2",
        "add r0, r0, #4",
        "ldr r4, [r3], #4",
        "cmp lr, r4",
        "it gt",
        "orrgt r10, r10, #0x10000",
        "lsrs r10, r10, #1",
        "bcc 2b",
        "mov r0, r10",
        "pop {{r4-r11, pc}}",
    )
}

/// As [`portable::dense_codes_max`], but faster if consecutive rows are similar.
pub(in crate::kernels) unsafe fn dense_codes_max_near(
    layer: &Codes<'_>,
    x: &[u8],
    max: &mut [i32],
) {
    let (inputs, panels) = (layer.inputs(), layer.outputs() / PANEL);
    if !fits(inputs) || panels > MASKS {
        return portable::dense_codes_max(false, layer, 0..panels, x, max);
    }
    let whole = x.len() / inputs.max(1) * inputs;
    let rows = x.get(..whole).unwrap_or(&[]);
    for x in rows.chunks((NEAR * inputs).max(1)) {
        let masks = masks(layer, x, max);
        raise(layer, &masks, x, max);
    }
}

/// Outputs for which these rows must be summed.
#[inline(never)] // its stack is free again before that of the sums is needed
fn masks(layer: &Codes<'_>, x: &[u8], max: &[i32]) -> Masks {
    let inputs = layer.inputs();
    let mut masks = [u16::MAX; MASKS];
    let Some(bounds) = Bounds::of(inputs, max, |bounds| fill(bounds, x, inputs)) else {
        return masks;
    };
    let mut spreads = [[[0; 2]; 2]; INPUTS / QUAD];
    let quads = bounds.low.as_chunks::<QUAD>().0.iter();
    for (place, (low, range)) in spreads
        .iter_mut()
        .zip(quads.zip(bounds.range.as_chunks().0))
    {
        *place = [low, range].map(|&four| spread(u32::from_le_bytes(four)));
    }
    let Some(bounds) = spreads.get(..inputs / QUAD) else {
        return masks;
    };
    let bounds = bounds.as_ptr_range();
    let panels = masks.iter_mut().zip(max.as_chunks::<PANEL>().0);
    for (panel, (mask, max)) in panels.enumerate() {
        let weights = layer.panels().as_ptr().wrapping_add(panel * inputs * PANEL);
        // SAFETY: a panel of a layer of a multiple of 64 inputs, as many bounds, and its maxima.
        *mask = unsafe { panel_bounds(weights, bounds.start, bounds.end, max.as_ptr()) } as u16;
    }
    masks
}

/// Sets the bounds of rows, four inputs at a time; returns the sum of all ranges.
fn fill(bounds: &mut Bounds, x: &[u8], inputs: usize) -> u32 {
    let quads = inputs / QUAD;
    let x = x.as_chunks::<QUAD>().0;
    let lows = bounds.low.as_chunks_mut::<QUAD>().0.iter_mut();
    let ranges = bounds.range.as_chunks_mut::<QUAD>().0.iter_mut();
    let mut sum = 0;
    for (quad, (low, range)) in lows.zip(ranges).take(quads).enumerate() {
        let (mut least, mut most) = (u32::MAX, 0);
        for codes in x.iter().skip(quad).step_by(quads.max(1)) {
            (least, most) = widened(least, most, u32::from_le_bytes(*codes));
        }
        *low = least.to_le_bytes();
        *range = (most - least).to_le_bytes(); // no byte borrows from the next
        sum += range.iter().map(|&x| u32::from(x)).sum::<u32>();
    }
    sum
}

/// The bytewise minimum and maximum of bounds and codes.
#[inline(always)]
fn widened(mut least: u32, mut most: u32, codes: u32) -> (u32, u32) {
    // SAFETY: computes on registers and flags only, by instructions of the target.
    unsafe {
        asm!("usub8 {t}, {x}, {least}", "sel {least}, {least}, {x}",
            "usub8 {t}, {x}, {most}", "sel {most}, {x}, {most}",
            t = out(reg) _, x = in(reg) codes, least = inout(reg) least, most = inout(reg) most,
            options(pure, nomem, nostack));
    }
    (least, most)
}

/// Raises the maxima of the masked outputs to their sums for some rows.
#[inline(never)]
fn raise(layer: &Codes<'_>, masks: &Masks, x: &[u8], max: &mut [i32]) {
    let inputs = layer.inputs();
    let mut block = Block::ZERO;
    for x in x.chunks((BLOCK * inputs).max(1)) {
        block.fill(inputs, x);
        let points = x.len() / inputs.max(1);
        for (panel, (max, &mask)) in max
            .as_chunks_mut::<PANEL>()
            .0
            .iter_mut()
            .zip(masks)
            .enumerate()
        {
            for lane in lanes(mask) {
                let Some(best) = max.get_mut(lane) else {
                    continue;
                };
                for (x, points) in block.halves(inputs, points) {
                    let sums = sums(layer, panel * PANEL + lane, x);
                    for &sum in sums.iter().take(points) {
                        *best = sum.max(*best);
                    }
                }
            }
        }
    }
}
