//! `host-train keygen`

use crate::publish::keygen;
use clap::Args;
use std::path::PathBuf;

/// Make a signing key for publish, from the system's random source
///
/// The file is readable only by its owner and never overwritten. The public half, which robots are given to trust, is
/// printed.
#[derive(Debug, Args)]
pub(super) struct KeygenArgs {
    /// File to write
    #[arg(long, value_name = "SIGNING_KEY")]
    out: PathBuf,
}

impl KeygenArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let public = keygen(&self.out)?;
        println!("{}", const_hex::encode(public.as_bytes()));
        Ok(())
    }
}
