//! The robot's policies in flash, so that it starts without a host: see [`reagent_slots`].

use crate::flash::RobotFlash;
use crate::policy::{LoadedPolicy, UpdateError, verified_manifest};
use ed25519_dalek::VerifyingKey;
use reagent_core::wire::{CHUNK_BYTES, Manifest};
use reagent_slots::{Boot, FRAME_BYTES, Slot, Slots};
use std::path::Path;

/// Two policy slots, and the manifests and policies in them.
pub(crate) struct Store {
    slots: Slots<RobotFlash>,
}

impl Store {
    /// Opens the flash in a directory, or one in memory without. A record that is damaged beyond repair is
    /// formatted: the fleet's policy comes again.
    pub(crate) async fn open(directory: Option<&Path>) -> Result<Store, UpdateError> {
        let flash = || match directory {
            None => Ok(RobotFlash::in_memory()),
            Some(path) => RobotFlash::in_directory(path).map_err(|reason| UpdateError::Store {
                path: path.display().to_string(),
                reason,
            }),
        };
        let layout = || RobotFlash::layout(CHUNK_BYTES as u32);
        let slots = match Slots::open(flash()?, layout()).await {
            Err(reagent_slots::SlotError::Record(damage)) => {
                tracing::warn!("the record in flash is damaged ({damage}) and is formatted");
                Slots::format(flash()?, layout()).await?
            }
            opened => opened?,
        };
        Ok(Store { slots })
    }

    /// The policy that counts, verified as if it had just been fetched; `None` where there is none yet.
    pub(crate) async fn boot(
        &mut self,
        trusted: &[VerifyingKey],
    ) -> Result<Option<LoadedPolicy>, UpdateError> {
        let slot = match self.slots.boot().await? {
            Boot::Empty | Boot::Reverted(None) => return Ok(None),
            Boot::Confirmed(slot) => slot,
            Boot::Reverted(Some(slot)) => {
                tracing::warn!("the last policy did not pass its trial; the one before it is used");
                slot
            }
        };
        self.load(slot, trusted).await.map(Some)
    }

    /// Version of the newest policy that was ever in use.
    pub(crate) fn floor(&self) -> u64 {
        self.slots.floor()
    }

    /// The slots, for a download.
    pub(crate) fn slots(&mut self) -> &mut Slots<RobotFlash> {
        &mut self.slots
    }

    /// Tries the policy that was downloaded: verifies it as a whole and has it do what its manifest says it
    /// does. It counts from then on, or the one before it goes on.
    pub(crate) async fn take(
        &mut self,
        manifest: &Manifest,
        trusted: &[VerifyingKey],
    ) -> Result<LoadedPolicy, UpdateError> {
        let slot = self.slots.try_out().await?;
        let tried = self.load(slot, trusted).await.and_then(|policy| {
            policy.test()?;
            Ok(policy)
        });
        match tried {
            Ok(policy) => {
                self.slots.confirm(manifest.version).await?;
                Ok(policy)
            }
            Err(error) => {
                self.slots.revert().await?;
                Err(error)
            }
        }
    }

    async fn load(
        &mut self,
        slot: Slot,
        trusted: &[VerifyingKey],
    ) -> Result<LoadedPolicy, UpdateError> {
        let mut frame = [0; FRAME_BYTES as usize];
        let frame = self.slots.frame(slot, &mut frame).await?;
        let manifest = verified_manifest(frame.unwrap_or_default(), trusted)?;
        let mut bytes = vec![0; manifest.length as usize];
        self.slots.read(slot, 0, &mut bytes).await?;
        LoadedPolicy::new(manifest, &bytes)
    }
}
