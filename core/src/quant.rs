//! The network in 8-bit integers: number format 1 of the weight file, a specification.
//!
//! Given the same file and clouds, every implementation of this specification gives the same bits:
//! the same features, logits, actions and poses on every kernel and target. All sums are of 32-bit
//! integers that cannot overflow (`QuantNetwork::parse` checks it from the weights), so their
//! order is free. The rest is a handful of IEEE single operations in a fixed order, never fused.
//!
//! Weights are signed codes, symmetric, with a scale for each output; activations are unsigned codes with a scale for each
//! channel. The scales of activations are folded into the weights that read them, and those of weights into the requantisation
//! that follows; only those of a head's last layer are stored.
//!
//! 1. **Point to hidden 1** (in f32, since 2/255 is coarser than the smallest step). A point is seen as in
//!    the f32 network ([`View::see`]). With `W [64, 3]`, `b [64]` already in units of one code:
//!    `u = ((b + W₀ x) + W₁ y) + W₂ z`; code = u limited to 0..=255 and rounded to the nearest integer,
//!    ties to even.
//! 2. **Hidden 1 to hidden 2**: `a = b + Σ w code` (64 inputs), code = `R(a)` limited to 0..=255.
//! 3. **Hidden 2 to feature**: `a = b + max over points of Σ w code` (128 inputs),
//!    code = `4096 + R(a)` limited to 0..=8191. The bias is added after the maximum.
//! 4. **Heads**, translation and rotation: `a = b + Σ w code` over source (0..1024) and target
//!    (1024..2048) codes, code = `R(a)` limited to 0..=8191; the same with 512 inputs; then
//!    `logit = f32(a) * scale` with 256 inputs. The 4096 of features is part of the first bias.
//!    Thirteen bits cost no time here: heads read weights as fast as memory gives them.
//!    Where the policy looks both ways, the heads run once more with the features of source and target exchanged.
//! 5. The action follows from the logits as in the f32 network, as the file says: [`crate::decision`].
//!
//! `R(a) = floor((a * factor + 2^(shift - 1)) / 2^shift)` is [`Requantise`]: in exact arithmetic, which
//! fits 32 bits in step 2.
//!
//! In the file, layer 1 is stored as in format 0. The others are: weights `i8` `[outputs / 16][inputs / 4][16][4]`, bias
//! `i32 [outputs]`, then requantisation `u32 [outputs]` (`factor | shift << 16`) or, for the last layer of a head, scale
//! `f32 [outputs]`; outputs are padded to multiples of 16 with zeros. The bias offset of the layer table points at the bias,
//! and the array after it starts where the padded bias ends.
//!
//! # In floating point
//!
//! IEEE single precision, round to nearest even, each operation rounded on its own, sums from left to right as written;
//! f64 only where it says so. Vectors and matrices are operated on component by component, `M = [c₀ c₁ c₂]` by columns:
//! `M v = (c₀ v₀ + c₁ v₁) + c₂ v₂`, and `M N` has the columns `M n₀, M n₁, M n₂`.
//!
//! - **Centroid** `μ` of the source: for each axis, the sum in f64 in the order of the points from 0, divided by their
//!   number in f64, rounded to f32. A point on a grid is decoded first ([`crate::grid`]).
//! - **Frame** (`centre`, `scale`) is given; that of a target is its centroid and the greatest length
//!   `√((x² + y²) + z²)` of a point minus it. With `i = 1 / scale`, the target is seen through `Q = I i`, `o = centre`,
//!   `p = 0`; the source through `Q = R i`, `o = μ`, `p = (μ - centre) i + t`.
//! - **Seeing** a point ([`View::see`]): `x = Q (point - o) + p`.
//! - **Start** from a pose `(R₀, t₀)`: `R = R₀`, `t = ((t₀ - μ) + R₀ μ) / scale`.
//! - **Step** ([`crate::steps`]): from the ids of the axes the table gives `t̂`, sines `s` and cosines `c`, and
//!   `R̂ = Rx Ry Rz` with the rows `(c₁c₂, -c₁s₂, s₁)`, `(c₀s₂ + (s₀s₁)c₂, c₀c₂ - (s₀s₁)s₂, -s₀c₁)`,
//!   `(s₀s₂ - (c₀s₁)c₂, s₀c₂ + (c₀s₁)s₂, c₀c₁)`. Then `R = R̂ R`, `t = t̂ + t`.
//! - **Pose** of the registration: `R` and `(t scale + μ) - R μ`.
//! - **Probabilities** of an axis's eleven logits `l`: `w = exp(l - max l)`; `p = w / Σ w`, the sum in the order of the
//!   table from 0.
//! - **Both ways** (after [`crate::dims::STEPS_ONE_WAY`] steps, if the file says so): with `p` of (source, target) and
//!   `q` of (target, source), the logit of step `k` becomes `log(max(0.5 (p[k] + q[10 - k]), 2^-126))`, and
//!   probabilities are taken of these logits anew.
//! - **Decision**: the most likely step is that of the greatest logit; else `m = Σ p step` in the order of the table
//!   from 0, and the step is that of the least `|step - m|`. The first of equals.
//! - `exp` and `log` are those of FreeBSD's msun (`e_expf.c`, `e_logf.c`), which the crate `libm` ports; a square root
//!   is correctly rounded.
//!
//! Why so plain: metrics stay those of f32 (table in tests/MEASURED.md). Actions do not always: where the source is in place,
//! "stop" and the smallest step are nearly as likely, and the two formats choose differently without loss. A search in 8 bits
//! with the winners computed anew in higher precision would keep more of f32's actions, but no metric asked for it.

mod heads;
mod wide;

use crate::dims::{EMBED, FEATURES, HEAD, PANEL, QUANT_TILE, padded};
use crate::error::Error;
use crate::kernels::Isa;
use crate::layer::{Codes, Dense, QuantLayer, Requantise};
use crate::view::View;

pub use heads::{HeadInput, TargetSums, logits, target_sums};
pub use wide::Wide;

/// The feature code that stands for 0.
const FEATURE_ZERO: i64 = 4096;
/// Largest code of features and of the heads' hidden layers.
pub const WIDE_MAX: i32 = 8191;
/// Largest code of a point's hidden layers.
pub const CODE_MAX: i32 = 255;

/// The whole network in number format 1.
#[derive(Clone, Copy, Debug)]
pub struct QuantNetwork<'a> {
    /// First layer of the embedding, in units of one code.
    pub points: Dense<'a>,
    /// Second and third layer of the embedding.
    pub embedding: [QuantLayer<'a>; 2],
    /// Translation and rotation head.
    pub heads: [[QuantLayer<'a>; 3]; 2],
}

/// Bytes for each output in the arrays after the bias.
pub(crate) const BYTES_AFTER_BIAS: usize = 4;

impl<'a> QuantNetwork<'a> {
    /// Views the layers' arrays at the given offsets (weights, bias).
    ///
    /// # Errors
    /// [`Error::WeightsShape`], [`Error::WeightsAlignment`], [`Error::WeightsNotFinite`], and
    /// [`Error::WeightsRange`] where a sum could overflow.
    pub(crate) fn parse(
        layers: &[(usize, usize)],
        offsets: &[(usize, usize)],
        bytes: &'a [u8],
        points: Dense<'a>,
    ) -> Result<Self, Error> {
        let layer = |i: usize| -> Result<QuantLayer<'a>, Error> {
            let wrong = Error::WeightsShape { layer: i };
            let (&(inputs, outputs), &(weights, bias)) =
                layers.get(i).zip(offsets.get(i)).ok_or(wrong)?;
            let width = padded(outputs);
            let raw = |at: usize, len: usize| bytes.get(at..at + len).ok_or(wrong);
            let codes = bytemuck::cast_slice(raw(weights, inputs * width)?);
            let words = |at| {
                bytemuck::try_cast_slice::<u8, u32>(raw(at, 4 * width)?)
                    .map_err(|_| Error::WeightsAlignment)
            };
            let codes = Codes::new(inputs, width, codes).ok_or(wrong)?;
            let (bias, requantise) = (words(bias)?, words(bias + 4 * width)?);
            let layer = QuantLayer::new(codes, bytemuck::cast_slice(bias), requantise);
            let layer = layer.ok_or(wrong)?;
            check(&layer, i)?;
            Ok(layer)
        };
        Ok(QuantNetwork {
            points,
            embedding: [layer(1)?, layer(2)?],
            heads: [
                [layer(3)?, layer(4)?, layer(5)?],
                [layer(6)?, layer(7)?, layer(8)?],
            ],
        })
    }
}

/// Refuses weights whose sums could overflow 32 bits; in layer 1, requantisation's products as well.
fn check(weights: &QuantLayer<'_>, layer: usize) -> Result<(), Error> {
    let codes = if layer <= 2 { CODE_MAX } else { WIDE_MAX };
    let most = i64::from(i32::MAX);
    let (quads, _) = weights.codes().panels().as_chunks::<4>();
    for (o, (&bias, &requantise)) in weights.bias().iter().zip(weights.requantise()).enumerate() {
        let panel = o / PANEL * (weights.codes().inputs() / 4) * PANEL + o % PANEL;
        let magnitude: i64 = quads
            .iter()
            .skip(panel)
            .step_by(PANEL)
            .take(weights.codes().inputs() / 4)
            .flatten()
            .map(|&w| i64::from(w).abs())
            .sum();
        let largest = i64::from(codes) * magnitude + i64::from(bias).abs();
        if layer == 5 || layer == 8 {
            let scale = f32::from_bits(requantise);
            if !scale.is_finite() {
                return Err(Error::WeightsNotFinite { layer });
            }
        } else if !Requantise(requantise).is_sound() {
            return Err(Error::WeightsRange { layer });
        }
        let product = if layer == 1 {
            largest * i64::from(Requantise(requantise).factor()) + Requantise(requantise).half()
        } else {
            largest
        };
        if product > most {
            return Err(Error::WeightsRange { layer });
        }
    }
    Ok(())
}

/// Working memory of the integer network.
#[derive(Clone, Debug)]
pub struct QuantScratch {
    hidden1: [u8; QUANT_TILE * EMBED[0]],
    hidden2: [u8; QUANT_TILE * EMBED[1]],
    max: [i32; FEATURES],
    /// Feature of the cloud embedded last.
    pub(crate) feature: Feature,
    /// Hidden layers of a head, for (source, target) and for (target, source).
    head1: [Wide<{ HEAD[0] }>; 2],
    head2: [Wide<{ HEAD[1] }>; 2],
}

/// A global feature vector in codes, one for each channel; a smaller network fills only the first channels.
pub type Feature = Wide<FEATURES>;

impl QuantScratch {
    pub(crate) const ZERO: Self = QuantScratch {
        hidden1: [0; QUANT_TILE * EMBED[0]],
        hidden2: [0; QUANT_TILE * EMBED[1]],
        max: [0; FEATURES],
        feature: Wide::ZERO,
        head1: [Wide::ZERO; 2],
        head2: [Wide::ZERO; 2],
    };
}

impl QuantScratch {
    /// Forgets the points of the previous cloud.
    pub(crate) fn clear(&mut self) {
        self.max.fill(i32::MIN);
    }

    /// The critical point of each channel, if [`embed`] recorded them. They share memory with the feature of [`finish`].
    pub(crate) fn winners(&self) -> impl Iterator<Item = usize> {
        self.feature.numbers()
    }
}

/// Folds points into the maxima of the current cloud. With `first`, the index of the first point, records the critical point of
/// each channel ([`QuantScratch::winners`]).
pub(crate) fn embed(
    isa: Isa,
    network: &QuantNetwork<'_>,
    points: &[[f32; 3]],
    first: Option<usize>,
    view: &View,
    scratch: &mut QuantScratch,
) {
    let [l2, l3] = &network.embedding;
    let Some(max) = scratch.max.get_mut(..l3.codes().outputs()) else {
        return;
    };
    let mut tile = [[0.0; 3]; QUANT_TILE];
    for (i, chunk) in points.chunks(QUANT_TILE).enumerate() {
        let n = chunk.len();
        for (seen, &point) in tile.iter_mut().zip(chunk) {
            *seen = view.see(point);
        }
        let (Some(x), Some(hidden1), Some(hidden2)) = (
            tile.get(..n),
            scratch.hidden1.get_mut(..n * l2.codes().inputs()),
            scratch.hidden2.get_mut(..n * l3.codes().inputs()),
        ) else {
            return;
        };
        isa.point_codes(&network.points, x, hidden1);
        isa.dense_codes(l2, hidden1, hidden2);
        match first.map(|first| first + i * QUANT_TILE) {
            None => isa.dense_codes_max_near(l3.codes(), hidden2, max),
            Some(first) => {
                let winners = &mut scratch.feature;
                let won = |channel, row| winners.put(channel, first + row);
                isa.dense_codes_argmax(l3.codes(), hidden2, max, won);
            }
        }
    }
}

/// Turns the maxima into the feature, once all points of the cloud are in.
pub fn finish(network: &QuantNetwork<'_>, scratch: &mut QuantScratch) {
    let [_, l3] = &network.embedding;
    let sums = scratch.max.iter().zip(l3.bias()).zip(l3.requantise());
    let codes = sums
        .map(|((&max, &bias), &r)| FEATURE_ZERO + Requantise(r).apply(max.saturating_add(bias)));
    scratch.feature.set(codes);
}
