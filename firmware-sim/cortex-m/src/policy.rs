//! The policy in flash. It follows its manifest's frame, is read in place, tested before it serves, and replaced chunk by chunk.

use crate::hardware::{Flash, feed_watchdog};
use crate::report::Report;
use reagent_core::golden::{self, GoldenActions};
use reagent_core::wire::{
    self, Chunk, FLASH_HEADER_BYTES, FlashCheck, Manifest, Message, PolicyId,
};
use reagent_core::{Cloud, Frame, Policy, Pose, Registrar, Registration};

/// An undamaged policy.
pub(crate) struct Loaded<'f> {
    pub(crate) id: PolicyId,
    pub(crate) policy: Policy<'f>,
    /// The actions that it must take in the self-test.
    golden: GoldenActions,
}

/// The policy in flash, if there is one and it is undamaged.
#[inline(never)]
pub(crate) fn load(flash: &Flash) -> Result<Loaded<'_>, FlashCheck> {
    let bytes = flash.bytes();
    let (header, file) = bytes
        .split_at_checked(FLASH_HEADER_BYTES)
        .ok_or(FlashCheck::Empty)?;
    let manifest = manifest(header).ok_or(FlashCheck::Empty)?;
    let file = file.get(..manifest.length as usize);
    let policy = file.and_then(|file| Policy::parse(file).ok());
    Ok(Loaded {
        id: manifest.id(),
        policy: policy.ok_or(FlashCheck::Damaged)?,
        golden: manifest.golden,
    })
}

/// The manifest at the beginning of the flash.
#[inline(never)]
fn manifest(header: &[u8]) -> Option<Manifest> {
    let (length, rest) = header.split_first_chunk::<4>()?;
    let frame = rest.get(..u32::from_le_bytes(*length) as usize)?;
    match wire::decode(frame) {
        Ok(Message::Manifest(manifest)) => Some(manifest),
        _ => None,
    }
}

impl Loaded<'_> {
    /// Whether the policy acts here as it did where it was made. The test is sliced like any registration. `space` is for two small
    /// clouds.
    // Out of line, like the functions below and `refine`, so that their frames are not on the stack at the same time.
    #[inline(never)]
    pub(crate) fn test(
        &self,
        registrar: &mut Registrar<'_, '_>,
        space: &mut [u32],
        report: &mut Report,
    ) -> FlashCheck {
        let Some([source, target]) = test_clouds(space) else {
            return FlashCheck::FailedSelfTest;
        };
        let mut registration = Registration::new();
        let (frame, initial) = (Frame::IDENTITY, Pose::IDENTITY);
        let (source, target) = (Cloud::F32(source), Cloud::F32(target));
        let begun = registrar.begin(&mut registration, source, target, frame, initial);
        if begun.is_err() {
            return FlashCheck::FailedSelfTest;
        }
        let mut expected = self.golden.iter();
        let mut next = expected.next();
        while let Some(action) = next {
            feed_watchdog();
            match report.slice(registrar, &mut registration) {
                Ok(None) => {}
                Ok(Some(step)) if step.action == *action => next = expected.next(),
                _ => return FlashCheck::FailedSelfTest,
            }
        }
        FlashCheck::Passed
    }
}

/// Draws the clouds of the self-test into `space`.
#[inline(never)]
fn test_clouds(space: &mut [u32]) -> Option<[&[[f32; 3]]; 2]> {
    let points = bytemuck::cast_slice_mut(space).as_chunks_mut::<3>().0;
    let (source, rest) = points.split_first_chunk_mut::<{ golden::POINTS }>()?;
    let target = rest.first_chunk_mut::<{ golden::POINTS }>()?;
    golden::clouds_in(source, target);
    Some([source, target])
}

/// A policy that is being written into flash. There is room for one only, so the one before is lost from the start.
pub(crate) struct Update {
    manifest: Manifest,
    chunks: u32,
    next: u32,
}

/// What to do after a chunk.
pub(crate) enum Progress {
    /// Wait for the next chunk.
    More,
    /// The policy is in flash.
    Done,
    /// The chunk is not the expected one.
    Failed,
}

impl Update {
    /// Erases the header in flash. `None` if the file would not fit.
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

    /// Writes a chunk. After the last one it writes the manifest, which makes the policy valid.
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
