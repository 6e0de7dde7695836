//! Files that commands write; `-` is standard output.

use crate::files;
use anyhow::Context;
use serde::Serialize;
use std::path::Path;

/// Refuses a file that could not be written, naming it, before the work that it is to hold.
///
/// # Errors
/// The system's.
pub fn check_writable(path: &Path) -> anyhow::Result<()> {
    files::check(path).with_context(|| cannot_write(path))
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

/// Writes text, naming the file if that fails.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    files::write(path, text.as_bytes()).with_context(|| cannot_write(path))
}

/// Writes an indented JSON document.
///
/// # Errors
/// The system's, with the name of the file.
pub fn write_json(path: &Path, document: &impl Serialize) -> anyhow::Result<()> {
    let text =
        serde_json::to_string_pretty(document).context("cannot encode the result as JSON")?;
    write_text(path, &(text + "\n"))
}
