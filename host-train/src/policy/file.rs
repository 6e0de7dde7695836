//! A policy file in memory: read, checked, run and written.

use super::checkpoint::{Checkpoint, is_checkpoint};
use super::{BUNDLED, ExportError};
use crate::files;
use reagent_core::kernels::Tile;
use reagent_core::sight::Sight;
use reagent_core::weights::{
    CUT_AT, DECISION_AT, FOCUS_SHIFT, FORMAT_F32, RESCAN_AT, checksum, file_len,
};
use reagent_core::{Decision, Error, Policy};
use sha2::{Digest, Sha256};
use std::io::{ErrorKind, Read};
use std::path::Path;

/// The bytes of a policy file, aligned as the core needs them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WeightFile {
    words: Vec<u32>,
    len: usize,
    /// See [`Policy::with_packed`].
    packed: Vec<Tile>,
}

/// The header's byte for the decision rule and for how often the target's points are chosen.
fn how(decision: Decision, sight: Sight) -> u8 {
    decision.header() as u8 | sight.focus << FOCUS_SHIFT
}

impl WeightFile {
    /// Copies bytes to aligned memory and checks that they are a policy.
    ///
    /// # Errors
    /// The `Weights…` variants of [`Error`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let mut words = vec![0u32; bytes.len().div_ceil(4)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        let mut file = WeightFile {
            words,
            len: bytes.len(),
            packed: Vec::new(),
        };
        let policy = Policy::parse(file.bytes())?;
        let mut packed = vec![Tile::ZERO; policy.packed_tiles().unwrap_or(0)];
        policy.pack(&mut packed);
        file.packed = packed;
        Ok(file)
    }

    /// The same policy with another decision rule.
    pub fn deciding(self, decision: Decision) -> Self {
        let sight = self.policy().sight;
        self.with_header(DECISION_AT, &[how(decision, sight)])
    }

    /// The same policy, looking at all points of the source every `steps` steps ([`Policy::rescan`]).
    pub fn rescanning(self, steps: u16) -> Self {
        self.with_header(RESCAN_AT, &steps.to_le_bytes())
    }

    /// The same policy, looking at `sight` of both clouds.
    pub fn seeing(self, sight: Sight) -> Self {
        let decision = self.policy().decision;
        self.with_header(CUT_AT, &[sight.cut.header()])
            .with_header(DECISION_AT, &[how(decision, sight)])
    }

    /// The same network, deciding and looking as `policy` does.
    pub fn run_like(self, policy: &Policy<'_>) -> Self {
        self.deciding(policy.decision)
            .rescanning(policy.rescan)
            .seeing(policy.sight)
    }

    fn with_header(mut self, at: usize, field: &[u8]) -> Self {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut self.words);
        bytes[at..][..field.len()].copy_from_slice(field);
        seal(&mut bytes[..self.len]);
        self
    }

    /// The bundled policy with that name ([`BUNDLED`]).
    pub fn bundled(name: &Path) -> Option<Self> {
        let (_, bytes) = BUNDLED
            .iter()
            .find(|(known, _)| name.as_os_str() == *known)?;
        Some(Self::from_bytes(bytes).expect("a test checks the linked policies"))
    }

    /// Reads and checks a policy file. The name of a bundled policy stands for that policy, a run directory or a
    /// checkpoint for what [`Self::from_checkpoint`] makes of its best one.
    pub fn load(path: &Path) -> Result<Self, ExportError> {
        if let Some(bundled) = Self::bundled(path) {
            return Ok(bundled);
        }
        if is_checkpoint(path) {
            return Self::from_checkpoint(Checkpoint::load(&Checkpoint::find(path)?)?);
        }
        let mut bytes = Vec::new();
        // One byte more than any policy has: enough to see that a file is too long.
        let most = file_len(&reagent_core::Shape::FULL, FORMAT_F32) as u64 + 1;
        std::fs::File::open(path)
            .and_then(|file| file.take(most).read_to_end(&mut bytes))
            .map_err(|source| match source.kind() {
                ErrorKind::NotFound => ExportError::Missing { path: path.into() },
                _ => ExportError::Read {
                    path: path.into(),
                    source,
                },
            })?;
        Self::from_bytes(&bytes).map_err(|source| ExportError::Policy {
            path: path.into(),
            source,
        })
    }

    /// The policy that ships with the core.
    pub fn pretrained() -> Self {
        Self::from_bytes(Policy::pretrained_bytes()).expect("a test checks the linked policy")
    }

    /// Reads a policy file, or takes the bundled policy if `path` is `None`.
    pub fn load_or_pretrained(path: Option<&Path>) -> Result<Self, ExportError> {
        path.map_or_else(|| Ok(Self::pretrained()), Self::load)
    }

    /// Writes the file, whole or not at all.
    pub fn save(&self, path: &Path) -> Result<(), ExportError> {
        files::write(path, self.bytes()).map_err(|source| ExportError::Write {
            path: path.into(),
            source,
        })
    }

    /// The file's bytes, 4-byte aligned.
    pub fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }

    /// The policy that the bytes hold.
    pub fn policy(&self) -> Policy<'_> {
        let policy = Policy::parse_again(self.bytes()).expect("checked when the file was made");
        policy.with_packed(&self.packed)
    }

    /// SHA-256 of the file: the policy's identity in the fleet.
    pub fn sha256(&self) -> [u8; 32] {
        Sha256::digest(self.bytes()).into()
    }

    /// Adds the checksum and reads everything back.
    pub(super) fn finished(mut bytes: Vec<u8>) -> Result<Self, ExportError> {
        seal(&mut bytes);
        Self::from_bytes(&bytes).map_err(|source| ExportError::Policy {
            path: "the exported policy".into(),
            source,
        })
    }
}

/// Writes a file's checksum.
pub(super) fn seal(file: &mut [u8]) {
    let (body, sum) = file.split_at_mut(file.len() - 4);
    sum.copy_from_slice(&checksum(body).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::VIEWS;

    #[test]
    fn bundled_policies_go_by_their_names() {
        for (name, bytes) in BUNDLED {
            let file = WeightFile::load(Path::new(name)).expect("linked in");
            assert_eq!(file.bytes(), bytes, "{name}");
            let policy = file.policy();
            assert_eq!(policy.sight.focus > 0, name.starts_with(VIEWS), "{name}");
        }
        assert!(WeightFile::bundled(Path::new("views.rgw")).is_none());
    }
}
