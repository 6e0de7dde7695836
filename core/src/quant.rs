//! The network in 8-bit integers: number format 1 of the weight file, a specification.
//!
//! Given the same file and clouds, every implementation of what follows gives the same bits: the same
//! features, logits, actions and poses on every kernel and target. All sums are of 32-bit integers that
//! cannot overflow (`QuantNetwork::parse` checks it from the weights), so their order is free; what is
//! not integer is a handful of IEEE single operations in a fixed order, never fused.
//!
//! Weights are signed codes, symmetric, with a scale for each output; activations are unsigned codes
//! with a scale for each channel. The scales of activations are folded into the weights that read
//! them, those of weights into the requantisation that follows: none but the last is stored.
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
//! 5. The action follows from the logits as in the f32 network, as the file says: [`crate::decision`].
//!
//! `R(a) = floor((a * factor + 2^(shift - 1)) / 2^shift)` is [`Requantise`]: in exact arithmetic, which
//! fits 32 bits in step 2.
//!
//! In the file, layer 1 is stored as in format 0. The others are: weights `i8`
//! `[outputs / 16][inputs / 4][16][4]`, bias `i32 [outputs]`, then requantisation `u32 [outputs]`
//! (`factor | shift << 16`) or, for the last layer of a head, scale `f32 [outputs]`; outputs are padded
//! to multiples of 16 with zeros. The bias offset of the layer table points at the bias, and what comes
//! after it starts where the padded bias ends.
//!
//! Why so plain: over 3,000 noisy pairs (1,000 each of known and of new categories of meshes, and of
//! built-in shapes) the shipped policy in integers has a mean ISO error of 7.70 deg where f32 has 7.65,
//! MAE of 4.04 deg against 3.98, translation errors within 0.3 %, modified Chamfer distance within
//! 1.5 %, recall within 1 %; single sets scatter by 4 % either way. The same actions are another matter:
//! 84 to 91 % of f32's in the first step and 57 to 70 % in the last, where the source is in place and
//! "stop" and the smallest step are nearly as likely. More of them would be kept by a search in 8 bits with the winners computed anew in higher
//! precision, which no metric asked for.

use crate::dims::{EMBED, FEATURES, HEAD, LOGITS, PANEL, PANELS_TOGETHER, QUANT_TILE, padded};
use crate::error::Error;
use crate::kernels::{Codes, Isa};
use crate::net::View;
use crate::weights::Dense;

/// Zero of a feature code.
const FEATURE_ZERO: i64 = 4096;
/// Largest code of features and of the heads' hidden layers.
pub const WIDE_MAX: i32 = 8191;
/// Largest code of a point's hidden layers.
pub const CODE_MAX: i32 = 255;

/// A fixed-point factor: `factor | shift << 16`, shift 1 to 31 and factor below 2^15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requantise(pub u32);

impl Requantise {
    /// The nearest to a positive factor with at most `bits` bits (up to 15): the factor that it is, too.
    pub fn nearest(value: f64, bits: u32) -> (Requantise, f64) {
        let mut shift = 1;
        let most = f64::from((1u32 << bits) - 1);
        while shift < 31 && libm::round(value * power_of_two(shift + 1)) <= most {
            shift += 1;
        }
        let factor = libm::round(value * power_of_two(shift)).clamp(1.0, most);
        (
            Requantise(factor as u32 | shift << 16),
            factor / power_of_two(shift),
        )
    }

    fn factor(self) -> u32 {
        self.0 & 0xffff
    }

    fn shift(self) -> u32 {
        self.0 >> 16
    }

    fn half(self) -> i64 {
        (1 << self.shift()) >> 1
    }

    fn is_sound(self) -> bool {
        (1..=31).contains(&self.shift()) && (1..1 << 15).contains(&self.factor())
    }

    /// `R(a)` in 64 bits.
    #[inline(always)]
    pub fn apply(self, a: i32) -> i64 {
        (i64::from(a) * i64::from(self.factor()) + self.half()) >> self.shift()
    }

    /// `R(a)` in 32 bits, where the product is known to fit, limited to `0..=most`.
    #[inline(always)]
    pub(crate) fn apply_32(self, a: i32, most: i32) -> i32 {
        let scaled = a
            .wrapping_mul(self.factor() as i32)
            .wrapping_add(self.half() as i32)
            .wrapping_shr(self.shift());
        scaled.clamp(0, most)
    }
}

fn power_of_two(shift: u32) -> f64 {
    (1u64 << shift) as f64
}

/// An integer layer.
#[derive(Clone, Copy, Debug)]
pub struct QuantLayer<'a> {
    /// Weights.
    pub codes: Codes<'a>,
    /// Bias, padded to whole panels.
    pub bias: &'a [i32],
    /// What turns sums into codes, as long as the bias; or scales of logits, as bits of f32.
    pub requantise: &'a [u32],
}

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

/// Bytes of the arrays after the bias, for one output.
pub(crate) const BYTES_AFTER_BIAS: usize = 4;

impl<'a> QuantNetwork<'a> {
    /// Views the arrays at the given offsets (weights, bias) of each layer.
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
            let layer = QuantLayer {
                codes: Codes::new(inputs, width, codes).ok_or(wrong)?,
                bias: bytemuck::cast_slice(words(bias)?),
                requantise: words(bias + 4 * width)?,
            };
            layer.check(i)?;
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

impl QuantLayer<'_> {
    /// Refuses weights whose sums, or in layer 1 whose products too, could overflow 32 bits.
    fn check(&self, layer: usize) -> Result<(), Error> {
        let codes = if layer <= 2 { CODE_MAX } else { WIDE_MAX };
        let most = i64::from(i32::MAX);
        let (quads, _) = self.codes.panels.as_chunks::<4>();
        for (o, (&bias, &requantise)) in self.bias.iter().zip(self.requantise).enumerate() {
            let panel = o / PANEL * (self.codes.inputs / 4) * PANEL + o % PANEL;
            let magnitude: i64 = quads
                .iter()
                .skip(panel)
                .step_by(PANEL)
                .take(self.codes.inputs / 4)
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
}

/// Codes of 13 bits in two planes of bytes: the upper seven bits, then the lower six.
#[derive(Clone, Debug)]
pub struct Wide<const N: usize> {
    high: [u8; N],
    low: [u8; N],
}

impl<const N: usize> Wide<N> {
    pub(crate) const ZERO: Self = Wide {
        high: [0; N],
        low: [0; N],
    };

    /// Both planes of the first `n` codes.
    fn planes(&self, n: usize) -> [&[u8]; 2] {
        [&self.high, &self.low].map(|plane| plane.get(..n).unwrap_or(plane))
    }

    fn set(&mut self, codes: impl Iterator<Item = i64>) {
        for ((high, low), code) in self.high.iter_mut().zip(&mut self.low).zip(codes) {
            let code = code.clamp(0, i64::from(WIDE_MAX));
            *high = (code >> 6) as u8;
            *low = (code & 63) as u8;
        }
    }
}

/// Working memory of the integer network.
#[derive(Clone, Debug)]
pub struct QuantScratch {
    hidden1: [u8; QUANT_TILE * EMBED[0]],
    hidden2: [u8; QUANT_TILE * EMBED[1]],
    max: [i32; FEATURES],
    /// Feature of the cloud embedded last.
    feature: Wide<FEATURES>,
    head1: Wide<{ HEAD[0] }>,
    head2: Wide<{ HEAD[1] }>,
}

impl QuantScratch {
    pub(crate) const ZERO: Self = QuantScratch {
        hidden1: [0; QUANT_TILE * EMBED[0]],
        hidden2: [0; QUANT_TILE * EMBED[1]],
        max: [0; FEATURES],
        feature: Wide::ZERO,
        head1: Wide::ZERO,
        head2: Wide::ZERO,
    };
}

impl QuantScratch {
    /// Before the first points of a cloud.
    pub(crate) fn begin(&mut self) {
        self.max.fill(i32::MIN);
    }
}

/// Takes points into the maxima of the cloud under way.
pub fn embed(
    isa: Isa,
    network: &QuantNetwork<'_>,
    points: &[[f32; 3]],
    view: &View,
    scratch: &mut QuantScratch,
) {
    let [l2, l3] = &network.embedding;
    let Some(max) = scratch.max.get_mut(..l3.codes.outputs) else {
        return;
    };
    let mut tile = [[0.0; 3]; QUANT_TILE];
    for chunk in points.chunks(QUANT_TILE) {
        let n = chunk.len();
        for (seen, &point) in tile.iter_mut().zip(chunk) {
            *seen = view.see(point);
        }
        let (Some(x), Some(hidden1), Some(hidden2)) = (
            tile.get(..n),
            scratch.hidden1.get_mut(..n * l2.codes.inputs),
            scratch.hidden2.get_mut(..n * l3.codes.inputs),
        ) else {
            return;
        };
        isa.point_codes(&network.points, x, hidden1);
        isa.dense_codes(l2, hidden1, hidden2);
        isa.dense_codes_max(&l3.codes, hidden2, max);
    }
}

/// Makes the maxima the feature of the cloud, once all its points are in.
pub fn finish(network: &QuantNetwork<'_>, scratch: &mut QuantScratch) {
    let [_, l3] = &network.embedding;
    let sums = scratch.max.iter().zip(l3.bias).zip(l3.requantise);
    let codes = sums
        .map(|((&max, &bias), &r)| FEATURE_ZERO + Requantise(r).apply(max.saturating_add(bias)));
    scratch.feature.set(codes);
}

/// What the target's feature adds to the first layer of a head, bias included; as much of it as the layer
/// has outputs.
pub type TargetSums = [i32; HEAD[0]];

/// What the target embedded last adds to the first layer of a head.
pub fn target_sums(
    isa: Isa,
    [fc1, _, _]: &[QuantLayer<'_>; 3],
    scratch: &QuantScratch,
    sums: &mut TargetSums,
) {
    let features = fc1.codes.inputs / 2;
    let Some(sums) = sums.get_mut(..fc1.codes.outputs) else {
        return;
    };
    for (sum, &bias) in sums.iter_mut().zip(fc1.bias) {
        *sum = bias;
    }
    isa.gemv_codes(&fc1.codes, features, scratch.feature.planes(features), sums);
}

/// One registration in a pass over the weights of a head.
#[derive(Debug)]
pub struct Lane<'a> {
    /// What its target adds.
    pub target: &'a TargetSums,
    /// Where its source has been embedded.
    pub scratch: &'a mut QuantScratch,
    /// What comes out, axis-major.
    pub logits: &'a mut [f32; LOGITS],
}

/// Logits of one head for the sources embedded last.
pub fn logits(isa: Isa, [fc1, fc2, out]: &[QuantLayer<'_>; 3], lanes: &mut [Lane<'_>]) {
    // The maxima have become the feature: their place is free for sums, and the stack stays small.
    for Lane {
        target, scratch, ..
    } in lanes.iter_mut()
    {
        for (sum, &start) in scratch.max.iter_mut().zip(*target) {
            *sum = start;
        }
    }
    let features = fc1.codes.inputs / 2;
    product(isa, &fc1.codes, lanes, |s| {
        (s.feature.planes(features), &mut s.max)
    });
    for Lane { scratch, .. } in lanes.iter_mut() {
        let codes = scratch.max.iter().zip(fc1.requantise);
        scratch
            .head1
            .set(codes.map(|(&s, &r)| Requantise(r).apply(s)));
        scratch.max.fill(0);
    }
    product(isa, &fc2.codes, lanes, |s| {
        (s.head1.planes(fc2.codes.inputs), &mut s.max)
    });
    for Lane { scratch, .. } in lanes.iter_mut() {
        let biased = scratch.max.iter().zip(fc2.bias).zip(fc2.requantise);
        scratch
            .head2
            .set(biased.map(|((s, b), &r)| Requantise(r).apply(s + b)));
        scratch.max.fill(0);
    }
    product(isa, &out.codes, lanes, |s| {
        (s.head2.planes(out.codes.inputs), &mut s.max)
    });
    for Lane {
        scratch, logits, ..
    } in lanes
    {
        let biased = scratch.max.iter().zip(out.bias).zip(out.requantise);
        for (logit, ((s, b), scale)) in logits.iter_mut().zip(biased) {
            *logit = (s + b) as f32 * f32::from_bits(*scale);
        }
    }
}

/// `sums += W codes` of each lane. Several lanes take some panels at a time: weights come from memory for
/// the first lane and from the cache for the others.
fn product(
    isa: Isa,
    layer: &Codes<'_>,
    lanes: &mut [Lane<'_>],
    operands: impl Fn(&mut QuantScratch) -> ([&[u8]; 2], &mut [i32; FEATURES]),
) {
    let panels = if lanes.len() > 1 {
        PANELS_TOGETHER
    } else {
        layer.outputs / PANEL
    };
    for (first, part) in layer.parts(panels) {
        for lane in lanes.iter_mut() {
            let (planes, sums) = operands(lane.scratch);
            if let Some(sums) = sums.get_mut(first..first + part.outputs) {
                isa.gemv_codes(&part, 0, planes, sums);
            }
        }
    }
}
