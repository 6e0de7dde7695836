//! The command line of the trainer; see `host-train --help`.

use clap::Parser;
use host_train::cli::{Cli, status};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let log = cli.log;
    log.start("warn");
    match cli.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            log.failed(error.as_ref());
            ExitCode::from(status(&error))
        }
    }
}
