//! The robot's own copy of its policy, so that it starts without a host.
//!
//! `policy-<sha256>.rgw` is the file and `manifest` its signed announcement. Files are written under
//! another name and renamed; renaming `manifest` is the one moment at which the new policy counts.

use crate::policy::{LoadedPolicy, UpdateError, verified_manifest};
use ed25519_dalek::VerifyingKey;
use reagent_core::wire::keys::Hex;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A directory that holds at most one policy.
#[derive(Clone, Debug)]
pub struct Store {
    directory: PathBuf,
}

impl Store {
    /// Opens the directory and makes it where there is none.
    ///
    /// # Errors
    /// `Store`.
    pub fn open(directory: &Path) -> Result<Store, UpdateError> {
        fs::create_dir_all(directory).map_err(failed(directory))?;
        Ok(Store {
            directory: directory.into(),
        })
    }

    /// The policy kept, verified as if it had just been fetched; `None` where there is none yet.
    ///
    /// # Errors
    /// Any [`UpdateError`] that a fetched policy can give.
    pub fn load(&self, trusted: &[VerifyingKey]) -> Result<Option<LoadedPolicy>, UpdateError> {
        let path = self.manifest_path();
        let frame = match fs::read(&path) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            read => read.map_err(failed(&path))?,
        };
        let manifest = verified_manifest(&frame, trusted)?;
        let path = self.policy_path(&manifest.sha256);
        let bytes = fs::read(&path).map_err(failed(&path))?;
        LoadedPolicy::new(manifest, &bytes).map(Some)
    }

    /// Keeps a verified policy in place of the last one.
    ///
    /// # Errors
    /// `Store`; the last policy is still kept then.
    pub fn save(&self, signed_manifest: &[u8], policy: &LoadedPolicy) -> Result<(), UpdateError> {
        let kept = self.policy_path(&policy.manifest().sha256);
        write_whole(&kept, policy.bytes())?;
        write_whole(&self.manifest_path(), signed_manifest)?;
        let entries = fs::read_dir(&self.directory).map_err(failed(&self.directory))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            let old = path.extension().is_some_and(|e| e == "rgw") && path != kept;
            if old {
                fs::remove_file(&path).map_err(failed(&path))?;
            }
        }
        Ok(())
    }

    fn manifest_path(&self) -> PathBuf {
        self.directory.join("manifest")
    }

    fn policy_path(&self, sha256: &[u8; 32]) -> PathBuf {
        self.directory.join(format!("policy-{}.rgw", Hex(sha256)))
    }
}

fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), UpdateError> {
    let partial = path.with_extension("partial");
    let write = || {
        let mut file = fs::File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&partial, path)
    };
    write().map_err(failed(path))
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> UpdateError {
    let path = path.display().to_string();
    move |reason| UpdateError::Store { path, reason }
}
