//! Kernels of x86-64.

/// Entries of one instruction set into the algorithms of [`super::byte`], since `#[target_feature]` takes no parameter. They
/// fix the size of blocks, panels by points, and how many panels meet a single vector at once.
macro_rules! entries {
    ($features:literal, $vector:ty, $panels:literal by $points:expr, $gemv:literal of a vector) => {
        // SAFETY (all): where the instruction set was detected, and as the algorithms ask.
        #[target_feature(enable = $features)]
        #[allow(clippy::too_many_arguments)]
        pub(in crate::kernels) unsafe fn search(
            layer: &crate::layer::Codes<'_>,
            tile: usize,
            points: core::ops::Range<usize>,
            panels: core::ops::Range<usize>,
            codes: &[u8],
            scales: &[f32],
            best: &mut [f32],
            winner: &mut [u32],
        ) {
            unsafe {
                crate::kernels::byte::search::search::<$vector, $panels, { $points }>(
                    layer, tile, points, panels, codes, scales, best, winner,
                );
            }
        }

        #[target_feature(enable = $features)]
        pub(in crate::kernels) unsafe fn dense_codes_max<const MARK: bool>(
            layer: &crate::layer::Codes<'_>,
            panels: core::ops::Range<usize>,
            x: &[u8],
            first: usize,
            max: &mut [i32],
        ) {
            unsafe {
                crate::kernels::byte::dense::max::<$vector, MARK, $panels, { $points }>(
                    layer, panels, x, first, max,
                );
            }
        }

        #[target_feature(enable = $features)]
        pub(in crate::kernels) unsafe fn dense_codes(
            layer: &crate::layer::Codes<'_>,
            bias: &[i32],
            requantise: &[u32],
            x: &[u8],
            y: &mut [u8],
        ) {
            unsafe {
                crate::kernels::byte::dense::codes::<$vector, { $points }>(
                    layer, bias, requantise, x, y,
                );
            }
        }

        #[target_feature(enable = $features)]
        pub(in crate::kernels) unsafe fn gemv_codes(
            layer: &crate::layer::Codes<'_>,
            columns: core::ops::Range<usize>,
            planes: [&[u8]; 2],
            y: &mut [i32],
        ) {
            unsafe {
                crate::kernels::byte::dense::gemv::<$vector, $gemv>(layer, columns, planes, y);
            }
        }
    };
}

pub(super) mod amx;
pub(super) mod amx_split;
pub(super) mod avx2;
pub(super) mod avx2_bytes;
pub(super) mod avx2_bytes_pruned;
pub(super) mod avx2_bytes_wide;
pub(super) mod avx512;
pub(super) mod avx512_vnni;
pub(super) mod avx512_vnni_pruned;
pub(super) mod avx512_vnni_sieve;
pub(super) mod detect;
pub(super) mod lanes;
