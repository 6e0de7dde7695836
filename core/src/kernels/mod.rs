//! Dense kernels, one file per target; the only place with `unsafe`.
//!
//! Three operations cover the network: a dense layer with ReLU over a tile of points, the last
//! embedding layer fused with the max over points (so that 1024 running maxima take the place of a
//! `[1024, N]` buffer), and a matrix-vector product for the heads. Weights come in panels of
//! [`PANEL`] outputs (see [`crate::weights`]); lanes are outputs, and sums run over the inputs in order.
//!
//! Kernels with fused multiply-add round once where the portable one rounds twice: they agree to
//! 1e-5, not bit by bit.

#![allow(unsafe_code, clippy::indexing_slicing)]

use crate::dims::PANEL;
use crate::quant::QuantLayer;
use crate::weights::Dense;

mod bytes;
#[cfg(target_arch = "x86_64")]
mod detect;
mod nearest;
mod neighbours;
mod peak;
mod portable;
mod search;
#[cfg(target_arch = "x86_64")]
mod x86_amx;
#[cfg(target_arch = "x86_64")]
mod x86_avx2;
#[cfg(target_arch = "x86_64")]
mod x86_avx512;
#[cfg(target_arch = "x86_64")]
mod x86_bytes256;
#[cfg(target_arch = "x86_64")]
mod x86_vnni;

pub use nearest::Queries;
pub use neighbours::{BATCH, Batch, Moments};
pub use peak::Arithmetic;
pub use search::{CODES, Codes, GROUPS, pack_codes, padded_codes};

/// Instruction sets, from the slowest to the fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX2 with AVX-VNNI.
    #[cfg(target_arch = "x86_64")]
    AvxVnni,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX-512F with AVX-512 VNNI.
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni,
    /// AVX-512F and VNNI with AMX tiles of bytes.
    #[cfg(target_arch = "x86_64")]
    Amx,
}

/// A set of kernels that this machine is known to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Kind);

impl Isa {
    /// The kernels that run everywhere.
    pub const PORTABLE: Isa = Isa(Kind::Portable);

    /// The fastest kernels of this machine.
    pub fn best() -> Isa {
        Isa::all().last().unwrap_or(Isa::PORTABLE)
    }

    /// All kernels that this machine runs, from the slowest to the fastest.
    #[cfg(target_arch = "x86_64")]
    pub fn all() -> impl Iterator<Item = Isa> {
        [
            (Kind::Portable, 0),
            (Kind::Avx2, detect::AVX2),
            (Kind::AvxVnni, detect::AVX2 | detect::AVX_VNNI),
            (Kind::Avx512, detect::AVX512),
            (Kind::Avx512Vnni, detect::AVX512_VNNI),
            (Kind::Amx, detect::AMX),
        ]
        .into_iter()
        .filter(|(_, needs)| detect::has(*needs))
        .map(|(kind, _)| Isa(kind))
    }

    /// All kernels that this machine runs, from the slowest to the fastest.
    #[cfg(not(target_arch = "x86_64"))]
    pub fn all() -> impl Iterator<Item = Isa> {
        [Isa::PORTABLE].into_iter()
    }

    /// Whether bytes are multiplied faster than floats here, which makes [`Isa::search`] worth its
    /// losses.
    pub fn has_fast_bytes(self) -> bool {
        match self.0 {
            Kind::Portable => false,
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => false,
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni | Kind::Avx512Vnni | Kind::Amx => true,
        }
    }

    /// Name of the instruction set.
    pub fn name(self) -> &'static str {
        match self.0 {
            Kind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2+fma",
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => "avx2+fma+vnni",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512f",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => "avx512f+vnni",
            #[cfg(target_arch = "x86_64")]
            Kind::Amx => "avx512f+vnni+amx",
        }
    }

    /// `y = max(0, W x + b)` for each row of `x`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `y [points, padded outputs]`; rows beyond either are left alone.
    pub fn dense_relu(self, layer: &Dense<'_>, x: &[f32], y: &mut [f32]) {
        let points = rows(layer, x).min(y.len() / layer.bias.len().max(1));
        match self.0 {
            Kind::Portable => portable::dense_relu(layer, points, x, y),
            // SAFETY: `Kind::Avx2` exists only where detection found AVX2 and FMA; `points` rows
            // of `x` and `y` are in bounds as counted above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe { x86_avx2::dense_relu(layer, points, x, y) },
            // SAFETY: as above, with AVX-512F.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                x86_avx512::dense_relu(layer, points, x, y)
            },
        }
    }

    /// `max[o] = max(max[o], max over rows of (W x + b)[o])`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [padded outputs]`; a shorter `max` leaves everything as it is.
    pub fn dense_max(self, layer: &Dense<'_>, x: &[f32], max: &mut [f32]) {
        if max.len() < layer.bias.len() {
            return;
        }
        let points = rows(layer, x);
        match self.0 {
            Kind::Portable => portable::dense_max::<false>(layer, points, x, 0, max, &mut []),
            // SAFETY: features detected; `points` rows of `x` and all of `max` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                x86_avx2::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                x86_avx512::dense_max::<false>(layer, points, x, 0, max, &mut []);
            },
        }
    }

    /// As [`Isa::dense_max`], with `argmax[o]` set to the index of the row that raised `max[o]`
    /// last; rows count from `first`.
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max` and `argmax [padded outputs]`.
    pub fn dense_argmax(
        self,
        layer: &Dense<'_>,
        x: &[f32],
        first: u32,
        max: &mut [f32],
        argmax: &mut [u32],
    ) {
        if max.len() < layer.bias.len() || argmax.len() < layer.bias.len() {
            return;
        }
        let points = rows(layer, x);
        match self.0 {
            Kind::Portable => portable::dense_max::<true>(layer, points, x, first, max, argmax),
            // SAFETY: features detected; `points` rows of `x`, `max` and `argmax` are in bounds.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                x86_avx2::dense_max::<true>(layer, points, x, first, max, argmax);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                x86_avx512::dense_max::<true>(layer, points, x, first, max, argmax);
            },
        }
    }

    /// `y = start + W[:, from..from + len(x)] x`: a product with some of the layer's columns.
    ///
    /// # Shapes
    /// `start` and `y [padded outputs]`, `x [n]` with `from + n <= inputs`; other lengths leave `y`
    /// as it is.
    pub fn gemv(self, layer: &Dense<'_>, start: &[f32], from: usize, x: &[f32], y: &mut [f32]) {
        let outputs = layer.bias.len();
        if y.len() < outputs || start.len() < outputs || from + x.len() > layer.inputs {
            return;
        }
        match self.0 {
            Kind::Portable => portable::gemv(layer, start, from, x, y),
            // SAFETY: features detected; lengths checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe { x86_avx2::gemv(layer, start, from, x, y) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                x86_avx512::gemv(layer, start, from, x, y)
            },
        }
    }

    /// Codes 0..=255 of non-negative rows with one scale each, `x ≈ code * scale`, for
    /// [`Isa::search`]. The same bits on every kernel.
    ///
    /// # Shapes
    /// `x [points, width]`, `codes [points, padded_codes(width)]`, `scales [points]`; rows beyond the
    /// shortest are left alone.
    pub fn quantise_rows(self, width: usize, x: &[f32], codes: &mut [u8], scales: &mut [f32]) {
        let stride = padded_codes(width);
        if width == 0 {
            return;
        }
        match self.0 {
            Kind::Portable => search::quantise(width, stride, x, codes, scales),
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                search::quantise_avx2(width, stride, x, codes, scales);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                search::quantise_avx512(width, stride, x, codes, scales);
            },
        }
    }

    /// Finds the point with the highest score of each output in each of [`GROUPS`] groups of points
    /// (point `n` is of group `n % GROUPS`): `score = scales[n] * Σ codes[n] weight`. The first of
    /// equals; the same on every kernel.
    ///
    /// # Shapes
    /// `codes [points, layer.inputs]`, `scales [points]`, `best` and `winner [GROUPS, layer.outputs]`,
    /// overwritten; other lengths leave both as they are.
    pub fn search(
        self,
        layer: &Codes<'_>,
        codes: &[u8],
        scales: &[f32],
        best: &mut [f32],
        winner: &mut [u32],
    ) {
        let results = GROUPS * layer.outputs;
        let points = scales.len();
        if !is_whole(layer)
            || codes.len() != points * layer.inputs
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
            let panels = 0..layer.outputs / PANEL;
            match self.0 {
                Kind::Portable => {
                    search::portable(layer, tile, panels, codes, scales, best, winner);
                }
                // SAFETY: the instruction set was detected, lengths were checked above.
                #[cfg(target_arch = "x86_64")]
                Kind::Avx2 | Kind::Avx512 => unsafe {
                    x86_bytes256::avx2::search(layer, tile, panels, codes, scales, best, winner);
                },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Kind::AvxVnni => unsafe {
                    x86_bytes256::avx_vnni::search(
                        layer, tile, panels, codes, scales, best, winner,
                    );
                },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Kind::Avx512Vnni => unsafe {
                    x86_vnni::search_512(
                        layer, tile.start, tile, panels, codes, scales, best, winner,
                    );
                },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Kind::Amx => unsafe {
                    x86_amx::search(layer, tile, panels, codes, scales, best, winner);
                },
            }
        }
    }

    /// Outputs of the winners of [`Isa::search`] in f32, and the better of each output's groups.
    ///
    /// # Shapes
    /// `rows [outputs, width]`, `bias` and `feature [outputs]`, `hidden [points, width]`, `winner
    /// [GROUPS, outputs]`, of which the first row becomes the result; other lengths leave both as
    /// they are.
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
        match self.0 {
            Kind::Portable => search::winners(width, rows, bias, hidden, winner, feature),
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                search::winners_avx2(width, rows, bias, hidden, winner, feature);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                search::winners_avx512(width, rows, bias, hidden, winner, feature);
            },
        }
    }

    /// Gradient of a layer's outputs that are maxima over points: output `o` has the gradient
    /// `gradient[o]` at point `row[o]` and none elsewhere. Adds to the gradients of its weights and of
    /// its inputs; the same bits on every kernel.
    ///
    /// # Shapes
    /// `row` and `gradient [outputs]`, `hidden` and `hidden_gradient [points, width]`, `weight` and
    /// `weight_gradient [outputs, width]`; rows out of bounds are passed over.
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
        match self.0 {
            Kind::Portable => search::max_backward(layer, weight_gradient, hidden_gradient),
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                search::max_backward_avx2(layer, weight_gradient, hidden_gradient);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                search::max_backward_avx512(layer, weight_gradient, hidden_gradient);
            },
        }
    }

    /// First layer of an integer network: points as seen to codes (step 1 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `points [N, 3]`, `codes [N, outputs]`; rows beyond either are left alone, and all of them where
    /// the layer does not have three inputs.
    pub fn point_codes(self, layer: &Dense<'_>, points: &[[f32; 3]], codes: &mut [u8]) {
        if layer.inputs != 3 || layer.bias.is_empty() {
            return;
        }
        let (panels, bias) = (layer.panels, layer.bias);
        match self.0 {
            Kind::Portable => bytes::point_codes(panels, bias, points, codes),
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe {
                bytes::point_codes_avx2(panels, bias, points, codes);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                bytes::point_codes_avx512(panels, bias, points, codes);
            },
        }
    }

    /// An integer layer from codes to codes (step 2 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `x [points, inputs]`, `y [points, outputs]`; rows beyond either are left alone.
    pub fn dense_codes(self, layer: &QuantLayer<'_>, x: &[u8], y: &mut [u8]) {
        let (codes, bias, requantise) = (&layer.codes, layer.bias, layer.requantise);
        if !is_whole(codes) || bias.len() != codes.outputs || requantise.len() != codes.outputs {
            return;
        }
        match self.0 {
            Kind::Portable => bytes::dense_codes(codes, bias, requantise, x, y),
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => unsafe {
                x86_bytes256::avx2::dense_codes(codes, bias, requantise, x, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe {
                x86_bytes256::avx_vnni::dense_codes(codes, bias, requantise, x, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni | Kind::Amx => unsafe {
                x86_vnni::dense_codes_512(codes, bias, requantise, x, y);
            },
        }
    }

    /// `max[o] = max(max[o], max over rows of (W x)[o])` in integers (step 3 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `x [points, inputs]`, `max [outputs]`; another length of `max` leaves it as it is.
    pub fn dense_codes_max(self, layer: &Codes<'_>, x: &[u8], max: &mut [i32]) {
        if !is_whole(layer) || max.len() != layer.outputs {
            return;
        }
        let panels = 0..layer.outputs / PANEL;
        match self.0 {
            Kind::Portable => bytes::dense_codes_max(layer, panels, x, max),
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => unsafe {
                x86_bytes256::avx2::dense_codes_max(layer, panels, x, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe {
                x86_bytes256::avx_vnni::dense_codes_max(layer, panels, x, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => unsafe {
                x86_vnni::dense_codes_max_512(layer, panels, x, max);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Amx => unsafe { x86_amx::dense_codes_max(layer, panels, x, max) },
        }
    }

    /// `y += W[:, from..from + n] x` in integers, for codes of 13 bits in two planes of `n` bytes, `x =
    /// 64 high + low` (step 4 of [`crate::quant`]).
    ///
    /// # Shapes
    /// `planes [n]` each, `from` and `n` multiples of 4 with `from + n <= inputs`, `y [outputs]`; others
    /// leave `y` as it is.
    pub fn gemv_codes(self, layer: &Codes<'_>, from: usize, planes: [&[u8]; 2], y: &mut [i32]) {
        let [high, low] = planes;
        let columns = from..from + high.len();
        if !is_whole(layer)
            || y.len() != layer.outputs
            || high.len() != low.len()
            || columns.end > layer.inputs
            || !from.is_multiple_of(4)
            || !high.len().is_multiple_of(4)
        {
            return;
        }
        match self.0 {
            Kind::Portable => bytes::gemv_codes(layer, columns, planes, y),
            // SAFETY: the instruction set was detected, lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::Avx512 => unsafe {
                x86_bytes256::avx2::gemv_codes(layer, columns, planes, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe {
                x86_bytes256::avx_vnni::gemv_codes(layer, columns, planes, y);
            },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni | Kind::Amx => unsafe {
                x86_vnni::gemv_codes_512(layer, columns, planes, y);
            },
        }
    }

    /// Squared distance from each query to the nearest of `others`, infinite where there is none.
    /// The same bits on every kernel.
    pub fn nearest_squared(self, queries: &mut Queries, others: &[[f32; 3]]) {
        match self.0 {
            Kind::Portable => nearest::portable::<16>(queries, others),
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe { nearest::avx2(queries, others) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                nearest::avx512(queries, others)
            },
        }
    }
}

/// Whether codes have the lengths that they say.
fn is_whole(layer: &Codes<'_>) -> bool {
    layer.panels.len() == layer.inputs * layer.outputs
        && layer.inputs > 0
        && layer.inputs.is_multiple_of(CODES)
        && layer.outputs.is_multiple_of(PANEL)
}

/// Whole rows in `x`; zero where the layer's arrays do not have their padded lengths.
fn rows(layer: &Dense<'_>, x: &[f32]) -> usize {
    let whole = layer.bias.len().is_multiple_of(PANEL)
        && layer.panels.len() == layer.inputs * layer.bias.len();
    if whole && layer.inputs > 0 {
        x.len() / layer.inputs
    } else {
        0
    }
}

#[cfg(test)]
mod tests;
