//! What programs log, on standard error.

use crate::print;
use clap::ValueEnum;
use std::io::{IsTerminal, stderr};
use tracing_subscriber::EnvFilter;

/// How a program logs.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct LogArgs {
    /// How the log is written to standard error; RUST_LOG says what is in it
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = Format::Text, global = true)]
    log: Format,
}

/// How a line of the log looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Lines to read
    Text,
    /// A JSON document a line, errors included
    Json,
}

impl LogArgs {
    /// Logs from here on what RUST_LOG says, or else `level`.
    pub fn start(self, level: &str) {
        let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
        let log = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(stderr)
            .with_ansi(stderr().is_terminal())
            .log_internal_errors(false);
        match self.log {
            Format::Text => log.init(),
            Format::Json => log.json().init(),
        }
    }

    /// The one line of error that a program ends with.
    pub fn failed(self, error: &str) {
        match self.log {
            Format::Text => print::stderr(format_args!("error: {error}\n")),
            Format::Json => tracing::error!("{error}"),
        }
    }
}
