//! Layers in 8-bit integers, dispatched to the machine's kernels. All give the same bits.

#![allow(unsafe_code)]

#[cfg(any(arm_kernels = "neon", wasm_kernels = "simd128", target_arch = "x86_64"))]
pub(super) mod dense;
pub(super) mod portable;
#[cfg(target_arch = "x86_64")]
pub(super) mod pruned;
#[cfg(target_arch = "x86_64")]
pub(super) mod search;
#[cfg(any(arm_kernels = "neon", wasm_kernels = "simd128", target_arch = "x86_64"))]
pub(super) mod vector;

#[cfg(arm_kernels = "neon")]
use super::aarch64::bytes as neon_bytes;
#[cfg(wasm_kernels = "simd128")]
use super::wasm::bytes as wasm_bytes;
use super::{Isa, Kind};
#[cfg(arm_kernels = "dsp")]
use super::{arm_m::dsp, arm_m::dsp_near};
#[cfg(arm_kernels = "helium")]
use super::{arm_m::helium, arm_m::helium_near};
#[cfg(target_arch = "x86_64")]
use super::{
    pruned::fits,
    x86::avx2_bytes::{avx_vnni, avx2},
    x86::{amx, avx2_bytes_pruned, avx2_bytes_wide, avx512_vnni, avx512_vnni_pruned},
};
use crate::dims::{PANEL, PANELS_MARKED};
use crate::layer::{Codes, Dense, QuantLayer};
use portable::{INPUTS, ROW_BITS, ROWS, row_of};

impl Isa {
    /// First layer of an integer network: from points as seen to codes (step 1 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `points [N, 3]`, `codes [N, outputs]`; rows beyond either are left alone, and all rows of a layer without three inputs.
    pub fn point_codes(self, layer: &Dense<'_>, points: &[[f32; 3]], codes: &mut [u8]) {
        if layer.inputs() != 3 {
            return;
        }
        let (panels, bias) = (layer.panels(), layer.bias());
        match self.0 {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                portable::point_codes_avx2(panels, bias, points, codes);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                portable::point_codes_avx512(panels, bias, points, codes);
            },
            // SAFETY: as above, for the processor that this is compiled for.
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => unsafe { helium::point_codes(panels, bias, points, codes) },
            _ => portable::point_codes(panels, bias, points, codes),
        }
    }

    /// An integer layer from codes to codes (step 2 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `x [points, inputs]`, `y [points, outputs]`; rows beyond either are left alone.
    pub fn dense_codes(self, layer: &QuantLayer<'_>, x: &[u8], y: &mut [u8]) {
        let (codes, bias, requantise) = (layer.codes(), layer.bias(), layer.requantise());
        match self.0 {
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => unsafe {
                avx2::dense_codes(codes, bias, requantise, x, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe {
                avx_vnni::dense_codes(codes, bias, requantise, x, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni | Kind::Amx => unsafe {
                avx512_vnni::dense_codes(codes, bias, requantise, x, y);
            },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Kind::Neon => unsafe {
                neon_bytes::dense_codes::<false>(codes, bias, requantise, x, y)
            },
            // SAFETY: as above.
            #[cfg(arm_kernels = "neon")]
            Kind::NeonDot => unsafe {
                neon_bytes::dense_codes::<true>(codes, bias, requantise, x, y)
            },
            // SAFETY: as above, for the processor that this is compiled for.
            #[cfg(arm_kernels = "dsp")]
            Kind::Dsp => unsafe { dsp::dense_codes(codes, bias, requantise, x, y) },
            // SAFETY: as above.
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => unsafe { helium::dense_codes(codes, bias, requantise, x, y) },
            // SAFETY: as above; simd128 is part of the target.
            #[cfg(wasm_kernels = "simd128")]
            Kind::Simd128 => unsafe { wasm_bytes::dense_codes(codes, bias, requantise, x, y) },
            Kind::Portable => portable::dense_codes(codes, bias, requantise, x, y),
        }
    }

    /// `max[o] = max(max[o], max over rows of (W x)[o])` in integers (step 3 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; another length of `max` leaves it as it is.
    pub fn dense_codes_max(self, layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
        self.raise::<false>(layer, x, max);
    }

    /// Whether [`Isa::dense_codes_max_near`] runs faster on points in spatial order.
    pub(crate) fn prunes_codes(self) -> bool {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 | Kind::Avx512Vnni => true,
            _ => false,
        }
    }

    /// As [`Isa::dense_codes_max`], but faster if consecutive points are close: it skips sums that cannot raise a maximum.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; another length of `max` leaves it as it is.
    pub fn dense_codes_max_near(self, layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
        if max.len() != layer.outputs() {
            return;
        }
        match self.0 {
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni if fits(layer.inputs(), layer.outputs()) => unsafe {
                avx512_vnni_pruned::dense_codes_max(layer, x, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 if fits(layer.inputs(), layer.outputs()) => unsafe {
                avx2_bytes_pruned::dense_codes_max(layer, x, max);
            },
            // SAFETY: as above, for the processor that this is compiled for.
            #[cfg(arm_kernels = "dsp")]
            Kind::Dsp => unsafe { dsp_near::dense_codes_max_near(layer, x, max) },
            // SAFETY: as above.
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => unsafe { helium_near::dense_codes_max_near(layer, x, max) },
            _ => self.dense_codes_max(layer, x, max),
        }
    }

    /// As [`Isa::dense_codes_max`], and calls `won(o, row)` for each raised maximum, with the first row that reaches it.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; another length of `max`, or more than 128 inputs, leaves it as it is.
    #[inline(never)] // where stacks are small, others have its place
    pub fn dense_codes_argmax(
        self,
        layer: &Codes<'_>,
        x: &[u8],
        max: &mut [i32],
        mut won: impl FnMut(usize, usize),
    ) {
        if max.len() != layer.outputs() || layer.inputs() > INPUTS {
            return;
        }
        for (round, x) in x.chunks((ROWS * layer.inputs()).max(1)).enumerate() {
            for (first, part) in layer.parts(PANELS_MARKED) {
                let mut marked = [i32::MIN; PANELS_MARKED * PANEL];
                let Some(marked) = marked.get_mut(..part.outputs()) else {
                    return;
                };
                self.raise::<true>(&part, x, marked);
                for ((o, max), &marked) in max.iter_mut().enumerate().skip(first).zip(&*marked) {
                    let sum = marked >> ROW_BITS;
                    if sum > *max {
                        *max = sum;
                        won(o, round * ROWS + row_of(marked));
                    }
                }
            }
        }
    }

    /// Raises maxima to sums, or to marked sums ([`portable::marked`]).
    #[inline]
    fn raise<const MARK: bool>(self, layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
        if max.len() != layer.outputs() {
            return;
        }
        let panels = 0..layer.outputs() / PANEL;
        match self.0 {
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => unsafe {
                avx2_bytes_wide::dense_codes_max::<MARK>(layer, panels, x, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe {
                avx_vnni::dense_codes_max::<MARK>(layer, panels, x, 0, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => unsafe {
                avx512_vnni::dense_codes_max::<MARK>(layer, panels, x, 0, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Amx => unsafe { amx::dense_codes_max::<MARK>(layer, panels, x, max) },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Kind::Neon => unsafe {
                neon_bytes::dense_codes_max::<false, MARK>(layer, panels, x, max)
            },
            // SAFETY: as above.
            #[cfg(arm_kernels = "neon")]
            Kind::NeonDot => unsafe {
                neon_bytes::dense_codes_max::<true, MARK>(layer, panels, x, max)
            },
            // SAFETY: as above, for the processor that this is compiled for.
            #[cfg(arm_kernels = "dsp")]
            Kind::Dsp => unsafe { dsp::dense_codes_max::<MARK>(layer, panels, x, max) },
            // SAFETY: as above.
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => unsafe { helium::dense_codes_max::<MARK>(layer, panels, x, max) },
            // SAFETY: as above; simd128 is part of the target.
            #[cfg(wasm_kernels = "simd128")]
            Kind::Simd128 => unsafe { wasm_bytes::dense_codes_max::<MARK>(layer, panels, x, max) },
            Kind::Portable => portable::dense_codes_max(MARK, layer, panels, x, max),
        }
    }

    /// `y += W[:, from..from + n] x` in integers, for codes of 13 bits in two planes of `n` bytes,
    /// `x = 64 high + low`, `high` below 128 and `low` below 64 (step 4 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `planes [n]` each, `from` and `n` multiples of 4 with `from + n <= inputs`, `y [outputs]`; others
    /// leave `y` as it is.
    pub fn gemv_codes(self, layer: &Codes<'_>, from: usize, planes: [&[u8]; 2], y: &mut [i32]) {
        let [high, low] = planes;
        let Some(end) = from.checked_add(high.len()) else {
            return;
        };
        let columns = from..end;
        if y.len() != layer.outputs()
            || high.len() != low.len()
            || columns.end > layer.inputs()
            || !from.is_multiple_of(4)
            || !high.len().is_multiple_of(4)
        {
            return;
        }
        match self.0 {
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => unsafe {
                avx2::gemv_codes(layer, columns, planes, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe {
                avx_vnni::gemv_codes(layer, columns, planes, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni | Kind::Amx => unsafe {
                avx512_vnni::gemv_codes(layer, columns, planes, y);
            },
            // SAFETY: as above; NEON is part of the target.
            #[cfg(arm_kernels = "neon")]
            Kind::Neon => unsafe { neon_bytes::gemv_codes::<false>(layer, columns, planes, y) },
            // SAFETY: as above.
            #[cfg(arm_kernels = "neon")]
            Kind::NeonDot => unsafe { neon_bytes::gemv_codes::<true>(layer, columns, planes, y) },
            // SAFETY: as above, for the processor that this is compiled for.
            #[cfg(arm_kernels = "dsp")]
            Kind::Dsp => unsafe { dsp::gemv_codes(layer, columns, planes, y) },
            // SAFETY: as above.
            #[cfg(arm_kernels = "helium")]
            Kind::Helium => unsafe { helium::gemv_codes(layer, columns, planes, y) },
            // SAFETY: as above; simd128 is part of the target.
            #[cfg(wasm_kernels = "simd128")]
            Kind::Simd128 => unsafe { wasm_bytes::gemv_codes(layer, columns, planes, y) },
            Kind::Portable => portable::gemv_codes(layer, columns, planes, y),
        }
    }
}
