//! The robot's policies in flash, so that it can start without a host: see [`reagent_slots`].

use crate::flash::{CAPACITY, FILE, RobotFlash};
use crate::policy::{LoadedPolicy, Trust, UpdateError, verified_manifest};
use reagent_core::wire::{CHUNK_BYTES, Manifest, Release};
use reagent_slots::{Boot, FRAME_BYTES, Floor, Slot, SlotError, Slots};
use std::path::Path;

fn failed(directory: &Path, reason: std::io::Error) -> UpdateError {
    UpdateError::Store {
        path: directory.display().to_string(),
        reason,
    }
}

/// Two policy slots, and the manifests and policies in them.
pub(crate) struct Store {
    slots: Slots<RobotFlash>,
    /// The file, for messages.
    path: String,
}

impl Store {
    /// Opens the flash in a directory, or a flash in memory if there is none.
    ///
    /// # Errors
    /// `Store`; `Lost` if nothing in the flash says below which version the robot must not go.
    pub(crate) async fn open(directory: Option<&Path>) -> Result<Store, UpdateError> {
        let path = directory.map(|directory| directory.join(FILE));
        let path = path.unwrap_or_default().display().to_string();
        let found = std::fs::metadata(&path).ok();
        let flash = match directory {
            None => RobotFlash::in_memory(),
            Some(directory) => {
                RobotFlash::in_directory(directory).map_err(|reason| failed(directory, reason))?
            }
        };
        let layout = RobotFlash::layout(CHUNK_BYTES as u32);
        let slots = match Slots::open(flash, layout).await {
            Err(reason @ SlotError::Lost) => return Err(UpdateError::Lost { path, reason }),
            opened => opened?,
        };
        if slots.needs_repair() {
            tracing::warn!("{path}: a copy of the record was lost and is made anew from the other");
        }
        if slots.is_new() && directory.is_some() {
            match found {
                // A robot's file has its full length from the start, so the content of a shorter one is lost.
                Some(found) if found.len() < CAPACITY as u64 => {
                    let reason = SlotError::Lost;
                    return Err(UpdateError::Lost { path, reason });
                }
                Some(_) => tracing::warn!(
                    "{path} holds nothing: it was wiped, unless this robot never had a policy; it takes every version \
                     that a trusted key has signed"
                ),
                None => tracing::info!(
                    "{path} is new: the robot takes every version that a trusted key has signed"
                ),
            }
        }
        if let Some(directory) = directory {
            let whole = slots.flash().make_whole();
            whole.map_err(|reason| failed(directory, reason))?;
        }
        Ok(Store { slots, path })
    }

    /// The policy in use, verified as if it had just been fetched; `None` if there is none yet.
    ///
    /// # Errors
    /// `Kept`.
    pub(crate) async fn boot(
        &mut self,
        trust: &Trust,
    ) -> Result<Option<LoadedPolicy>, UpdateError> {
        let booted = self.try_boot(trust).await;
        booted.map_err(|reason| UpdateError::Kept {
            path: self.path.clone(),
            reason: reason.into(),
        })
    }

    async fn try_boot(&mut self, trust: &Trust) -> Result<Option<LoadedPolicy>, UpdateError> {
        let slot = match self.slots.boot().await? {
            Boot::Empty | Boot::Reverted(None) => return Ok(None),
            Boot::Confirmed(slot) => slot,
            Boot::Reverted(Some(slot)) => {
                tracing::warn!("the last policy did not pass its trial; the one before it is used");
                slot
            }
        };
        let policy = self.load(slot, trust).await?;
        let (given, last) = (policy.manifest().release(), self.floor());
        // Somebody has put an older policy there.
        if given < last {
            return Err(UpdateError::NotNewer { given, last });
        }
        Ok(Some(policy))
    }

    /// The release of the newest policy that was ever in use.
    pub(crate) fn floor(&self) -> Release {
        let Floor { epoch, version } = self.slots.floor();
        Release { epoch, version }
    }

    /// Checks that written data will be found again after a restart.
    ///
    /// # Errors
    /// `Gone`.
    pub(crate) fn check_in_place(&self) -> Result<(), UpdateError> {
        match self.slots.flash().is_in_place() {
            true => Ok(()),
            false => Err(UpdateError::Gone {
                path: self.path.clone(),
            }),
        }
    }

    /// The slots, for a download.
    pub(crate) fn slots(&mut self) -> &mut Slots<RobotFlash> {
        &mut self.slots
    }

    /// Tries the downloaded policy: verifies it as a whole and tests that it does what its manifest says. If it passes, it is in
    /// use from then on; otherwise the one before it stays in use.
    pub(crate) async fn take(
        &mut self,
        manifest: &Manifest,
        trust: &Trust,
    ) -> Result<LoadedPolicy, UpdateError> {
        let slot = self.slots.try_out().await?;
        let tried = self.load(slot, trust).await.and_then(|policy| {
            policy.test()?;
            Ok(policy)
        });
        match tried {
            Ok(policy) => {
                let Release { epoch, version } = manifest.release();
                self.slots.confirm(Floor { epoch, version }).await?;
                Ok(policy)
            }
            Err(error) => {
                self.slots.revert().await?;
                Err(error)
            }
        }
    }

    async fn load(&mut self, slot: Slot, trust: &Trust) -> Result<LoadedPolicy, UpdateError> {
        let mut frame = [0; FRAME_BYTES as usize];
        let frame = self.slots.frame(slot, &mut frame).await?;
        let manifest = verified_manifest(frame.unwrap_or_default(), trust)?;
        let mut bytes = vec![0; manifest.length as usize];
        self.slots.read(slot, 0, &mut bytes).await?;
        LoadedPolicy::new(manifest, &bytes)
    }
}
