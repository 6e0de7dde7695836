//! The log of the programs, on standard error.

use crate::print;
use clap::ValueEnum;
use std::error::Error;
use std::io::{IsTerminal, stderr};
use tracing_subscriber::EnvFilter;

/// How a program logs.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct LogArgs {
    /// How the log is written to standard error; RUST_LOG selects what is in it
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = Format::Text, global = true)]
    log: Format,
}

/// Format of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Lines to read
    Text,
    /// A JSON document a line, errors included
    Json,
}

impl LogArgs {
    /// Starts the log with the filter in RUST_LOG, or else with `level`.
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

    /// Prints the one line of error that a program ends with.
    pub fn failed(self, error: &(dyn Error + 'static)) {
        let error = one_line(error);
        match self.log {
            Format::Text => print::stderr(format_args!("error: {error}\n")),
            Format::Json => tracing::error!("{error}"),
        }
    }
}

/// An error and its causes on one line.
pub fn one_line(error: &(dyn Error + 'static)) -> String {
    let mut parts: Vec<String> = Vec::new();
    for cause in std::iter::successors(Some(error), |&error| error.source()) {
        let text = cause.to_string();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        // Some errors repeat their cause in their own text.
        if !parts.last().is_some_and(|last| last.ends_with(&text)) {
            parts.push(text);
        }
    }
    parts.join(": ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("{text}")]
    struct Said {
        text: &'static str,
        source: Option<Box<Said>>,
    }

    #[test]
    fn errors_become_one_line_without_repetition() {
        let texts = ["register", "read a.ply: no such file", "no such\n  file"];
        let chain = texts
            .into_iter()
            .rev()
            .fold(None, |source, text| Some(Box::new(Said { text, source })));
        let error = chain.expect("three of them");
        assert_eq!(one_line(&*error), "register: read a.ply: no such file");
    }
}
