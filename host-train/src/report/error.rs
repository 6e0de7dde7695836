//! Why a report could not be made: what, where, and what to do.

use crate::register::trace::TraceError;
use std::path::PathBuf;

/// Why a report was refused.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The operating system refused to read.
    #[error("cannot read {}", path.display())]
    Read {
        /// File concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The operating system refused to write.
    #[error("cannot write {}", path.display())]
    Write {
        /// File or folder concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is longer than anything that belongs in a report.
    #[error("{}: longer than {limit} bytes; a report takes no such file", path.display())]
    TooLong {
        /// File concerned.
        path: PathBuf,
        /// Bytes that are read at most.
        limit: u64,
    },
    /// The folder is not a run.
    #[error("{}: no {file} in the folder, so it is no run of `train`; give a RUN_DIR", path.display())]
    NoRun {
        /// Folder concerned.
        path: PathBuf,
        /// File that a run has.
        file: &'static str,
    },
    /// The file holds nothing.
    #[error("{}: empty; {todo}", path.display())]
    Empty {
        /// File concerned.
        path: PathBuf,
        /// What to do.
        todo: &'static str,
    },
    /// The file, or a line of it, is not JSON.
    #[error("{}, line {line}: not JSON ({reason}); the file is damaged or cut short, write it again", path.display())]
    NotJson {
        /// File concerned.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What the parser said.
        reason: String,
    },
    /// No report can be made from this file.
    #[error(
        "{}: neither a RUN_DIR, nor written by `eval --json`, `sweep --json`, `calibrate --json`, `eval --trace` or `register --trace`",
        path.display()
    )]
    UnknownKind {
        /// File concerned.
        path: PathBuf,
    },
    /// A part of a known file is not what it should be.
    #[error("{}: \"{key}\" is not {expected}; write the file again with this version", path.display())]
    Malformed {
        /// File concerned.
        path: PathBuf,
        /// Key concerned, with those above it.
        key: String,
        /// What it should be.
        expected: &'static str,
    },
    /// A trace was refused.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// A chart could not be drawn.
    #[error("cannot draw chart {chart}: {reason}")]
    Draw {
        /// Its name.
        chart: String,
        /// What the drawing library said.
        reason: String,
    },
}
