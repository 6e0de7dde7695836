//! Frames on a serial line: the frame and its CRC-32 (ISO-HDLC, little-endian), stuffed with COBS, then a zero. A line may
//! lose, flip or add bytes anywhere: the next zero starts anew, and the checksum rejects what is not a whole frame.

use crate::weights::checksum;
use cobs::{DecodeResult, DecoderState};

/// Bytes of the checksum.
pub const CHECK_BYTES: usize = 4;
/// Most bytes that follow one COBS code byte.
const BLOCK: usize = 254;

/// Most bytes on the line for a frame of `length` bytes.
pub const fn line_bytes(length: usize) -> usize {
    let stuffed = length + CHECK_BYTES;
    stuffed + stuffed / BLOCK + 2
}

/// Passes the line's bytes for a frame to `put`, in order.
pub fn write(frame: &[u8], mut put: impl FnMut(u8)) {
    let sum = checksum(frame).to_le_bytes();
    let mut block = [0u8; BLOCK];
    let mut used = 0;
    let mut end_block = |code: usize, block: &[u8; BLOCK], used: usize| {
        put(code as u8);
        block.iter().take(used).for_each(|&byte| put(byte));
    };
    for &byte in frame.iter().chain(&sum) {
        if byte == 0 {
            end_block(used + 1, &block, used);
            used = 0;
        } else if let Some(place) = block.get_mut(used) {
            *place = byte;
            used += 1;
            if used == BLOCK {
                end_block(BLOCK + 1, &block, used);
                used = 0;
            }
        }
    }
    end_block(used + 1, &block, used);
    put(0);
}

/// What a byte completed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A frame of this length is at the front of the space.
    Frame(usize),
    /// A frame that does not fit: its beginning fills the space, and this is its length, unless it is damaged.
    Overlong(usize),
    /// Not a frame.
    Broken,
}

/// Decodes the bytes of a line one by one. Until a frame ends, the caller must pass the same space.
#[derive(Debug)]
pub struct Decoder {
    state: DecoderState,
    length: usize,
}

impl Decoder {
    /// A decoder at the start of a frame.
    pub const fn new() -> Decoder {
        Decoder {
            state: DecoderState::Idle,
            length: 0,
        }
    }

    /// Whether no byte of the next frame has arrived yet.
    pub fn is_idle(&self) -> bool {
        matches!(self.state, DecoderState::Idle)
    }

    /// Takes one byte; `None` while the frame goes on.
    pub fn push(&mut self, byte: u8, space: &mut [u8]) -> Option<Line> {
        match self.state.feed(byte) {
            Ok(DecodeResult::NoData) => None,
            Ok(DecodeResult::DataContinue(byte)) => {
                if let Some(place) = space.get_mut(self.length) {
                    *place = byte;
                }
                self.length = self.length.saturating_add(1);
                None
            }
            Ok(DecodeResult::DataComplete) => {
                let length = core::mem::take(&mut self.length);
                Some(match space.get(..length) {
                    None => Line::Overlong(length.saturating_sub(CHECK_BYTES)),
                    Some(whole) => match whole.split_last_chunk::<CHECK_BYTES>() {
                        Some((frame, sum)) if *sum == checksum(frame).to_le_bytes() => {
                            Line::Frame(frame.len())
                        }
                        _ => Line::Broken,
                    },
                })
            }
            Err(_) => {
                self.length = 0;
                Some(Line::Broken)
            }
        }
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(frame: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(frame, |byte| bytes.push(byte));
        assert!(bytes.len() <= line_bytes(frame.len()));
        bytes
    }

    /// Everything that ends within `bytes`: frames with their content, or errors.
    fn read(bytes: &[u8], space: usize) -> Vec<Result<Vec<u8>, Line>> {
        let (mut decoder, mut space) = (Decoder::new(), vec![0; space]);
        let ends = bytes.iter().filter_map(|&b| {
            let end = decoder.push(b, &mut space)?;
            Some(match end {
                Line::Frame(length) => Ok(space[..length].to_vec()),
                end => Err(end),
            })
        });
        ends.collect()
    }

    #[test]
    fn lines_are_these_bytes() {
        // The frame that asks a board how it is, with the CRC-32 that zlib computes for it.
        assert_eq!(line(&[2, 6]), [7, 2, 6, 0x48, 0xd5, 0x8c, 0x9a, 0]);
        assert_eq!(line(&[]), [1, 1, 1, 1, 1, 0]);
    }

    #[test]
    fn what_does_not_fit_is_told_with_its_length() {
        let frame: Vec<u8> = (0..1000).map(|i| i as u8).collect();
        let bytes = line(&frame);
        assert_eq!(read(&bytes, 1003), [Err(Line::Overlong(1000))]);
        assert_eq!(read(&bytes, 1004), [Ok(frame)]);
    }

    fn frames() -> impl Strategy<Value = Vec<Vec<u8>>> {
        let byte = prop_oneof![Just(0u8), Just(255), any::<u8>()];
        let short = proptest::collection::vec(byte, 0..40);
        let long = (0usize..800, any::<u8>()).prop_map(|(n, b)| vec![b; n]);
        proptest::collection::vec(prop_oneof![short, long], 0..6)
    }

    proptest! {
        #[test]
        fn frames_come_as_they_went(frames in frames()) {
            let bytes: Vec<u8> = frames.iter().flat_map(|f| line(f)).collect();
            let expected: Vec<_> = frames.into_iter().map(Ok).collect();
            prop_assert_eq!(read(&bytes, 900), expected);
        }

        #[test]
        fn the_cobs_crate_reads_the_same(frames in frames()) {
            for frame in frames {
                let bytes = line(&frame);
                let mut space = vec![0; 900];
                let length = cobs::decode(&bytes, &mut space);
                prop_assert_eq!(length.ok(), Some(frame.len() + CHECK_BYTES));
                prop_assert_eq!(&space[..frame.len()], &frame[..]);
            }
        }

        #[test]
        fn after_garbage_the_next_frame_is_read(
            garbage in proptest::collection::vec(any::<u8>(), 0..600),
            frame in proptest::collection::vec(any::<u8>(), 0..300),
            space in 304usize..400,
        ) {
            let bytes = [&garbage[..], &[0], &line(&frame)].concat();
            prop_assert_eq!(read(&bytes, space).pop(), Some(Ok(frame)));
        }

        #[test]
        fn a_damaged_or_cut_frame_is_never_taken_for_one(
            frame in proptest::collection::vec(any::<u8>(), 1..300),
            at in any::<prop::sample::Index>(),
            flip in 1u8..,
            cut in any::<bool>(),
        ) {
            let mut bytes = line(&frame);
            let at = at.index(bytes.len() - 1);
            if cut {
                bytes.remove(at);
            } else {
                bytes[at] ^= flip;
            }
            bytes.push(0);
            for end in read(&bytes, 400) {
                prop_assert!(matches!(end, Err(Line::Broken)), "{:?}", end);
            }
        }

        #[test]
        fn frames_put_between_two_bytes_of_another_cost_at_most_that_one(
            outer in proptest::collection::vec(any::<u8>(), 1..300),
            inner in proptest::collection::vec(any::<u8>(), 1..300),
            at in any::<prop::sample::Index>(),
        ) {
            let bytes = line(&outer);
            let at = at.index(bytes.len());
            let mixed = [&bytes[..at], &[0], &line(&inner), &bytes[at..]].concat();
            prop_assert!(read(&mixed, 400).contains(&Ok(inner)));
        }
    }
}
