//! The policy file `.rgw`: borrowed bytes are checked once, then viewed in place (flash or memory).
//!
//! All numbers are little-endian. Offsets count bytes from the start of the file.
//!
//! | offset | type | content |
//! |---|---|---|
//! | 0 | `[u8; 4]` | magic `RGNT` |
//! | 4 | u16 | format version, 1 |
//! | 6 | u16 | number format: 0 = f32, 1 = int8 |
//! | 8 | u32 | length of the whole file, checksum included |
//! | 12 | u32 | layers, 9 |
//! | 16 | `[u16; 8]` | network shape, in the paper 64, 128, 1024 (embedding), 512, 256 (head), 33 (logits); decision ([`Decision`]: 0 = most likely, 1 = nearest to the mean, 2 = both ways) in the low 4 bits of the low byte, steps from one choice of the target's points to the next ([`Sight::focus`]; 0 = all, always) in its high 4, in the high byte how far from the model points are looked at ([`Cut`], sixteenths of its radius; 0 = anywhere); steps from one look at all points to the next ([`Policy::rescan`]; 0 = 1) |
//! | 32 | 9 x 16 bytes | layer table: inputs, outputs, weight offset, bias offset, u32 each |
//! | 192 | | payload; each array starts on a 64-byte boundary, gaps are zero |
//! | length - 4 | u32 | CRC-32 (ISO-HDLC) of everything before |
//!
//! Layers: embedding 1, 2, 3; translation head 1, 2, policy; rotation head 1, 2, policy. A weight
//! matrix is stored in panels of [`crate::dims::PANEL`] outputs, `[outputs / PANEL][inputs][PANEL]`,
//! with the outputs padded with zeros to whole panels: every kernel reads it in order, one output to
//! a lane. Biases are padded likewise. Number format 1 is described in [`crate::quant`].

use crate::cut::Cut;
use crate::decision::Decision;
use crate::dims::{LAYERS, padded};
use crate::error::Error;
use crate::float::{Embedding, FloatNetwork, Head};
use crate::kernels::{Isa, PackedDense, Tile};
use crate::layer::Dense;
use crate::numbers::Numbers;
use crate::quant::{BYTES_AFTER_BIAS, QuantNetwork};
use crate::shape::Shape;
use crate::sight::Sight;

/// First bytes of a weight file.
pub const MAGIC: [u8; 4] = *b"RGNT";
/// Format version that this build reads and writes.
pub const VERSION: u16 = 1;
/// Number format of f32 payloads.
pub const FORMAT_F32: u16 = 0;
/// Number format of 8-bit integer payloads ([`crate::quant`]).
pub const FORMAT_INT8: u16 = 1;
/// Offset of the decision in the header.
pub const DECISION_AT: usize = 28;
/// First bit of [`Sight::focus`] in the byte of the decision.
pub const FOCUS_SHIFT: u32 = 4;
/// Offset of the [`Cut`] in the header.
pub const CUT_AT: usize = 29;
/// Offset of [`Policy::rescan`] in the header.
pub const RESCAN_AT: usize = 30;
/// Bytes before the layer table.
pub const HEADER: usize = 32;
/// Bytes of one row of the layer table.
pub const TABLE_ROW: usize = 16;
/// Boundary on which every array starts.
pub const ARRAY_ALIGN: usize = 64;
/// Where each layer's arrays start: `(weight offset, bias offset)` in bytes.
pub type Offsets = [(usize, usize); LAYERS];

/// Where each layer's arrays start in a file of a number format.
pub const fn offsets(shape: &Shape, format: u16) -> Offsets {
    layout(shape, format).0
}

/// Length of a policy file in bytes.
pub const fn file_len(shape: &Shape, format: u16) -> usize {
    layout(shape, format).1
}

#[allow(clippy::indexing_slicing)] // `i` counts the layers
const fn layout(shape: &Shape, format: u16) -> (Offsets, usize) {
    let shapes = shape.layers();
    let mut table = [(0, 0); LAYERS];
    let mut at = HEADER + LAYERS * TABLE_ROW;
    let mut i = 0;
    while i < LAYERS {
        let (inputs, outputs) = shapes[i];
        let integer = format == FORMAT_INT8 && i > 0;
        let weight_bytes = if integer { 1 } else { 4 };
        let weights = at.next_multiple_of(ARRAY_ALIGN);
        let bias =
            (weights + weight_bytes * inputs * padded(outputs)).next_multiple_of(ARRAY_ALIGN);
        table[i] = (weights, bias);
        at = bias + 4 * padded(outputs);
        if integer {
            at += BYTES_AFTER_BIAS * padded(outputs);
        }
        i += 1;
    }
    (table, at + 4)
}

/// The network in one of its number formats.
pub type Network<'a> = Numbers<FloatNetwork<'a>, QuantNetwork<'a>>;

/// A checked view of a policy file.
#[derive(Clone, Copy, Debug)]
pub struct Policy<'a> {
    /// The file's checksum. A registration goes on only with the policy that it was started with.
    pub checksum: u32,
    /// Widths of the network.
    pub shape: Shape,
    /// How steps follow from logits.
    pub decision: Decision,
    /// Steps from one look at all points of the source to the next. Steps in between look only at the critical points, which
    /// made the feature of the last full look. With 1, as in the paper, every step looks at all.
    pub rescan: u16,
    /// Which points of both clouds are looked at. Callers who know the start's error better than the file may set it here.
    pub sight: Sight,
    /// The network.
    pub network: Network<'a>,
}

impl<'a> Policy<'a> {
    /// The network, if its numbers are f32.
    pub fn f32(&self) -> Option<&FloatNetwork<'a>> {
        match &self.network {
            Numbers::F32(network) => Some(network),
            Numbers::Int8(_) => None,
        }
    }

    /// Whether the step after `steps` steps looks at all points of the source.
    pub fn sees_all(&self, steps: usize) -> bool {
        steps.is_multiple_of(usize::from(self.rescan.max(1)))
    }

    /// Tiles of memory that cut the time of the embedding's last layer in f32 to about 60 % on this machine (see
    /// [`Policy::with_packed`]); `None` if packing gains nothing.
    pub fn packed_tiles(&self) -> Option<usize> {
        let [_, _, last] = &self.f32()?.embedding.layers;
        PackedDense::tiles(Isa::best(), last)
    }

    /// Fills [`Policy::packed_tiles`] tiles: once, when the policy is loaded.
    pub fn pack(&self, memory: &mut [Tile]) {
        if let Some(network) = self.f32() {
            let [_, _, last] = &network.embedding.layers;
            PackedDense::pack(Isa::best(), last, memory);
        }
    }

    /// The policy with memory that [`Policy::pack`] has filled; unchanged if the memory has another length. Results differ by
    /// rounding only, as between any two kernels of f32.
    pub fn with_packed(mut self, packed: &'a [Tile]) -> Self {
        if let Numbers::F32(FloatNetwork { embedding, .. }) = &mut self.network {
            let [_, _, last] = &embedding.layers;
            embedding.packed = PackedDense::new(Isa::best(), last, packed);
        }
        self
    }

    /// Checks every byte of a policy file once: header, layer table, checksum, finite weights.
    ///
    /// # Errors
    /// The `Weights…` variants of [`Error`]; any flipped bit or cut gives one.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Error> {
        Self::parse_and::<true>(bytes)
    }

    /// As [`Policy::parse`], for bytes that it accepted before: checks neither the checksum nor the weights again.
    ///
    /// # Errors
    /// As [`Policy::parse`], for bytes of another length or layout.
    pub fn parse_again(bytes: &'a [u8]) -> Result<Self, Error> {
        Self::parse_and::<false>(bytes)
    }

    // One function for both: a second one would cost microcontrollers 640 bytes.
    #[inline(always)]
    fn parse_and<const CHECK: bool>(bytes: &'a [u8]) -> Result<Self, Error> {
        let field = |at: usize| -> Option<u32> {
            Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
        };
        let half = |at: usize| field(at & !3).map(|word| (word >> (8 * (at & 3))) as u16);
        let cut_at = |expected: usize| Error::WeightsLength {
            expected,
            found: bytes.len(),
        };
        let cut = cut_at(HEADER);
        if bytes.get(..4).ok_or(cut)? != MAGIC {
            return Err(Error::WeightsMagic);
        }
        let version = half(4).ok_or(cut)?;
        if version != VERSION {
            return Err(Error::WeightsVersion {
                found: version,
                expected: VERSION,
            });
        }
        let format = half(6).ok_or(cut)?;
        if ![FORMAT_F32, FORMAT_INT8].contains(&format) {
            return Err(Error::WeightsFormat { found: format });
        }
        let announced = field(8).ok_or(cut)? as usize;
        if announced != bytes.len() {
            return Err(cut_at(announced));
        }
        let (body, sum) = bytes.split_last_chunk::<4>().ok_or(cut)?;
        if CHECK && *sum != checksum(body).to_le_bytes() {
            return Err(Error::WeightsCrc);
        }
        let mut header = [0; 8];
        for (i, width) in header.iter_mut().enumerate() {
            *width = half(16 + 2 * i).ok_or(cut)?;
        }
        let [.., decision, rescan] = &mut header;
        let found = core::mem::take(decision);
        let [low, high] = found.to_le_bytes();
        let cut = Cut::from_header(high);
        let rescan = core::mem::take(rescan).max(1);
        let focus = low >> FOCUS_SHIFT;
        let low = low & ((1 << FOCUS_SHIFT) - 1);
        let decision = Decision::from_header(low.into()).ok_or(Error::WeightsDecision { found })?;
        let shape = Shape::from_header(header).ok_or(Error::WeightsShape { layer: 0 })?;
        let (offsets, length) = layout(&shape, format);
        if bytes.len() != length {
            return Err(cut_at(length));
        }
        if field(12) != Some(LAYERS as u32) {
            return Err(Error::WeightsShape { layer: LAYERS });
        }
        let layers = shape.layers();
        for (i, (&(inputs, outputs), &(weights, bias))) in layers.iter().zip(&offsets).enumerate() {
            let row = HEADER + i * TABLE_ROW;
            for (k, expected) in [inputs, outputs, weights, bias].into_iter().enumerate() {
                if field(row + 4 * k) != Some(expected as u32) {
                    return Err(Error::WeightsShape { layer: i });
                }
            }
        }
        let layer = |i: usize| -> Result<Dense<'a>, Error> {
            let wrong = Error::WeightsShape { layer: i };
            let (&(inputs, outputs), &(weights, bias)) =
                layers.get(i).zip(offsets.get(i)).ok_or(wrong)?;
            let array = |at: usize, len: usize| -> Result<&'a [f32], Error> {
                let raw = bytes.get(at..at + 4 * len).ok_or(wrong)?;
                let values: &[f32] =
                    bytemuck::try_cast_slice(raw).map_err(|_| Error::WeightsAlignment)?;
                if !CHECK || values.iter().all(|v| v.is_finite()) {
                    Ok(values)
                } else {
                    Err(Error::WeightsNotFinite { layer: i })
                }
            };
            let panels = array(weights, inputs * padded(outputs))?;
            let bias = array(bias, padded(outputs))?;
            Dense::new(inputs, outputs, panels, bias).ok_or(wrong)
        };
        let network = if format == FORMAT_INT8 {
            Numbers::Int8(QuantNetwork::parse(&layers, &offsets, bytes, layer(0)?)?)
        } else {
            Numbers::F32(FloatNetwork {
                embedding: Embedding {
                    layers: [layer(0)?, layer(1)?, layer(2)?],
                    packed: None,
                },
                translation: Head {
                    layers: [layer(3)?, layer(4)?, layer(5)?],
                },
                rotation: Head {
                    layers: [layer(6)?, layer(7)?, layer(8)?],
                },
            })
        };
        Ok(Policy {
            checksum: u32::from_le_bytes(*sum),
            shape,
            decision,
            rescan,
            sight: Sight { cut, focus },
            network,
        })
    }
}

/// CRC-32 of a file's body (ISO-HDLC, as in zip and Ethernet).
pub fn checksum(body: &[u8]) -> u32 {
    /// Sixteen bytes at a time where there is room for 16 KiB of tables.
    #[cfg(not(target_os = "none"))]
    type Tables = crc::Table<16>;
    #[cfg(target_os = "none")]
    type Tables = crc::Table<1>;
    const CRC: crc::Crc<u32, Tables> = crc::Crc::<u32, Tables>::new(&crc::CRC_32_ISO_HDLC);
    CRC.checksum(body)
}
