//! `host-train export`

use crate::export::export_f32;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Write the policy of a run as a weight file for robots
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// Run directory (its best model) or checkpoint
    #[arg(long, value_name = "RUN_DIR|CHECKPOINT")]
    run: PathBuf,
    /// Number format
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = Format::F32)]
    format: Format,
    /// File to write
    #[arg(long, value_name = "FILE.rgw")]
    out: PathBuf,
}

/// Number formats of weight files.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// 32-bit floating point, exactly as trained
    F32,
}

impl ExportArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        match self.format {
            Format::F32 => export_f32(&self.run, &self.out)?,
        }
        println!("{}", self.out.display());
        Ok(())
    }
}
