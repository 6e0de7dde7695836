//! Signing keys in files: the 32-byte ed25519 seed as 64 hexadecimal digits.

use crate::files;
use ed25519_dalek::{SigningKey, VerifyingKey};
use std::io;
use std::path::Path;
use thiserror::Error;

/// Why a key cannot be used or made.
#[derive(Debug, Error)]
pub enum KeyError {
    /// There is no such file.
    #[error("{path}: no such key file; make one with `host-train keygen --out {path}`")]
    Missing {
        /// The file.
        path: String,
    },
    /// The file is not a key. The message does not quote its contents.
    #[error("{path}: not a signing key (64 hexadecimal digits)")]
    Format {
        /// The file.
        path: String,
    },
    /// The folder for it does not exist.
    #[error("{path}: no such folder; make it first")]
    Folder {
        /// The folder.
        path: String,
    },
    /// A key is never written over another file.
    #[error("{path}: exists already; a key is never overwritten")]
    Exists {
        /// The file.
        path: String,
    },
    /// The file system or the random source failed.
    #[error("{path}: {reason}")]
    Io {
        /// The file.
        path: String,
        /// What the system says.
        reason: io::Error,
    },
}

/// Makes a key from the system's random source, readable only by its owner, and returns its public half.
///
/// # Errors
/// `Folder`, `Exists`, `Io`.
pub fn keygen(path: &Path) -> Result<VerifyingKey, KeyError> {
    let mut seed = [0u8; 32];
    getrandom::fill(&mut seed).map_err(|e| failed(path, io::Error::other(e)))?;
    let text = const_hex::encode(seed) + "\n";
    files::write_secret(path, text.as_bytes()).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => KeyError::Folder {
            path: path.parent().unwrap_or(path).display().to_string(),
        },
        _ => failed(path, error),
    })?;
    Ok(SigningKey::from_bytes(&seed).verifying_key())
}

/// Reads a key that [`keygen`] made.
///
/// # Errors
/// `Missing`, `Format`, `Io`.
pub fn read_key(path: &Path) -> Result<SigningKey, KeyError> {
    let text = std::fs::read(path).map_err(|error| failed(path, error))?;
    if is_open(path) {
        tracing::warn!(
            "{}: others on this machine may read this key: is it the private half, as keygen wrote it? Then chmod 600 it",
            path.display()
        );
    }
    let decoded = const_hex::decode_to_array(text.trim_ascii());
    let seed = decoded.map_err(|_| KeyError::Format {
        path: path.display().to_string(),
    })?;
    Ok(SigningKey::from_bytes(&seed))
}

/// Whether others than the file's owner may read it.
#[cfg(unix)]
fn is_open(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    std::fs::metadata(path)
        .is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o077 != 0)
}

#[cfg(not(unix))]
fn is_open(_: &Path) -> bool {
    false
}

fn failed(path: &Path, reason: io::Error) -> KeyError {
    let path = path.display().to_string();
    match reason.kind() {
        io::ErrorKind::NotFound => KeyError::Missing { path },
        io::ErrorKind::AlreadyExists => KeyError::Exists { path },
        _ => KeyError::Io { path, reason },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_read_back_and_never_overwritten() {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let path = directory.path().join("fleet.key");
        let public = keygen(&path).expect("a new file");
        assert_eq!(read_key(&path).expect("just made").verifying_key(), public);
        assert!(matches!(keygen(&path), Err(KeyError::Exists { .. })));
        let nowhere = keygen(&directory.path().join("none/fleet.key"));
        let said = nowhere.expect_err("there is no folder").to_string();
        assert!(
            said.ends_with("none: no such folder; make it first"),
            "{said}"
        );
        assert_eq!(
            read_key(&path).expect("still there").verifying_key(),
            public
        );
    }

    #[cfg(unix)]
    #[test]
    fn a_key_that_others_may_read_is_noticed() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().expect("a temporary directory");
        let path = directory.path().join("fleet.key");
        keygen(&path).expect("a new file");
        assert!(!is_open(&path));
        for mode in [0o644, 0o640] {
            let mode = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(&path, mode).expect("its owner");
            assert!(is_open(&path));
        }
        assert!(!is_open(Path::new("/dev/null")), "no file");
    }

    #[test]
    fn what_is_not_a_key_is_refused() {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let path = directory.path().join("fleet.key");
        let error = read_key(&path).expect_err("there is no file");
        assert!(
            error.to_string().contains("host-train keygen --out"),
            "{error}"
        );
        for text in ["", "abc", &"g".repeat(64), &"a".repeat(63), &"a".repeat(66)] {
            std::fs::write(&path, text).expect("a writable directory");
            assert!(
                matches!(read_key(&path), Err(KeyError::Format { .. })),
                "{text}"
            );
        }
    }
}
