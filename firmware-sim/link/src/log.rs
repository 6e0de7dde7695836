//! The log of the programs, on standard error.

use crate::print;
use clap::{Parser, ValueEnum};
use std::error::Error;
use std::ffi::OsString;
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

/// Reads the command line. On bad usage, the program ends as [`bad_usage`] says.
pub fn parse<P: Parser>() -> P {
    P::try_parse().unwrap_or_else(|error| bad_usage(&error))
}

/// Ends the program as clap does on bad usage, with status 2; as a document of the log if the command line asks for these.
pub fn bad_usage(error: &clap::Error) -> ! {
    if !error.use_stderr() || !asks_for_json(std::env::args_os()) {
        error.exit();
    }
    // It may run already.
    LogArgs { log: Format::Json }.try_start("warn").ok();
    tracing::error!("{}", usage_line(&error.to_string()));
    std::process::exit(error.exit_code());
}

/// Whether a command line asks for JSON, which clap does not tell of one that it refuses.
fn asks_for_json(arguments: impl Iterator<Item = OsString>) -> bool {
    let mut follows = false;
    for argument in arguments {
        if argument == "--log=json" || follows && argument == "json" {
            return true;
        }
        follows = argument == "--log";
    }
    false
}

/// What clap says of bad usage, on one line, without the usage.
fn usage_line(text: &str) -> String {
    let said = text.strip_prefix("error: ").unwrap_or(text);
    let ends = ["\n\nUsage:", "\n\nFor more information"];
    let end = ends.iter().filter_map(|end| said.find(end)).min();
    let words = said[..end.unwrap_or(said.len())].split_whitespace();
    words.collect::<Vec<_>>().join(" ")
}

impl LogArgs {
    /// Starts the log with the filter in RUST_LOG, or else with `level`.
    pub fn start(self, level: &str) {
        self.try_start(level).expect("it is started once");
    }

    fn try_start(self, level: &str) -> Result<(), Box<dyn Error + Send + Sync>> {
        let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
        let log = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(stderr)
            .with_ansi(stderr().is_terminal())
            .log_internal_errors(false);
        match self.log {
            Format::Text => log.try_init(),
            Format::Json => log.json().try_init(),
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

    #[test]
    fn bad_usage_fits_on_a_line_of_the_log() {
        let asks = |line: &str| asks_for_json(line.split(' ').map(OsString::from));
        assert!(asks("p node --log json --fleet") && asks("p --log=json"));
        assert!(!asks("p json --log text") && !asks("p --log text json") && !asks("p"));
        let text = "error: the following required arguments were not provided:\n  --fleet <NAME>\n\nUsage: p node\n\n\
                    For more information, try '--help'.\n";
        let line = "the following required arguments were not provided: --fleet <NAME>";
        assert_eq!(usage_line(text), line);
        let tipped = "error: unexpected argument '--flet' found\n\n  tip: a similar argument exists: '--fleet'\n\nUsage: p";
        let line = "unexpected argument '--flet' found tip: a similar argument exists: '--fleet'";
        assert_eq!(usage_line(tipped), line);
    }

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
