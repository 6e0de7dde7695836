//! The last embedding layer of integers over points that lie close together, with AVX-512 VNNI: four codes to a word, as the
//! weights of a layer are.
#![allow(unsafe_code)]

use super::avx512::channels_of;
use super::avx512_vnni::Whole;
use crate::dims::{PANEL, QUAD};
use crate::kernels::byte::pruned::{self, Bounds};
use crate::kernels::pruned::{CHANNELS, INPUTS, NEAR, Survivors};
use crate::layer::Codes;
use core::arch::x86_64::*;

/// Groups whose bounds are computed together, so that a weight is loaded once for all of them.
const GROUPS: usize = 12;
/// Words of four codes.
pub(in crate::kernels) const QUADS: usize = INPUTS / QUAD;

/// Codes of [`NEAR`] points, four inputs at a time.
pub(in crate::kernels) type Group = pruned::Group<QUADS>;

// SAFETY (all): as `Bounds` asks.
impl Bounds<QUADS> for Whole {
    type Spread = ();
    const NONE: () = ();

    #[inline(always)]
    unsafe fn fill(group: &mut Group, inputs: usize, rows: &[u8]) {
        unsafe { fill(group, inputs, rows) }
    }

    #[inline(always)]
    unsafe fn spread(_: &Codes<'_>, _: usize, (): &mut ()) {}

    #[inline(always)]
    unsafe fn weights(layer: &Codes<'_>, panel: usize, (): &()) -> *const i32 {
        let weights = layer.panels().as_ptr();
        unsafe { weights.add(panel * layer.inputs() * PANEL).cast() }
    }

    #[inline(always)]
    unsafe fn add_words(self, Whole(codes): Self, Whole(weights): Self) -> Self {
        Whole(unsafe { _mm512_dpbusd_epi32(self.0, codes, weights) })
    }

    #[inline(always)]
    unsafe fn add_extremes(self, high: Self, low: Self, weights: Self) -> Self {
        unsafe {
            let negative = _mm512_movepi8_mask(weights.0);
            let extremes = _mm512_mask_blend_epi8(negative, high.0, low.0);
            self.add_words(Whole(extremes), weights)
        }
    }

    #[inline(always)]
    unsafe fn exceeds(self, other: Self) -> u16 {
        unsafe { _mm512_cmpgt_epi32_mask(self.0, other.0) }
    }

    #[inline(always)]
    unsafe fn raise(self, max: &mut i32) {
        unsafe {
            if _mm512_cmpgt_epi32_mask(self.0, _mm512_set1_epi32(*max)) != 0 {
                *max = _mm512_reduce_max_epi32(self.0);
            }
        }
    }

    #[inline(always)]
    unsafe fn add_channels(panel: usize, mask: u16, survivors: &mut Survivors) {
        unsafe { channels_of(panel, mask, survivors) }
    }
}

/// See [`Bounds::fill`].
#[target_feature(enable = "avx512f,avx512bw")]
unsafe fn fill(group: &mut Group, inputs: usize, rows: &[u8]) {
    let last = rows.len() / inputs - 1;
    // SAFETY: rows of `inputs` bytes, a multiple of 64 up to `INPUTS`.
    unsafe {
        for part in 0..inputs / 64 {
            let row = |lane: usize| {
                let row = rows.as_ptr().add(lane.min(last) * inputs + part * 64);
                _mm512_loadu_si512(row.cast())
            };
            let rows: [__m512i; NEAR] = core::array::from_fn(row);
            let (mut high, mut low) = (rows[0], rows[0]);
            for &row in &rows[1..] {
                high = _mm512_max_epu8(high, row);
                low = _mm512_min_epu8(low, row);
            }
            _mm512_storeu_si512(group.high.as_mut_ptr().add(part * 16).cast(), high);
            _mm512_storeu_si512(group.low.as_mut_ptr().add(part * 16).cast(), low);
            for (quad, points) in transposed(rows).into_iter().enumerate() {
                let to = group.points.as_mut_ptr().add(part * 16 + quad);
                _mm512_storeu_si512(to.cast(), points);
            }
        }
    }
}

/// Transposes a 16 x 16 matrix of 32-bit values.
#[target_feature(enable = "avx512f")]
#[inline]
fn transposed(rows: [__m512i; 16]) -> [__m512i; 16] {
    let mut pairs = rows;
    for i in 0..8 {
        pairs[2 * i] = _mm512_unpacklo_epi32(rows[2 * i], rows[2 * i + 1]);
        pairs[2 * i + 1] = _mm512_unpackhi_epi32(rows[2 * i], rows[2 * i + 1]);
    }
    // Four rows at a time: columns 0, 1, 2, 3 of each 128-bit part.
    let mut fours = pairs;
    for i in 0..4 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|j| pairs[4 * i + j]);
        fours[4 * i] = _mm512_unpacklo_epi64(a, c);
        fours[4 * i + 1] = _mm512_unpackhi_epi64(a, c);
        fours[4 * i + 2] = _mm512_unpacklo_epi64(b, d);
        fours[4 * i + 3] = _mm512_unpackhi_epi64(b, d);
    }
    let mut columns = fours;
    for column in 0..4 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| fours[4 * i + column]);
        let (ab_even, ab_odd) = (
            _mm512_shuffle_i32x4::<0b10_00_10_00>(a, b),
            _mm512_shuffle_i32x4::<0b11_01_11_01>(a, b),
        );
        let (cd_even, cd_odd) = (
            _mm512_shuffle_i32x4::<0b10_00_10_00>(c, d),
            _mm512_shuffle_i32x4::<0b11_01_11_01>(c, d),
        );
        columns[column] = _mm512_shuffle_i32x4::<0b10_00_10_00>(ab_even, cd_even);
        columns[4 + column] = _mm512_shuffle_i32x4::<0b10_00_10_00>(ab_odd, cd_odd);
        columns[8 + column] = _mm512_shuffle_i32x4::<0b11_01_11_01>(ab_even, cd_even);
        columns[12 + column] = _mm512_shuffle_i32x4::<0b11_01_11_01>(ab_odd, cd_odd);
    }
    columns
}

/// See [`crate::kernels::Isa::dense_codes_max_near`].
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
pub(in crate::kernels) unsafe fn dense_codes_max(layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
    // SAFETY: as the caller guarantees.
    unsafe { pruned::max::<Whole, QUADS, GROUPS, CHANNELS>(layer, x, max) }
}
