//! A policy on a robot: from a signed manifest and fetched bytes to a policy that may run.

use crate::board::BoardError;
use crate::flash::{FILE, FlashError};
use crate::session::plain;
use ed25519_dalek::{Signature, VerifyingKey};
use reagent_core::kernels::Tile;
use reagent_core::net::Scratch;
use reagent_core::wire::keys::Hex;
use reagent_core::wire::{self, Manifest, Message, PolicyId, Release, SignedManifest, WhyNot};
use reagent_core::{Error, Policy, Registrar};
use reagent_slots::SlotError;
use sha2::{Digest, Sha256};
use thiserror::Error;

/// Largest policy file in bytes. A manifest that announces more is refused before anything is fetched.
pub const MAX_POLICY_BYTES: usize = 64 << 20;

/// Why a policy was not taken. The one in use stays in use.
#[derive(Debug, Error)]
pub enum UpdateError {
    /// The announcement is not a frame of this protocol.
    #[error("manifest: {0}")]
    Frame(Error),
    /// The announcement is a frame, but not a signed manifest.
    #[error("manifest: not a signed manifest")]
    NotAManifest,
    /// The signature does not match manifest and key.
    #[error("manifest: bad signature")]
    Signature,
    /// The signature is right, but its key is not among the trusted ones.
    #[error("manifest: signed by {key}, which is not a trusted key (--trust)")]
    Untrusted {
        /// The signer's public key, hexadecimal.
        key: String,
    },
    /// The policy is not newer than one that is or was in use.
    #[error("manifest: version {given} is not newer than {last}, which is or was in use")]
    NotNewer {
        /// As announced.
        given: Release,
        /// The latest that was in use.
        last: Release,
    },
    /// The policy goes to a part of the fleet first.
    #[error("manifest: version {0} goes to other robots first")]
    NotYet(Release),
    /// The version is so high that too few remain for later policies.
    #[error("manifest: version {given} is too far ahead of {last}, which is or was in use")]
    FarAhead {
        /// As announced.
        given: Release,
        /// The latest that was in use.
        last: Release,
    },
    /// The length of the file or of its chunks is not allowed.
    #[error("manifest: {length} bytes in chunks of {chunk_length} are not allowed")]
    Length {
        /// Bytes of the file.
        length: u32,
        /// Bytes of a chunk.
        chunk_length: u32,
    },
    /// The network failed.
    #[error("zenoh: {}", plain(.0))]
    Zenoh(zenoh::Error),
    /// A chunk did not come.
    #[error("chunk {index} of {chunks} at {key}: {reason}")]
    Chunk {
        /// Its number, from 0.
        index: u32,
        /// How many there are.
        chunks: u32,
        /// The key that was asked.
        key: String,
        /// What came instead of it.
        reason: String,
    },
    /// The bytes are not those of the manifest.
    #[error("policy file: SHA-256 {found} where the manifest says {expected}")]
    Sha256 {
        /// SHA-256 of the bytes.
        found: String,
        /// SHA-256 in the manifest.
        expected: String,
    },
    /// The bytes are those of the manifest, but not a policy that this robot can run.
    #[error("policy file: {0}")]
    Policy(Error),
    /// The node's board did not accept it.
    #[error("board: {0}")]
    Board(BoardError),
    /// This build cannot run such a file.
    #[error(
        "manifest: file version {file_version}, number format {number_format}, shape {shape:?}: this robot runs others"
    )]
    Incompatible {
        /// Version of the file format.
        file_version: u16,
        /// Number format.
        number_format: u16,
        /// Network shape.
        shape: [u16; 8],
    },
    /// The policy acts differently here from where it was made.
    #[error("policy file: the self-test failed, the policy acts otherwise here")]
    SelfTest,
    /// The slots in flash failed.
    #[error("policy slots: {}", of_slots(.0))]
    Slots(#[from] SlotError<FlashError>),
    /// The policy in the state directory cannot be used.
    #[error(
        "{path}: the policy kept there cannot be used: {reason}; the robot waits for one that is announced"
    )]
    Kept {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: Box<UpdateError>,
    },
    /// The state directory does not say which version was in use last.
    #[error(
        "{path}: {reason}; put a backup back, or delete the file to begin as a new robot, which takes every version \
         that a trusted key has signed"
    )]
    Lost {
        /// The file.
        path: String,
        /// What is wrong.
        reason: SlotError<FlashError>,
    },
    /// The state directory is not there any more.
    #[error(
        "{path} was deleted or replaced while the robot used it: nothing is kept any more; start the robot again"
    )]
    Gone {
        /// The file.
        path: String,
    },
    /// The state directory failed.
    #[error("--state {path}: {reason}")]
    Store {
        /// File or directory.
        path: String,
        /// What the system says.
        reason: std::io::Error,
    },
}

impl UpdateError {
    /// Whether the same policy may be taken later, though nothing else is announced: a disk has room again, or what serves the
    /// chunks is back.
    pub fn can_pass(&self) -> bool {
        matches!(self.why(), WhyNot::NotFetched | WhyNot::NotKept)
    }

    /// The reason as others are told it.
    pub fn why(&self) -> WhyNot {
        match self {
            UpdateError::Frame(_) | UpdateError::NotAManifest => WhyNot::Malformed,
            UpdateError::Signature => WhyNot::Signature,
            UpdateError::Untrusted { .. } => WhyNot::Untrusted,
            UpdateError::NotNewer { last, .. } => WhyNot::NotNewer(*last),
            UpdateError::FarAhead { last, .. } => WhyNot::FarAhead(*last),
            UpdateError::NotYet(_) => WhyNot::NotYet,
            UpdateError::Length { .. }
            | UpdateError::Incompatible { .. }
            | UpdateError::Slots(SlotError::TooLarge { .. }) => WhyNot::Incompatible,
            UpdateError::Zenoh(_) | UpdateError::Chunk { .. } => WhyNot::NotFetched,
            UpdateError::Sha256 { .. } | UpdateError::Policy(_) => WhyNot::Damaged,
            UpdateError::SelfTest => WhyNot::SelfTest,
            UpdateError::Board(_) => WhyNot::Board,
            UpdateError::Kept { reason, .. } => reason.why(),
            UpdateError::Slots(_)
            | UpdateError::Lost { .. }
            | UpdateError::Gone { .. }
            | UpdateError::Store { .. } => WhyNot::NotKept,
        }
    }
}

/// The error in words; for a failed file, what the system says.
fn of_slots(error: &SlotError<FlashError>) -> String {
    match error {
        SlotError::Flash(FlashError::File(reason)) => format!("{FILE}: {reason}"),
        other => other.to_string(),
    }
}

/// Whose policies a robot accepts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trust {
    /// Everybody's.
    AnyKey,
    /// Those signed with one of these keys.
    Keys(Vec<VerifyingKey>),
}

impl Trust {
    fn includes(&self, key: &VerifyingKey) -> bool {
        match self {
            Trust::AnyKey => true,
            Trust::Keys(keys) => keys.contains(key),
        }
    }
}

/// Which policy a frame claims to announce, unchecked. Zeros if it is no manifest.
pub(crate) fn claimed(frame: &[u8]) -> PolicyId {
    match wire::decode(frame) {
        Ok(Message::SignedManifest(signed)) => match wire::decode(signed.manifest) {
            Ok(Message::Manifest(manifest)) => manifest.id(),
            _ => PolicyId::default(),
        },
        _ => PolicyId::default(),
    }
}

/// Checks a frame from `…/policy/manifest`: its signature, and that its key is trusted.
///
/// # Errors
/// `Frame`, `NotAManifest`, `Signature`, `Untrusted`, `Length`, `Incompatible`.
pub fn verified_manifest(frame: &[u8], trust: &Trust) -> Result<Manifest, UpdateError> {
    let Message::SignedManifest(signed) = wire::decode(frame).map_err(UpdateError::Frame)? else {
        return Err(UpdateError::NotAManifest);
    };
    let SignedManifest {
        manifest: signed_bytes,
        public_key,
        signature: [r, s],
    } = signed;
    let key = VerifyingKey::from_bytes(&public_key).map_err(|_| UpdateError::Signature)?;
    key.verify_strict(signed_bytes, &Signature::from_components(r, s))
        .map_err(|_| UpdateError::Signature)?;
    if !trust.includes(&key) {
        let key = Hex(&public_key).to_string();
        return Err(UpdateError::Untrusted { key });
    }
    let Message::Manifest(manifest) = wire::decode(signed_bytes).map_err(UpdateError::Frame)?
    else {
        return Err(UpdateError::NotAManifest);
    };
    if manifest.length as usize > MAX_POLICY_BYTES || manifest.chunks().is_none() {
        return Err(UpdateError::Length {
            length: manifest.length,
            chunk_length: manifest.chunk_length,
        });
    }
    if !manifest.runs_here() {
        return Err(UpdateError::Incompatible {
            file_version: manifest.file_version,
            number_format: manifest.number_format,
            shape: manifest.shape,
        });
    }
    Ok(manifest)
}

/// A policy file whose bytes are those of its manifest and which parses.
#[derive(Debug)]
pub struct LoadedPolicy {
    manifest: Manifest,
    /// The file, padded with zeros, on the 4-byte boundary that a policy needs.
    words: Vec<u32>,
    /// Bytes of the file.
    length: usize,
    /// See [`Policy::with_packed`].
    packed: Vec<Tile>,
}

impl LoadedPolicy {
    /// Checks `bytes` against the manifest, and that they are a policy.
    ///
    /// # Errors
    /// `Sha256`, `Policy`.
    pub fn new(manifest: Manifest, bytes: &[u8]) -> Result<Self, UpdateError> {
        let found: [u8; 32] = Sha256::digest(bytes).into();
        if found != manifest.sha256 {
            return Err(UpdateError::Sha256 {
                found: Hex(&found).to_string(),
                expected: Hex(&manifest.sha256).to_string(),
            });
        }
        let mut words = vec![0u32; bytes.len().div_ceil(4)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        let mut loaded = LoadedPolicy {
            manifest,
            words,
            length: bytes.len(),
            packed: Vec::new(),
        };
        let policy = Policy::parse(loaded.bytes()).map_err(UpdateError::Policy)?;
        let mut packed = vec![Tile::ZERO; policy.packed_tiles().unwrap_or(0)];
        policy.pack(&mut packed);
        loaded.packed = packed;
        Ok(loaded)
    }

    /// The policy in the file.
    ///
    /// # Errors
    /// `Policy`, only if memory is damaged.
    pub fn policy(&self) -> Result<Policy<'_>, UpdateError> {
        let policy = Policy::parse(self.bytes()).map_err(UpdateError::Policy)?;
        Ok(policy.with_packed(&self.packed))
    }

    /// Tests that the policy does what its manifest says.
    ///
    /// # Errors
    /// `Policy`, `SelfTest`.
    pub fn test(&self) -> Result<(), UpdateError> {
        let policy = self.policy()?;
        let mut scratch = Box::new(Scratch::new());
        let passed = Registrar::new(policy, &mut scratch).passes(&self.manifest.golden);
        match passed.map_err(UpdateError::Policy)? {
            true => Ok(()),
            false => Err(UpdateError::SelfTest),
        }
    }

    /// What the file is.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The file.
    pub fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.length]
    }
}

#[cfg(test)]
impl LoadedPolicy {
    /// Flips a bit in memory.
    pub(crate) fn flip_a_bit(&mut self) {
        self.words[self.length / 8] ^= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Error, ErrorKind};

    #[test]
    fn a_full_disk_is_told_in_the_words_of_the_system() {
        let full = FlashError::File(Error::from(ErrorKind::StorageFull));
        let said = UpdateError::Slots(SlotError::Flash(full)).to_string();
        assert_eq!(said, "policy slots: flash.bin: no storage space");
    }
}
