//! Files that commands write; `-` is standard output.

use crate::files;
use anyhow::{Context, ensure};
use serde::Serialize;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Refuses, before the work begins, files that could not be written and two outputs in one file.
///
/// # Errors
/// The system's, or two outputs in one file; both name the file.
pub fn check_outputs<'a>(
    paths: impl IntoIterator<Item = &'a Option<PathBuf>>,
) -> anyhow::Result<()> {
    check_files([], paths)
}

/// As [`check_outputs`], and refuses outputs that would replace an input, by any path or link.
pub(super) fn check_files<'a>(
    inputs: impl IntoIterator<Item = &'a PathBuf>,
    paths: impl IntoIterator<Item = &'a Option<PathBuf>>,
) -> anyhow::Result<()> {
    let mut places = HashSet::new();
    for path in paths.into_iter().flatten() {
        let place = files::place(path).with_context(|| cannot_write(path))?;
        let is_free = place.is_none_or(|place| places.insert(place));
        ensure!(
            is_free,
            "{}: two outputs cannot be one file",
            path.display()
        );
    }
    for input in inputs {
        let place = input.canonicalize().ok();
        let is_kept = place.is_none_or(|place| !places.contains(&place));
        let named = input.display();
        ensure!(
            is_kept,
            "{named}: an output would replace this input; write it elsewhere"
        );
    }
    Ok(())
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
