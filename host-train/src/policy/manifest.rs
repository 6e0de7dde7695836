//! The announcement of a policy file: its hashes, its shape and the actions of its self-test.

use crate::policy::WeightFile;
use reagent_core::net::Scratch;
use reagent_core::wire::{self, Manifest, PolicyName};
use reagent_core::{Error, Registrar, weights};
use sha2::{Digest, Sha256};

/// SHA-256 of each chunk of a policy file.
pub fn chunk_table(file: &[u8]) -> Vec<[u8; 32]> {
    let chunks = file.chunks(wire::CHUNK_BYTES);
    chunks.map(|chunk| Sha256::digest(chunk).into()).collect()
}

/// The manifest of a policy file of unknown provenance.
///
/// # Errors
/// `Name` for a name longer than 32 bytes.
pub fn manifest(version: u64, name: &str, file: &WeightFile) -> Result<Manifest, Error> {
    let bytes = file.bytes();
    let mut scratch = Box::new(Scratch::new());
    let golden = Registrar::new(file.policy(), &mut scratch).golden_actions();
    Ok(Manifest {
        sha256: file.sha256(),
        length: u32::try_from(bytes.len()).expect("a policy is a few MiB"),
        chunk_length: wire::CHUNK_BYTES as u32,
        table_sha256: Sha256::digest(chunk_table(bytes).concat()).into(),
        epoch: 0,
        version,
        reach: u32::MAX,
        file_version: weights::VERSION,
        number_format: u16::from_le_bytes([bytes[6], bytes[7]]),
        shape: file.policy().shape.header(),
        name: PolicyName::try_from(name).map_err(|_| Error::Name)?,
        training_sha256: [0; 32],
        evaluation_sha256: [0; 32],
        golden: golden.expect("the clouds of the self-test are good"),
    })
}
