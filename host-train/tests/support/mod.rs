//! Runs the trainer's program as a user does.
#![allow(dead_code, reason = "each test program uses a part")]

pub(crate) mod browser;

use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

/// Runs the program in a folder.
pub(crate) fn run(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-train"))
        .current_dir(folder)
        .args(arguments.split_whitespace())
        .output()
        .expect("host-train runs")
}

pub(crate) fn succeed(folder: &Path, arguments: &str) -> String {
    let output = run(folder, arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments}: {stderr}");
    String::from_utf8(output.stdout).expect("text")
}

/// Expects status 1, and a single line on stderr with every one of `words`.
pub(crate) fn fail(folder: &Path, arguments: &str, words: &[&str]) {
    let output = run(folder, arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "{arguments}: {stderr}");
    assert!(stderr.starts_with("error: "), "{arguments}: {stderr}");
    for word in words {
        assert!(
            stderr.contains(word),
            "{arguments}: no \"{word}\" in: {stderr}"
        );
    }
}

pub(crate) fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Writes an untrained policy, and returns its bytes.
pub(crate) fn write_weights(path: &Path) -> Vec<u8> {
    let file =
        WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 5)).expect("deployable");
    file.save(path).expect("written");
    file.bytes().to_vec()
}

pub(crate) fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("written")).expect("JSON")
}

/// Errors without the times, which differ from run to run.
pub(crate) fn without_times(mut row: Value) -> Value {
    if let Some(fields) = row.as_object_mut() {
        fields.retain(|name, _| !name.starts_with("ms"));
    }
    row
}
