//! What a trainer needs besides the layers, dispatched to the machine's kernels: the search for critical points and the
//! gradient through them.

#![allow(unsafe_code)]

#[cfg(target_arch = "x86_64")]
use super::{
    Floats, Kind,
    x86::amx,
    x86::avx2_bytes::{avx_vnni, avx2},
    x86::avx512_vnni,
};
use super::{GROUPS, Isa, search};
use crate::dims::PANEL;
use crate::layer::{Codes, padded_codes};

impl Isa {
    /// Quantises non-negative rows to codes 0..=255 with one scale for each row, `x ≈ code * scale`, for [`Isa::search`]. The
    /// same bits on every kernel.
    ///
    /// # Shapes
    /// `x [points, width]`, `codes [points, padded_codes(width)]`, `scales [points]`; rows beyond the
    /// shortest are left alone.
    pub fn quantise_rows(self, width: usize, x: &[f32], codes: &mut [u8], scales: &mut [f32]) {
        let stride = padded_codes(width);
        if width == 0 {
            return;
        }
        match self.floats() {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe {
                search::quantise_avx2(width, stride, x, codes, scales);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe {
                search::quantise_avx512(width, stride, x, codes, scales);
            },
            _ => search::quantise(width, stride, x, codes, scales),
        }
    }

    /// Finds, for each output, the point with the highest score in each of [`GROUPS`] groups of
    /// points (point `n` is in group `n % GROUPS`): `score = scales[n] * Σ codes[n] weight`.
    /// The first of equals wins; the result is the same on every kernel.
    ///
    /// # Shapes
    /// `codes [points, layer.inputs()]`, `scales [points]`, `best` and `winner [GROUPS, layer.outputs()]`,
    /// overwritten; other lengths leave both as they are.
    pub fn search(
        self,
        layer: &Codes<'_>,
        codes: &[u8],
        scales: &[f32],
        best: &mut [f32],
        winner: &mut [u32],
    ) {
        let results = GROUPS * layer.outputs();
        let points = scales.len();
        if Some(codes.len()) != points.checked_mul(layer.inputs())
            || best.len() != results
            || winner.len() != results
        {
            return;
        }
        best.fill(f32::NEG_INFINITY);
        winner.fill(0);
        let mut first = 0;
        while first < points {
            let tile = first..(first + search::TILE).min(points);
            first = tile.end;
            let panels = 0..layer.outputs() / PANEL;
            match self.0 {
                // SAFETY: the instruction set was detected, lengths were checked above.
                #[cfg(target_arch = "x86_64")]
                Kind::Avx2 | Kind::Avx512 => unsafe {
                    avx2::search(layer, tile.start, tile, panels, codes, scales, best, winner);
                },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Kind::AvxVnni => unsafe {
                    avx_vnni::search(layer, tile.start, tile, panels, codes, scales, best, winner);
                },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Kind::Avx512Vnni => unsafe {
                    avx512_vnni::search(
                        layer, tile.start, tile, panels, codes, scales, best, winner,
                    );
                },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Kind::Amx => unsafe {
                    amx::search(layer, tile, panels, codes, scales, best, winner);
                },
                _ => {
                    search::portable(layer, tile, panels, codes, scales, best, winner);
                }
            }
        }
    }

    /// Computes the outputs of [`Isa::search`]'s winners in f32, and keeps the best of each output's groups.
    ///
    /// # Shapes
    /// `rows [outputs, width]`, `bias` and `feature [outputs]`, `hidden [points, width]`,
    /// `winner [GROUPS, outputs]`, whose first row becomes the result; other lengths leave both as they are.
    pub fn winners(
        self,
        width: usize,
        rows: &[f32],
        bias: &[f32],
        hidden: &[f32],
        winner: &mut [u32],
        feature: &mut [f32],
    ) {
        let outputs = bias.len();
        if width == 0
            || rows.len() != outputs * width
            || winner.len() != GROUPS * outputs
            || feature.len() != outputs
        {
            return;
        }
        match self.floats() {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe {
                search::winners_avx2(width, rows, bias, hidden, winner, feature);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe {
                search::winners_avx512(width, rows, bias, hidden, winner, feature);
            },
            _ => search::winners(width, rows, bias, hidden, winner, feature),
        }
    }

    /// Gradient of a layer whose outputs are maxima over points: output `o` has the gradient `gradient[o]` at point `row[o]`
    /// and none elsewhere. Adds to the gradients of the weights and of the inputs; the same bits on every kernel.
    ///
    /// # Shapes
    /// `row` and `gradient [outputs]`, `hidden` and `hidden_gradient [points, width]`, `weight` and
    /// `weight_gradient [outputs, width]`; rows out of bounds are skipped.
    pub fn max_backward(
        self,
        width: usize,
        row: &[u32],
        gradient: &[f32],
        (hidden, weight): (&[f32], &[f32]),
        (weight_gradient, hidden_gradient): (&mut [f32], &mut [f32]),
    ) {
        if width == 0 {
            return;
        }
        let layer = search::MaxBackward {
            width,
            row,
            gradient,
            hidden,
            weight,
        };
        match self.floats() {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx2 => unsafe {
                search::max_backward_avx2(layer, weight_gradient, hidden_gradient);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Floats::Avx512 => unsafe {
                search::max_backward_avx512(layer, weight_gradient, hidden_gradient);
            },
            _ => search::max_backward(layer, weight_gradient, hidden_gradient),
        }
    }
}
