//! Files that commands write; `-` is standard output.

use crate::files;
use anyhow::Context;
use serde::Serialize;
use std::path::Path;

/// Writes text, naming the file if that fails.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    files::write(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes an indented JSON document.
pub(super) fn write_json(path: &Path, document: &impl Serialize) -> anyhow::Result<()> {
    let text =
        serde_json::to_string_pretty(document).context("cannot encode the result as JSON")?;
    write_text(path, &(text + "\n"))
}
