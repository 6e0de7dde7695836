//! `host-train import`

use crate::policy::WeightFile;
use crate::policy::import;
use clap::Args;
use std::path::PathBuf;

/// Convert a checkpoint of the authors' PyTorch code to a weight file
#[derive(Debug, Args)]
pub(super) struct ImportArgs {
    /// Checkpoint: a PyTorch archive with a model_state_dict
    #[arg(long, value_name = "CHECKPOINT.zip|.pt")]
    pytorch: PathBuf,
    /// File to write
    #[arg(long, value_name = "FILE.rgw")]
    out: PathBuf,
}

impl ImportArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let parameters = import::pytorch(&self.pytorch)?;
        WeightFile::from_parameters(&parameters)?.save(&self.out)?;
        println!("{}", self.out.display());
        Ok(())
    }
}
