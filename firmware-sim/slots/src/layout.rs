//! The layout of the flash.

use core::ops::Range;
use embedded_storage_async::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};

/// Most bytes of the signed manifest that is kept with a policy.
pub const FRAME_BYTES: u32 = 1024;
/// Bytes of one entry of the table of chunks: a SHA-256.
pub const HASH_BYTES: u32 = 32;
/// Bytes of a slot's head, before the frame. No supported flash writes longer words.
pub(crate) const HEAD_BYTES: u32 = 32;

/// One of the two places for a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Slot {
    /// The first.
    A,
    /// The second.
    B,
}

impl Slot {
    /// The other one.
    pub fn other(self) -> Slot {
        match self {
            Slot::A => Slot::B,
            Slot::B => Slot::A,
        }
    }
}

/// Parts of the flash, in bytes from its start. Each consists of whole erase blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// The two copies of the record of which slot counts: at least two erase blocks each.
    pub records: [Range<u32>; 2],
    /// Slots A and B, of equal length.
    pub slots: [Range<u32>; 2],
    /// Bytes of every chunk of a policy file except the last: whole erase blocks.
    pub chunk: u32,
}

/// Why a layout cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// A part is not whole erase blocks, lies outside the flash, or overlaps another.
    #[error("flash layout: parts must be whole erase blocks within the flash that do not overlap")]
    Parts,
    /// A record has fewer than two erase blocks.
    #[error("flash layout: each record needs at least two erase blocks")]
    Record,
    /// The slots differ in length or are too short for a chunk.
    #[error("flash layout: slots must have equal length and hold at least one chunk")]
    Slots,
    /// Chunks are not whole erase blocks.
    #[error("flash layout: chunks must be whole erase blocks")]
    Chunk,
    /// The flash writes words of more than 32 bytes.
    #[error("flash layout: words of more than 32 bytes are not supported")]
    Word,
}

impl Layout {
    /// A layout over a whole flash: record, slot A, slot B, record.
    pub fn over<F: NorFlash>(capacity: u32, chunk: u32) -> Layout {
        let block = F::ERASE_SIZE as u32;
        let record = 2 * block;
        let slot = capacity.saturating_sub(2 * record) / 2 / block * block;
        let second = record + slot;
        let end = second + slot;
        Layout {
            records: [0..record, end..end + record],
            slots: [record..second, second..end],
            chunk,
        }
    }

    pub(crate) fn check<F: NorFlash>(&self, capacity: u32) -> Result<(), LayoutError> {
        let block = F::ERASE_SIZE as u32;
        let ([a, b], [first, second]) = (&self.slots, &self.records);
        let mut parts = [first, second, a, b];
        parts.sort_unstable_by_key(|part| part.start);
        let whole = |part: &&Range<u32>| {
            part.start < part.end
                && part.end <= capacity
                && part.start.is_multiple_of(block)
                && part.end.is_multiple_of(block)
        };
        let apart = parts.array_windows().all(|[p, q]| p.end <= q.start);
        if !parts.iter().all(whole) || !apart {
            return Err(LayoutError::Parts);
        }
        if first.len().min(second.len()) < 2 * block as usize {
            return Err(LayoutError::Record);
        }
        if self.chunk == 0 || !self.chunk.is_multiple_of(block) {
            return Err(LayoutError::Chunk);
        }
        if a.len() != b.len() || self.capacity::<F>() < self.chunk {
            return Err(LayoutError::Slots);
        }
        if F::WRITE_SIZE as u32 > HEAD_BYTES {
            return Err(LayoutError::Word);
        }
        Ok(())
    }

    pub(crate) fn range(&self, slot: Slot) -> Range<u32> {
        let [a, b] = &self.slots;
        match slot {
            Slot::A => a.clone(),
            Slot::B => b.clone(),
        }
    }

    /// Chunks that a slot's table has room for.
    fn most_chunks(&self) -> u32 {
        self.slots[0].len() as u32 / self.chunk
    }

    /// Bytes before a slot's file: head, frame, table.
    pub(crate) fn header<F: NorFlash>(&self) -> u32 {
        let bytes = HEAD_BYTES + FRAME_BYTES + HASH_BYTES * self.most_chunks();
        bytes.next_multiple_of(F::ERASE_SIZE as u32)
    }

    /// Most bytes of a policy file.
    pub fn capacity<F: NorFlash>(&self) -> u32 {
        let room = (self.slots[0].len() as u32).saturating_sub(self.header::<F>());
        room.min(self.most_chunks() * self.chunk)
    }
}
