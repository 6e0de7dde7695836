//! The policy in flash: behind its manifest's frame, read in place, replaced chunk by chunk.

use crate::hardware::Flash;
use reagent_core::Policy;
use reagent_core::wire::{self, Chunk, FLASH_HEADER_BYTES, Manifest, Message, PolicyId};

/// The manifest and the policy in flash, if both are sound.
pub(crate) fn load(flash: &Flash) -> Option<(PolicyId, Policy<'_>)> {
    let bytes = flash.bytes();
    let (length, _) = bytes.split_first_chunk::<4>()?;
    let end = 4usize.checked_add(u32::from_le_bytes(*length) as usize)?;
    let frame = bytes.get(4..end.min(FLASH_HEADER_BYTES))?;
    let Ok(Message::Manifest(manifest)) = wire::decode(frame) else {
        return None;
    };
    let file = bytes.get(FLASH_HEADER_BYTES..)?;
    let policy = Policy::parse(file.get(..manifest.length as usize)?).ok()?;
    let id = PolicyId {
        version: manifest.version,
        sha256: manifest.sha256,
    };
    Some((id, policy))
}

/// A policy on its way into flash. The one before is gone from the start: there is room for one.
pub(crate) struct Update {
    manifest: Manifest,
    chunks: u32,
    next: u32,
}

/// What to do after a chunk.
pub(crate) enum Progress {
    /// Wait for the next one.
    More,
    /// The policy is in flash.
    Done,
    /// The chunk is not the one that should have come.
    Failed,
}

impl Update {
    /// Erases the flash. `None` where the file would not fit.
    pub(crate) fn begin(flash: &mut Flash, manifest: Manifest) -> Option<Update> {
        let chunks = manifest.chunks()?;
        if manifest.length as usize > Flash::LENGTH - FLASH_HEADER_BYTES {
            return None;
        }
        flash.write(0, &[0xff; FLASH_HEADER_BYTES]);
        Some(Update {
            manifest,
            chunks,
            next: 0,
        })
    }

    /// Writes a chunk, and after the last the manifest, which makes it count.
    pub(crate) fn write(&mut self, flash: &mut Flash, chunk: Chunk<'_>) -> Progress {
        let at = self.next.wrapping_mul(self.manifest.chunk_length);
        let expected = self
            .manifest
            .chunk_length
            .min(self.manifest.length - at.min(self.manifest.length));
        if chunk.index != self.next || chunk.bytes.len() != expected as usize {
            return Progress::Failed;
        }
        flash.write(FLASH_HEADER_BYTES + at as usize, chunk.bytes);
        self.next += 1;
        if self.next < self.chunks {
            return Progress::More;
        }
        let mut header = [0; FLASH_HEADER_BYTES];
        let (length, frame) = header.split_at_mut(4);
        if let Ok(frame) = wire::encode(&Message::Manifest(self.manifest.clone()), frame) {
            length.copy_from_slice(&(frame.len() as u32).to_le_bytes());
            flash.write(0, &header);
        }
        Progress::Done
    }
}
