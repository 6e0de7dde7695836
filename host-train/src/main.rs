//! The command line of the trainer; see `host-train --help`.

use host_train::cli::{Cli, status};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli: Cli = reagent_link::log::parse();
    let log = cli.log;
    // What Zenoh logs does not matter: commands say all they have to say themselves.
    log.start("warn,zenoh=off");
    match cli.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            log.failed(error.as_ref());
            ExitCode::from(status(&error))
        }
    }
}
