//! `host-train import`

use super::methods::Decide;
use super::train::{cut, focus};
use crate::policy::WeightFile;
use crate::policy::import;
use clap::Args;
use reagent_core::cut::Cut;
use reagent_core::sight::Sight;
use std::path::PathBuf;

/// Convert a PyTorch checkpoint to a weight file: the authors', or one of gpu/train.py
#[derive(Debug, Args)]
pub(super) struct ImportArgs {
    /// Checkpoint: a PyTorch archive with a model_state_dict
    #[arg(long, value_name = "CHECKPOINT.zip|.pt")]
    pytorch: PathBuf,
    /// File to write
    #[arg(long, value_name = "FILE.rgw")]
    out: PathBuf,
    /// How a step follows from its probabilities
    #[arg(long, value_enum, value_name = "HOW", default_value = "most-likely")]
    decide: Decide,
    /// Look only at points of the source within so many radii of the target's centre, as the policy was trained;
    /// rounded to sixteenths, 0 for no limit
    #[arg(long, value_name = "RADII", value_parser = cut, default_value = "0")]
    cut: Cut,
    /// Look only at points of the target that have some of the source near them, chosen anew every so many steps, as
    /// the policy was trained; 0 for all points, always
    #[arg(long, value_name = "STEPS", value_parser = focus(), default_value_t = 0)]
    focus: u8,
}

impl ImportArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let parameters = import::pytorch(&self.pytorch)?;
        let sight = Sight {
            cut: self.cut,
            focus: self.focus,
        };
        let file = WeightFile::from_parameters(&parameters)?;
        file.deciding(self.decide.into())
            .seeing(sight)
            .save(&self.out)?;
        println!("{}", self.out.display());
        Ok(())
    }
}
