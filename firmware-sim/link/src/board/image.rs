//! The image of `firmware-sim/cortex-m`, and the content of a board's flash beside it.

use super::{BoardError, Kind};
use reagent_core::wire::{self, FLASH_HEADER_BYTES, Manifest, Message};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Format of the clouds of 1024 points each that the image has memory for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Clouds {
    /// As floats, or on a grid
    #[default]
    Floats,
    /// On a grid of 16-bit codes, in half the memory; half as many points as floats
    Grid,
}

/// Builds the image with cargo and returns its path. This takes only a moment if nothing has changed.
///
/// # Errors
/// `NoTarget`, `Build`.
pub fn build_image(kind: Kind, clouds: Clouds) -> Result<PathBuf, BoardError> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cortex-m");
    let target = kind.target();
    let failed = |reason: String| BoardError::Build {
        target,
        directory: directory.display().to_string(),
        reason,
    };
    // Each kind has a folder of its own, so that no image is replaced while it runs.
    let (folder, features) = match clouds {
        Clouds::Floats => ("../../target/cortex-m", ""),
        Clouds::Grid => ("../../target/cortex-m-grid", "grid"),
    };
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut build = Command::new(cargo);
    build
        .args(["build", "--release", "--locked", "--target", target])
        .args(["--target-dir", folder, "--features", features])
        .current_dir(&directory);
    // The image has flags of its own.
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS"] {
        build.env_remove(variable);
    }
    let output = build.output().map_err(|error| failed(error.to_string()))?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        if text.contains("can't find crate for `core`") {
            return Err(BoardError::NoTarget { target });
        }
        let error = text.lines().find(|line| line.starts_with("error"));
        return Err(failed(error.unwrap_or("no reason given").to_owned()));
    }
    Ok(directory
        .join(folder)
        .join(target)
        .join("release/reagent-cortex-m"))
}

/// The content of a board's flash for a policy: the manifest and the file.
pub fn flash_content(manifest: &Manifest, file: &[u8]) -> Vec<u8> {
    let mut content = vec![0; FLASH_HEADER_BYTES];
    let (length, frame) = content.split_at_mut(4);
    let used = wire::encode(&Message::Manifest(manifest.clone()), frame)
        .expect("every manifest fits")
        .len();
    length.copy_from_slice(&(used as u32).to_le_bytes());
    content.extend_from_slice(file);
    content
}
