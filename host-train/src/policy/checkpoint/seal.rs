//! A checksum and a fixed order for the header of a safetensors file, so that equal contents make equal files.

use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

const METADATA: &str = "__metadata__";
const CHECKSUM: &str = "checksum";
/// Header fields of checkpoints of version 0.1, which have no checksum.
const UNSEALED: [&str; 3] = ["accumulation", "progress", "shape"];

/// A safetensors file, split into its parts.
struct File<'a> {
    /// The header's entry for each tensor.
    tensors: BTreeMap<String, Value>,
    /// Texts in the header.
    metadata: BTreeMap<String, String>,
    data: &'a [u8],
}

/// The file with its header sorted, and the SHA-256 of everything else added to it.
pub(super) fn seal(bytes: &[u8]) -> Result<Vec<u8>, String> {
    File::parse(bytes)?.sealed()
}

/// Refuses a file that is not, bit for bit, what [`seal`] made. A file without a checksum is accepted if its header
/// has only the fields that version 0.1 wrote.
pub(super) fn check(bytes: &[u8]) -> Result<(), String> {
    let mut file = File::parse(bytes)?;
    if file.metadata.remove(CHECKSUM).is_none() {
        let mut names = file.metadata.keys();
        return match names.all(|name| UNSEALED.contains(&&**name)) {
            true => Ok(()),
            false => Err("it has no checksum".into()),
        };
    }
    match file.sealed()? == bytes {
        true => Ok(()),
        false => Err("its checksum is not that of its contents".into()),
    }
}

impl File<'_> {
    fn parse(bytes: &[u8]) -> Result<File<'_>, String> {
        let cut = "it ends inside its header";
        let (length, rest) = bytes.split_first_chunk().ok_or(cut)?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| cut)?;
        let (header, data) = rest.split_at_checked(length).ok_or(cut)?;
        let bad = |e: serde_json::Error| format!("its header: {e}");
        let mut tensors: BTreeMap<String, Value> = serde_json::from_slice(header).map_err(bad)?;
        let metadata = tensors.remove(METADATA).unwrap_or_default();
        Ok(File {
            metadata: serde_json::from_value(metadata).map_err(bad)?,
            tensors,
            data,
        })
    }

    fn sealed(mut self) -> Result<Vec<u8>, String> {
        let plain = self.header()?;
        let digest = Sha256::new()
            .chain_update(&plain)
            .chain_update(self.data)
            .finalize();
        let digits = const_hex::encode(digest);
        self.metadata.insert(CHECKSUM.into(), digits);
        let mut header = self.header()?;
        // Data begin at a multiple of eight.
        header += &" ".repeat(header.len().next_multiple_of(8) - header.len());
        Ok([
            &(header.len() as u64).to_le_bytes(),
            header.as_bytes(),
            self.data,
        ]
        .concat())
    }

    fn header(&self) -> Result<String, String> {
        let mut all = self.tensors.clone();
        let metadata = serde_json::to_value(&self.metadata).map_err(|e| e.to_string())?;
        all.insert(METADATA.into(), metadata);
        serde_json::to_string(&all).map_err(|e| e.to_string())
    }
}
