//! The integer network's widest layer with AVX2, 16 outputs by 6 points. Codes of points and weights are spread to 16 bits
//! beforehand, a block of points once for all panels, a panel once for the block. So the loop over inputs has one product and
//! one sum for two inputs of 8 outputs.
//!
//! The same conditions hold as for the other kernels of bytes.
#![allow(unsafe_code, clippy::indexing_slicing, clippy::needless_range_loop)]

use super::avx2_bytes::avx2;
use crate::dims::PANEL;
use crate::dims::QUAD;
use crate::kernels::byte::portable::{ROW_BITS, row_mark};
use crate::layer::Codes;
use core::arch::x86_64::*;
use core::ops::Range;

/// Inputs of the layer that this is made for; the common kernels do the others.
const INPUTS: usize = 128;
/// Points that are spread at a time: 12 KiB.
const BLOCK: usize = 48;
/// Points in one block of sums.
const POINTS: usize = 6;
/// Pairs of inputs in a row.
pub(in crate::kernels) const PAIRS: usize = INPUTS / 2;
/// Outputs in one register.
const LANES: usize = 8;

/// Codes of a block of points, in pairs: of each group of four inputs, the first and third, then the second and fourth.
type Rows = [[u32; PAIRS]; BLOCK];
/// Weights of a panel in the same pairs, `[pair][output][2]`.
pub(in crate::kernels) type Panel = [[i16; 2 * PANEL]; PAIRS];

/// As [`crate::kernels::byte::portable::dense_codes_max`].
#[target_feature(enable = "avx2")]
pub(in crate::kernels) unsafe fn dense_codes_max<const MARK: bool>(
    layer: &Codes<'_>,
    panels: Range<usize>,
    x: &[u8],
    max: &mut [i32],
) {
    if layer.inputs() != INPUTS {
        // SAFETY: as the caller guarantees.
        return unsafe { avx2::dense_codes_max::<MARK>(layer, panels, x, 0, max) };
    }
    let mut rows: Rows = [[0; PAIRS]; BLOCK];
    let mut wide: Panel = [[0; 2 * PANEL]; PAIRS];
    for (round, x) in x.chunks(BLOCK * INPUTS).enumerate() {
        for (row, codes) in rows.iter_mut().zip(x.chunks_exact(INPUTS)) {
            let pairs = row.as_chunks_mut::<2>().0.iter_mut();
            for (pairs, four) in pairs.zip(codes.as_chunks::<QUAD>().0) {
                *pairs = pairs_of(*four);
            }
        }
        let rows = &rows[..x.len() / INPUTS];
        for panel in panels.clone() {
            spread(
                &layer.panels()[panel * INPUTS * PANEL..(panel + 1) * INPUTS * PANEL],
                &mut wide,
            );
            let max = &mut max[panel * PANEL..(panel + 1) * PANEL];
            let (blocks, rest) = rows.as_chunks::<POINTS>();
            let mut n = round * BLOCK;
            for block in blocks {
                raise::<_, MARK>(block, n, &wide, max);
                n += POINTS;
            }
            for row in rest {
                raise::<_, MARK>(core::array::from_ref(row), n, &wide, max);
                n += 1;
            }
        }
    }
}

/// Of four codes, the first and third, then the second and fourth.
#[inline(always)]
pub(in crate::kernels) fn pairs_of(four: [u8; QUAD]) -> [u32; 2] {
    let four = u32::from_le_bytes(four);
    [four & 0x00ff_00ff, four >> 8 & 0x00ff_00ff]
}

/// Spreads the weights of one panel to 16 bits.
#[target_feature(enable = "avx2")]
#[inline]
pub(in crate::kernels) fn spread(weights: &[i8], wide: &mut Panel) {
    let halves = weights.as_chunks::<{ QUAD * LANES }>().0;
    for (i, half) in halves.iter().enumerate() {
        let (pair, at) = (i / 2 * 2, i % 2 * 2 * LANES);
        // SAFETY: 32 bytes are read, and 16 numbers written in each of two slices of that length.
        unsafe {
            let four = _mm256_loadu_si256(half.as_ptr().cast());
            let even = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(four));
            let odd = _mm256_srai_epi16::<8>(four);
            for (k, value) in [even, odd].into_iter().enumerate() {
                let to = &mut wide[pair + k][at..at + 2 * LANES];
                _mm256_storeu_si256(to.as_mut_ptr().cast(), value);
            }
        }
    }
}

/// Raises the maxima of a panel to its sums for `N` rows, numbered from `first`.
#[target_feature(enable = "avx2")]
#[inline]
fn raise<const N: usize, const MARK: bool>(
    rows: &[[u32; PAIRS]; N],
    first: usize,
    wide: &Panel,
    max: &mut [i32],
) {
    let mut sum = [[_mm256_setzero_si256(); 2]; N];
    for k in 0..PAIRS {
        // SAFETY: two registers fill one row of weights.
        let w: [__m256i; 2] = core::array::from_fn(|half| unsafe {
            _mm256_loadu_si256(wide[k].as_ptr().add(half * 2 * LANES).cast())
        });
        for n in 0..N {
            let pair = _mm256_set1_epi32(rows[n][k] as i32);
            for half in 0..2 {
                sum[n][half] = _mm256_add_epi32(sum[n][half], _mm256_madd_epi16(pair, w[half]));
            }
        }
    }
    for half in 0..2 {
        let max = &mut max[half * LANES..(half + 1) * LANES];
        // SAFETY: one register has the length of the slice.
        unsafe {
            let mut best = _mm256_loadu_si256(max.as_ptr().cast());
            for (n, halves) in sum.iter().enumerate() {
                let mut sum = halves[half];
                if MARK {
                    let mark = _mm256_set1_epi32(row_mark(first + n));
                    sum = _mm256_or_si256(_mm256_slli_epi32::<{ ROW_BITS as i32 }>(sum), mark);
                }
                best = _mm256_max_epi32(best, sum);
            }
            _mm256_storeu_si256(max.as_mut_ptr().cast(), best);
        }
    }
}
