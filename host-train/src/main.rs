//! The command line of the trainer; see `host-train --help`.

use clap::Parser;
use host_train::cli::{Cli, one_line, status};
use std::io::Write;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .log_internal_errors(false)
        .init();
    match cli.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Whoever closed the other end of stderr does not want to know.
            let _ = writeln!(std::io::stderr(), "error: {}", one_line(&error));
            ExitCode::from(status(&error))
        }
    }
}
