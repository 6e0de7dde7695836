//! The policy file `.rgw`: borrowed bytes are checked once, then viewed in place (flash or memory).
//!
//! All numbers are little-endian. Offsets count bytes from the start of the file.
//!
//! | offset | type | content |
//! |---|---|---|
//! | 0 | `[u8; 4]` | magic `RGNT` |
//! | 4 | u16 | format version, 1 |
//! | 6 | u16 | number format: 0 = f32 |
//! | 8 | u32 | length of the whole file, check sum included |
//! | 12 | u32 | layers, 9 |
//! | 16 | `[u16; 8]` | network shape: 64, 128, 1024 (embedding), 512, 256 (head), 33 (logits), 0, 0 |
//! | 32 | 9 x 16 bytes | layer table: inputs, outputs, weight offset, bias offset, u32 each |
//! | 192 | f32 | payload; each array starts on a 64-byte boundary, gaps are zero |
//! | length - 4 | u32 | CRC-32 (ISO-HDLC) of everything before |
//!
//! Layers: embedding 1, 2, 3; translation head 1, 2, policy; rotation head 1, 2, policy. A weight
//! matrix is stored in panels of [`PANEL`] outputs, `[outputs / PANEL][inputs][PANEL]`, outputs
//! padded with zeros to whole panels: every kernel reads it in order, and lanes are outputs.
//! Biases are padded likewise.

use crate::dims::{EMBED, HEAD, LAYER_SHAPES, LAYERS, LOGITS, PANEL, padded};
use crate::error::Error;

/// First bytes of a weight file.
pub const MAGIC: [u8; 4] = *b"RGNT";
/// Format version that this build reads and writes.
pub const VERSION: u16 = 1;
/// Number format of f32 payloads.
pub const FORMAT_F32: u16 = 0;
/// Bytes before the layer table.
pub const HEADER: usize = 32;
/// Bytes of one row of the layer table.
pub const TABLE_ROW: usize = 16;
/// Boundary on which every array starts.
pub const ARRAY_ALIGN: usize = 64;
/// Network shape as the header stores it.
pub const SHAPE: [u16; 8] = [
    EMBED[0] as u16,
    EMBED[1] as u16,
    EMBED[2] as u16,
    HEAD[0] as u16,
    HEAD[1] as u16,
    LOGITS as u16,
    0,
    0,
];

/// Where the arrays of each layer start: `(weight offset, bias offset)` in bytes.
pub const OFFSETS: [(usize, usize); LAYERS] = offsets();
/// Length of an f32 policy file in bytes.
pub const FILE_LEN: usize = {
    let (_, bias) = OFFSETS[LAYERS - 1];
    bias + 4 * padded(LAYER_SHAPES[LAYERS - 1].1) + 4
};

#[allow(clippy::indexing_slicing)] // evaluated by the compiler only
const fn offsets() -> [(usize, usize); LAYERS] {
    let mut table = [(0, 0); LAYERS];
    let mut at = HEADER + LAYERS * TABLE_ROW;
    let mut i = 0;
    while i < LAYERS {
        let (inputs, outputs) = LAYER_SHAPES[i];
        let weights = at.next_multiple_of(ARRAY_ALIGN);
        let bias = (weights + 4 * inputs * padded(outputs)).next_multiple_of(ARRAY_ALIGN);
        table[i] = (weights, bias);
        at = bias + 4 * padded(outputs);
        i += 1;
    }
    table
}

/// A view of one dense layer, `y = W x + b`.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'a> {
    /// Length of `x`.
    pub inputs: usize,
    /// Length of `y`, without padding.
    pub outputs: usize,
    /// `W` in panels, `[outputs / PANEL][inputs][PANEL]`.
    pub panels: &'a [f32],
    /// `b`, padded to whole panels.
    pub bias: &'a [f32],
}

impl<'a> Dense<'a> {
    /// A layer over arrays of exactly the padded lengths; `None` for any other length.
    pub fn new(inputs: usize, outputs: usize, panels: &'a [f32], bias: &'a [f32]) -> Option<Self> {
        let fits = panels.len() == inputs * padded(outputs) && bias.len() == padded(outputs);
        fits.then_some(Dense {
            inputs,
            outputs,
            panels,
            bias,
        })
    }
}

/// The pointwise embedding, 3 -> 64 -> 128 -> 1024; ReLU after the first two layers only.
#[derive(Clone, Copy, Debug)]
pub struct Embedding<'a> {
    /// The three layers.
    pub layers: [Dense<'a>; 3],
}

/// One policy head, 2048 -> 512 -> 256 -> 33; ReLU after the first two layers.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// The three layers.
    pub layers: [Dense<'a>; 3],
}

/// A checked view of a policy file.
#[derive(Clone, Copy, Debug)]
pub struct Policy<'a> {
    /// Cloud to global feature.
    pub embedding: Embedding<'a>,
    /// State to translation logits.
    pub translation: Head<'a>,
    /// State to rotation logits.
    pub rotation: Head<'a>,
}

impl<'a> Policy<'a> {
    /// Checks every byte of a policy file once: header, layer table, check sum, finite weights.
    ///
    /// # Errors
    /// The `Weights…` variants of [`Error`]; any flipped bit or cut gives one.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Error> {
        let field = |at: usize| -> Option<u32> {
            Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
        };
        let half = |at: usize| field(at & !3).map(|word| (word >> (8 * (at & 3))) as u16);
        let cut = Error::WeightsLength {
            expected: FILE_LEN,
            found: bytes.len(),
        };
        if bytes.get(..4).ok_or(cut)? != MAGIC {
            return Err(Error::WeightsMagic);
        }
        let version = half(4).ok_or(cut)?;
        if version != VERSION {
            return Err(Error::WeightsVersion { found: version });
        }
        let format = half(6).ok_or(cut)?;
        if format != FORMAT_F32 {
            return Err(Error::WeightsFormat { found: format });
        }
        let announced = field(8).ok_or(cut)? as usize;
        if announced != bytes.len() {
            return Err(Error::WeightsLength {
                expected: announced,
                found: bytes.len(),
            });
        }
        if bytes.len() != FILE_LEN {
            return Err(cut);
        }
        let (body, sum) = bytes.split_last_chunk::<4>().ok_or(cut)?;
        if *sum != checksum(body).to_le_bytes() {
            return Err(Error::WeightsCrc);
        }
        if field(12) != Some(LAYERS as u32) {
            return Err(Error::WeightsShape { layer: LAYERS });
        }
        for (i, &width) in SHAPE.iter().enumerate() {
            if half(16 + 2 * i) != Some(width) {
                return Err(Error::WeightsShape { layer: 0 });
            }
        }
        let layer = |i: usize| -> Result<Dense<'a>, Error> {
            let wrong = Error::WeightsShape { layer: i };
            let (&(inputs, outputs), &(weights, bias)) =
                LAYER_SHAPES.get(i).zip(OFFSETS.get(i)).ok_or(wrong)?;
            let row = HEADER + i * TABLE_ROW;
            for (k, expected) in [inputs, outputs, weights, bias].into_iter().enumerate() {
                if field(row + 4 * k) != Some(expected as u32) {
                    return Err(wrong);
                }
            }
            let array = |at: usize, len: usize| -> Result<&'a [f32], Error> {
                let raw = bytes.get(at..at + 4 * len).ok_or(wrong)?;
                let values: &[f32] =
                    bytemuck::try_cast_slice(raw).map_err(|_| Error::WeightsAlignment)?;
                if values.iter().all(|v| v.is_finite()) {
                    Ok(values)
                } else {
                    Err(Error::WeightsNotFinite { layer: i })
                }
            };
            let panels = array(weights, inputs * padded(outputs))?;
            let bias = array(bias, padded(outputs))?;
            Dense::new(inputs, outputs, panels, bias).ok_or(wrong)
        };
        Ok(Policy {
            embedding: Embedding {
                layers: [layer(0)?, layer(1)?, layer(2)?],
            },
            translation: Head {
                layers: [layer(3)?, layer(4)?, layer(5)?],
            },
            rotation: Head {
                layers: [layer(6)?, layer(7)?, layer(8)?],
            },
        })
    }
}

/// The file's CRC-32 (ISO-HDLC, the one of zip and Ethernet).
pub fn checksum(body: &[u8]) -> u32 {
    const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    CRC.checksum(body)
}

/// Copies a row-major `[outputs, inputs]` matrix into panels; `panels` has the padded length.
pub fn pack_panels(inputs: usize, outputs: usize, row_major: &[f32], panels: &mut [f32]) {
    for (p, panel) in panels.chunks_exact_mut(inputs * PANEL).enumerate() {
        for (k, lanes) in panel.chunks_exact_mut(PANEL).enumerate() {
            for (lane, value) in lanes.iter_mut().enumerate() {
                let row = p * PANEL + lane;
                *value = if row < outputs {
                    row_major.get(row * inputs + k).copied().unwrap_or(0.0)
                } else {
                    0.0
                };
            }
        }
    }
}
