//! `host-train publish`

use crate::publish;
use anyhow::Context;
use clap::Args;
use std::path::PathBuf;

/// Announce a signed policy to a fleet and serve it until Ctrl-C
#[derive(Debug, Args)]
pub(super) struct PublishArgs {
    /// Policy to ship
    #[arg(long, value_name = "FILE.rgw")]
    weights: PathBuf,
    /// Ed25519 signing key
    #[arg(long, value_name = "SIGNING_KEY")]
    key: PathBuf,
    /// Fleet: 1 to 32 characters of a-z A-Z 0-9 _ -
    #[arg(long, value_name = "NAME")]
    fleet: String,
    /// Zenoh configuration with explicit endpoints
    #[arg(long, value_name = "CONFIG.json5")]
    zenoh: Option<PathBuf>,
}

impl PublishArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Runtime::new().context("cannot start the network threads")?;
        runtime.block_on(publish::publish(
            &self.weights,
            &self.key,
            &self.fleet,
            self.zenoh.as_deref(),
        ))?;
        Ok(())
    }
}
