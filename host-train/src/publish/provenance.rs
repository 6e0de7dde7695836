//! The origin of a policy.

use super::PublishError;
use crate::train::record::RunRecord;
use sha2::{Digest, Sha256};
use std::path::Path;

/// What a policy was made from, as SHA-256; zeros if unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Provenance {
    /// Hash of the training data, from the run's record.
    pub training: [u8; 32],
    /// Hash of the file that records the policy's evaluation.
    pub evaluation: [u8; 32],
}

impl Provenance {
    /// Provenance of a policy from this run, with its evaluation recorded in this file.
    ///
    /// # Errors
    /// `Run`, `Record`.
    pub fn read(run: Option<&Path>, evaluation: Option<&Path>) -> Result<Self, PublishError> {
        let mut provenance = Provenance::default();
        if let Some(run) = run {
            let hash = RunRecord::load(run)?.data_sha256;
            let decoded = const_hex::decode_to_array(&hash);
            provenance.training = decoded.map_err(|_| PublishError::Record {
                path: run.to_owned(),
                reason: "its record holds no SHA-256 of the training data".into(),
            })?;
        }
        if let Some(path) = evaluation {
            let bytes = std::fs::read(path).map_err(|error| PublishError::Record {
                path: path.to_owned(),
                reason: error.to_string(),
            })?;
            provenance.evaluation = Sha256::digest(bytes).into();
        }
        Ok(provenance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn provenance_is_read_from_runs_and_records() {
        assert_eq!(
            Provenance::read(None, None).expect("nothing"),
            Provenance::default()
        );
        let folder = tempfile::tempdir().expect("a temporary directory");
        let record = folder.path().join("eval.json");
        std::fs::write(&record, "{}").expect("writable");
        let read = Provenance::read(None, Some(&record)).expect("readable");
        let expected: [u8; 32] = Sha256::digest("{}").into();
        assert_eq!((read.evaluation, read.training), (expected, [0; 32]));
        let missing = folder.path().join("missing");
        let error = Provenance::read(None, Some(&missing));
        assert!(
            matches!(error, Err(PublishError::Record { .. })),
            "{error:?}"
        );
        let error = Provenance::read(Some(&missing), None);
        assert!(matches!(error, Err(PublishError::Run(_))), "{error:?}");
    }
}
