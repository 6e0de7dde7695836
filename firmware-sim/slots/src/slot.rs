//! The content of a slot: head, signed manifest, table of chunks, file.

use crate::layout::{FRAME_BYTES, HASH_BYTES, HEAD_BYTES, Slot};
use crate::{SlotError, Slots};
use crc::{CRC_32_ISO_HDLC, Crc};
use embedded_storage_async::nor_flash::NorFlash;
use sha2::{Digest, Sha256};

const MAGIC: [u8; 4] = *b"RSLT";
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// Bytes read from flash at once.
const BLOCK: usize = 256;

/// What a slot's head says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Bytes of the signed manifest.
    pub frame: u32,
    /// Bytes of the policy file.
    pub length: u32,
}

impl Header {
    /// The head without its checksum.
    fn fields(&self, chunk: u32) -> [u8; 16] {
        let [[a, b, c, d], [e, f, g, h], [i, j, k, l]] =
            [self.frame, self.length, chunk].map(u32::to_le_bytes);
        let [m, n, o, p] = MAGIC;
        [m, n, o, p, a, b, c, d, e, f, g, h, i, j, k, l]
    }
}

/// The first four numbers in these bytes.
fn words(bytes: &[u8]) -> [u32; 4] {
    let mut words = [0; 4];
    for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
        *word = u32::from_le_bytes(*bytes);
    }
    words
}

impl<F: NorFlash> Slots<F> {
    /// Reads a slot's head; `None` if there is none that is intact.
    ///
    /// # Errors
    /// `Flash`.
    pub async fn header(&mut self, slot: Slot) -> Result<Option<Header>, SlotError<F::Error>> {
        let start = self.layout.range(slot).start;
        let mut head = [0u8; HEAD_BYTES as usize];
        self.read_at(start, &mut head).await?;
        let [fields, [check, ..]] = [&head[..16], &head[16..]].map(words);
        let [magic, frame, length, chunk] = fields;
        let header = Header { frame, length };
        let possible = magic == u32::from_le_bytes(MAGIC)
            && chunk == self.layout.chunk
            && header.frame <= FRAME_BYTES
            && header.length <= self.layout.capacity::<F>();
        if !possible {
            return Ok(None);
        }
        let mut crc = CRC.digest();
        crc.update(&header.fields(chunk));
        let frame = start + HEAD_BYTES;
        self.visit(frame, header.frame, |bytes| crc.update(bytes))
            .await?;
        let table = HASH_BYTES * header.length.div_ceil(self.layout.chunk);
        self.visit(frame + FRAME_BYTES, table, |bytes| crc.update(bytes))
            .await?;
        Ok((crc.finalize() == check).then_some(header))
    }

    /// Copies a slot's signed manifest to the front of `buffer`; `None` if the slot holds none or the buffer is too short. The caller
    /// must check who signed it.
    ///
    /// # Errors
    /// `Flash`.
    pub async fn frame<'b>(
        &mut self,
        slot: Slot,
        buffer: &'b mut [u8],
    ) -> Result<Option<&'b [u8]>, SlotError<F::Error>> {
        let Some(header) = self.header(slot).await? else {
            return Ok(None);
        };
        let Some(frame) = buffer.get_mut(..header.frame as usize) else {
            return Ok(None);
        };
        let start = self.layout.range(slot).start;
        self.read_at(start + HEAD_BYTES, frame).await?;
        Ok(Some(frame))
    }

    /// Reads part of a slot's policy file.
    ///
    /// # Errors
    /// `Flash`, also for a range outside the flash.
    pub async fn read(
        &mut self,
        slot: Slot,
        offset: u32,
        bytes: &mut [u8],
    ) -> Result<(), SlotError<F::Error>> {
        let start = self.file(slot);
        self.read_at(start + offset, bytes).await
    }

    /// Where a slot's policy file starts, for flash that is read in place.
    pub fn file(&self, slot: Slot) -> u32 {
        self.layout.range(slot).start + self.layout.header::<F>()
    }

    /// Whether nothing was ever written into a slot.
    pub(crate) async fn is_blank(&mut self, slot: Slot) -> Result<bool, SlotError<F::Error>> {
        let mut blank = true;
        let (start, length) = (self.layout.range(slot).start, self.layout.header::<F>());
        self.visit(start, length, |bytes| {
            blank &= bytes.iter().all(|&byte| byte == 0xff);
        })
        .await?;
        Ok(blank)
    }

    pub(crate) async fn holds(
        &mut self,
        slot: Slot,
        header: &Header,
        frame: &[u8],
        table: &[[u8; 32]],
    ) -> Result<bool, SlotError<F::Error>> {
        if self.header(slot).await? != Some(*header) {
            return Ok(false);
        }
        let start = self.layout.range(slot).start + HEAD_BYTES;
        Ok(self.equals(start, frame).await?
            && self
                .equals(start + FRAME_BYTES, table.as_flattened())
                .await?)
    }

    pub(crate) async fn write_header(
        &mut self,
        slot: Slot,
        header: &Header,
        frame: &[u8],
        table: &[[u8; 32]],
    ) -> Result<(), SlotError<F::Error>> {
        let start = self.layout.range(slot).start;
        let end = start + self.layout.header::<F>();
        let erased = self.flash.erase(start, end).await;
        erased.map_err(SlotError::Flash)?;
        self.write_at(start + HEAD_BYTES, frame).await?;
        self.write_at(start + HEAD_BYTES + FRAME_BYTES, table.as_flattened())
            .await?;
        let fields = header.fields(self.layout.chunk);
        let mut crc = CRC.digest();
        for part in [&fields, frame, table.as_flattened()] {
            crc.update(part);
        }
        let mut head = [0xff; HEAD_BYTES as usize];
        let check = crc.finalize().to_le_bytes();
        for (to, from) in head.iter_mut().zip(fields.iter().chain(&check)) {
            *to = *from;
        }
        self.write_at(start, &head).await
    }

    /// Bytes of a chunk; 0 for one beyond the file.
    pub(crate) fn chunk_length(&self, header: &Header, index: u32) -> u32 {
        let chunk = self.layout.chunk;
        let before = index.saturating_mul(chunk);
        header.length.saturating_sub(before).min(chunk)
    }

    pub(crate) async fn hash_of(
        &mut self,
        slot: Slot,
        index: u32,
    ) -> Result<[u8; 32], SlotError<F::Error>> {
        let table = self.layout.range(slot).start + HEAD_BYTES + FRAME_BYTES;
        let mut hash = [0; HASH_BYTES as usize];
        self.read_at(table + HASH_BYTES * index, &mut hash).await?;
        Ok(hash)
    }

    /// Whether a chunk's bytes have its hash.
    pub(crate) async fn has_chunk(
        &mut self,
        slot: Slot,
        header: &Header,
        index: u32,
    ) -> Result<bool, SlotError<F::Error>> {
        let at = self.file(slot) + index * self.layout.chunk;
        let length = self.chunk_length(header, index);
        let mut sha = Sha256::new();
        self.visit(at, length, |bytes| sha.update(bytes)).await?;
        let found: [u8; 32] = sha.finalize().into();
        Ok(found == self.hash_of(slot, index).await?)
    }

    pub(crate) async fn put_chunk(
        &mut self,
        slot: Slot,
        header: &Header,
        index: u32,
        bytes: &[u8],
    ) -> Result<(), SlotError<F::Error>> {
        let length = bytes.len() as u32;
        if length == 0 || length != self.chunk_length(header, index) {
            return Err(SlotError::Length { index, length });
        }
        let found: [u8; 32] = Sha256::digest(bytes).into();
        if found != self.hash_of(slot, index).await? {
            return Err(SlotError::Hash { index });
        }
        let at = self.file(slot) + index * self.layout.chunk;
        let end = at + length.next_multiple_of(F::ERASE_SIZE as u32);
        let erased = self.flash.erase(at, end).await;
        erased.map_err(SlotError::Flash)?;
        self.write_at(at, bytes).await
    }

    async fn read_at(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), SlotError<F::Error>> {
        // Flash may only be read in whole words.
        let word = F::READ_SIZE as u32;
        if at.is_multiple_of(word) && bytes.len().is_multiple_of(F::READ_SIZE) {
            let read = self.flash.read(at, bytes).await;
            return read.map_err(SlotError::Flash);
        }
        let mut block = [0; BLOCK];
        let mut at = at;
        let mut left = bytes;
        while !left.is_empty() {
            let skip = at % word;
            let wanted = (left.len() as u32).min(BLOCK as u32 - skip);
            let whole = (skip + wanted).next_multiple_of(word) as usize;
            let words = block.get_mut(..whole).unwrap_or(&mut []);
            let read = self.flash.read(at - skip, words).await;
            read.map_err(SlotError::Flash)?;
            let (now, rest) = left.split_at_mut(wanted as usize);
            for (to, from) in now.iter_mut().zip(words.iter().skip(skip as usize)) {
                *to = *from;
            }
            (at, left) = (at + wanted, rest);
        }
        Ok(())
    }

    async fn visit(
        &mut self,
        at: u32,
        length: u32,
        mut see: impl FnMut(&[u8]),
    ) -> Result<(), SlotError<F::Error>> {
        let mut block = [0; BLOCK];
        let mut seen = 0;
        while seen < length {
            let n = (length - seen).min(BLOCK as u32);
            let bytes = block.get_mut(..n as usize).unwrap_or(&mut []);
            self.read_at(at + seen, bytes).await?;
            see(bytes);
            seen += n;
        }
        Ok(())
    }

    async fn equals(&mut self, at: u32, expected: &[u8]) -> Result<bool, SlotError<F::Error>> {
        let mut equal = true;
        let mut left = expected;
        self.visit(at, expected.len() as u32, |bytes| {
            let (now, rest) = left.split_at(bytes.len());
            equal &= now == bytes;
            left = rest;
        })
        .await?;
        Ok(equal)
    }

    /// Writes whole words. The rest of the last word is left erased.
    async fn write_at(&mut self, at: u32, bytes: &[u8]) -> Result<(), SlotError<F::Error>> {
        let whole = bytes.len() / F::WRITE_SIZE * F::WRITE_SIZE;
        let (words, rest) = bytes.split_at(whole);
        let written = self.flash.write(at, words).await;
        written.map_err(SlotError::Flash)?;
        if rest.is_empty() {
            return Ok(());
        }
        let mut last = [0xff; HEAD_BYTES as usize];
        for (to, from) in last.iter_mut().zip(rest) {
            *to = *from;
        }
        let last = last.get(..F::WRITE_SIZE).unwrap_or(&last);
        let written = self.flash.write(at + whole as u32, last).await;
        written.map_err(SlotError::Flash)
    }
}
