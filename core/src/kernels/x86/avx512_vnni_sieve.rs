//! The last embedding layer in f32 behind an integer sieve, with AVX-512 VNNI. See [`crate::kernels::float::sieve`].
//!
//! Every function requires that AVX-512F, BW and VNNI were detected, that `x` holds `points` rows without negative values, and
//! that `max` is as long as the layer's bias; [`crate::kernels::Isa`] checks all but the sign.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::avx512_vnni::Whole;
use super::avx512_vnni_pruned::{Group, QUADS};
use crate::dims::{PANEL, TILE};
use crate::kernels::byte::pruned::{Bounds, bounds, sums};
use crate::kernels::byte::vector::Sums;
use crate::kernels::float::sieve::{ROUNDING, SieveDense};
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, PANELS, Pruned, Survivors, prune};
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is loaded once for all of them.
const GROUPS: usize = TILE / NEAR;

/// What quantising a group loses.
#[derive(Clone, Copy)]
struct QuantisationError {
    /// `1 / s`: codes in one unit of activation.
    per_unit: f32,
    /// Largest `|h|`, and largest `|dh|`, of its points.
    longest: f32,
    rest: f32,
}

impl QuantisationError {
    const NONE: QuantisationError = QuantisationError {
        per_unit: 0.0,
        longest: 0.0,
        rest: 0.0,
    };
}

/// See [`crate::kernels::Isa::dense_max_sieve`].
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
pub(in crate::kernels) unsafe fn dense_max(
    sieve: &SieveDense<'_>,
    points: usize,
    x: &[f32],
    max: &mut [f32],
) {
    let inputs = sieve.codes.inputs();
    let mut codes = [Group::ZERO; GROUPS];
    let mut doubts = [QuantisationError::NONE; GROUPS];
    for x in x[..points * inputs].chunks(GROUPS * NEAR * inputs) {
        let mut count = 0;
        for rows in x.chunks(NEAR * inputs) {
            let mut bytes = [0; NEAR * INPUTS];
            let bytes = &mut bytes[..rows.len()];
            // SAFETY: rows of `inputs` values, a multiple of 64 up to `INPUTS`.
            unsafe {
                doubts[count] = quantise(inputs, rows, bytes);
                Whole::fill(&mut codes[count], inputs, bytes);
            }
            count += 1;
        }
        let mut groups = Groups {
            sieve,
            x,
            rows: x.len() / inputs,
            codes: &codes,
            doubts: &doubts,
            known: [[Limits::NONE; PANELS]; GROUPS],
            max: max.as_mut_ptr(),
        };
        // SAFETY: as the caller guarantees.
        unsafe { prune::<1, GROUPS>(sieve.codes.outputs() / PANEL, count, &mut groups) }
    }
}

/// Some groups, and the maxima that they may raise.
struct Groups<'a> {
    sieve: &'a SieveDense<'a>,
    /// Their rows, and how many.
    x: &'a [f32],
    rows: usize,
    codes: &'a [Group; GROUPS],
    doubts: &'a [QuantisationError; GROUPS],
    /// Limits for the panels at hand.
    known: [[Limits; PANELS]; GROUPS],
    max: *mut f32,
}

impl Pruned<GROUPS> for Groups<'_> {
    #[inline(always)]
    unsafe fn bound(&mut self, panel: usize, survivors: &mut [Survivors; GROUPS]) {
        // SAFETY: the caller guarantees the panel, its maxima and its factors.
        unsafe {
            let weights = Whole::weights(&self.sieve.codes, panel, &());
            let bounds = bounds::<Whole, QUADS, GROUPS>(&self.sieve.codes, weights, self.codes);
            for group in 0..GROUPS {
                let limits = &mut self.known[group][panel % PANELS];
                let lowest = limits.find(self.sieve, panel, &self.doubts[group], self.max);
                let higher = bounds[group].exceeds(Whole(lowest));
                Whole::add_channels(panel, higher, &mut survivors[group]);
            }
        }
    }

    #[inline(always)]
    unsafe fn raise(&mut self, group: usize, channels: &[u16; CHANNELS]) {
        let inputs = self.sieve.codes.inputs();
        // SAFETY: the caller guarantees the group, whose rows are there, and the channels.
        unsafe {
            let codes = self.codes.get_unchecked(group);
            let known = self.known.get_unchecked(group);
            let sums = sums::<Whole, QUADS, CHANNELS>(&self.sieve.codes, &(), codes, channels);
            for (sum, &channel) in sums.into_iter().zip(channels) {
                let channel = usize::from(channel);
                let limits = &known[channel / PANEL % PANELS];
                let mut open = sum.exceeds(Whole::splat(limits.lowest[channel % PANEL]));
                if open.count_ones() > 1 {
                    let highest = _mm512_reduce_max_epi32(sum.0) - limits.between[channel % PANEL];
                    open &= sum.exceeds(Whole::splat(highest));
                }
                let max = &mut *self.max.add(channel);
                let mut most = *max;
                while open != 0 {
                    let row = (group * NEAR + open.trailing_zeros() as usize).min(self.rows - 1);
                    let value = sum_of(self.sieve, channel, self.x.as_ptr().add(row * inputs));
                    most = if value > most { value } else { most };
                    open &= open - 1;
                }
                *max = most;
            }
        }
    }
}

/// The output of a channel for a row, in f32.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn sum_of(sieve: &SieveDense<'_>, channel: usize, row: *const f32) -> f32 {
    let inputs = sieve.codes.inputs();
    // SAFETY: the caller guarantees the channel, and a row of `inputs` values, a multiple of 64.
    unsafe {
        let weights = sieve.rows.as_ptr().add(channel * inputs);
        let mut sum = [_mm512_setzero_ps(); 4];
        for at in (0..inputs).step_by(64) {
            for (part, sum) in sum.iter_mut().enumerate() {
                let w = _mm512_loadu_ps(weights.add(at + 16 * part));
                *sum = _mm512_fmadd_ps(w, _mm512_loadu_ps(row.add(at + 16 * part)), *sum);
            }
        }
        let [a, b, c, d] = sum;
        let sum = _mm512_add_ps(_mm512_add_ps(a, b), _mm512_add_ps(c, d));
        *sieve.layer.bias().get_unchecked(channel) + _mm512_reduce_add_ps(sum)
    }
}

/// Which integer sums of a panel's channels need f32.
#[derive(Clone, Copy)]
struct Limits {
    /// Points with sums up to this are not above the maximum.
    lowest: [i32; PANEL],
    /// A point whose sum is lower by this much than another point's in the group is not above that point.
    between: [i32; PANEL],
}

impl Limits {
    const NONE: Limits = Limits {
        lowest: [0; PANEL],
        between: [0; PANEL],
    };

    /// Sets the limits for a group; returns the lowest.
    #[target_feature(enable = "avx512f")]
    #[inline]
    unsafe fn find(
        &mut self,
        sieve: &SieveDense<'_>,
        panel: usize,
        doubt: &QuantisationError,
        max: *const f32,
    ) -> __m512i {
        // SAFETY: the caller guarantees the panel.
        unsafe {
            let of = |values: *const f32| _mm512_loadu_ps(values.add(panel * PANEL));
            let by_weights = _mm512_set1_ps(doubt.longest + doubt.rest);
            let by_points = _mm512_set1_ps(doubt.rest + ROUNDING * doubt.longest);
            let margin = _mm512_fmadd_ps(
                of(sieve.rest.as_ptr()),
                by_weights,
                of(sieve.slack.as_ptr()),
            );
            let margin = _mm512_fmadd_ps(of(sieve.norm.as_ptr()), by_points, margin);
            let above = _mm512_sub_ps(of(max), of(sieve.layer.bias().as_ptr()));
            let per_unit =
                _mm512_mul_ps(of(sieve.per_unit.as_ptr()), _mm512_set1_ps(doubt.per_unit));
            // Clamps values beyond any sum, or still unknown, for which the conversion does not matter.
            let units = |value| {
                let value = _mm512_mul_ps(value, per_unit);
                let value = _mm512_max_ps(value, _mm512_set1_ps(-1e9));
                _mm512_min_ps(value, _mm512_set1_ps(1e9))
            };
            let lowest = units(_mm512_sub_ps(above, margin));
            let lowest = _mm512_fnmadd_ps(_mm512_abs_ps(lowest), _mm512_set1_ps(ROUNDING), lowest);
            let lowest = _mm512_sub_epi32(_mm512_cvtps_epi32(lowest), _mm512_set1_epi32(1));
            let between = units(_mm512_mul_ps(margin, _mm512_set1_ps(2.0 + ROUNDING)));
            let between = _mm512_add_epi32(_mm512_cvtps_epi32(between), _mm512_set1_epi32(2));
            _mm512_storeu_si512(self.lowest.as_mut_ptr().cast(), lowest);
            _mm512_storeu_si512(self.between.as_mut_ptr().cast(), between);
            lowest
        }
    }
}

/// Quantises rows in one unit; returns what that loses.
#[target_feature(enable = "avx512f")]
#[inline]
unsafe fn quantise(inputs: usize, rows: &[f32], codes: &mut [u8]) -> QuantisationError {
    // SAFETY: whole registers of whole rows, and as many codes.
    unsafe {
        let mut most = _mm512_setzero_ps();
        for at in (0..rows.len()).step_by(16) {
            most = _mm512_max_ps(most, _mm512_loadu_ps(rows.as_ptr().add(at)));
        }
        let unit = (_mm512_reduce_max_ps(most) / 255.0).max(f32::MIN_POSITIVE);
        let (up, down) = (_mm512_set1_ps(1.0 / unit), _mm512_set1_ps(unit));
        let (mut longest, mut rest) = (0.0f32, 0.0f32);
        for row in (0..rows.len()).step_by(inputs) {
            let (mut squares, mut errors) = (_mm512_setzero_ps(), _mm512_setzero_ps());
            for at in (row..row + inputs).step_by(16) {
                let value = _mm512_loadu_ps(rows.as_ptr().add(at));
                let code = _mm512_cvtps_epi32(_mm512_mul_ps(value, up));
                let error = _mm512_fnmadd_ps(_mm512_cvtepi32_ps(code), down, value);
                squares = _mm512_fmadd_ps(value, value, squares);
                errors = _mm512_fmadd_ps(error, error, errors);
                let code = _mm512_cvtusepi32_epi8(_mm512_max_epi32(code, _mm512_setzero_si512()));
                _mm_storeu_si128(codes.as_mut_ptr().add(at).cast(), code);
            }
            longest = longest.max(_mm512_reduce_add_ps(squares));
            rest = rest.max(_mm512_reduce_add_ps(errors));
        }
        let up = |square: f32| libm::sqrtf(square) * (1.0 + 1e-5);
        QuantisationError {
            per_unit: 1.0 / unit,
            longest: up(longest),
            rest: up(rest),
        }
    }
}
