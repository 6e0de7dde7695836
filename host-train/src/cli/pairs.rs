//! `host-train pairs`

use super::source::{self, DataSource};
use crate::dataset::cloud_file::extension;
use crate::protocol::Protocol;
use crate::words::count;
use anyhow::bail;
use clap::Args;
use std::path::PathBuf;

/// Draw registration pairs once and write them to a file
///
/// The file holds source and target [M,N,3], transform_gt [M,3,4] (maps source to target), raw [M,K,3]
/// (the noise-free target) and label [M], all in normalised units; of views also view_point [M,3].
#[derive(Debug, Args)]
pub(super) struct PairsArgs {
    /// Data set whose test split is used: modelnet40_ply_hdf5_2048, ScanObjectNN, or a tree of loose meshes and
    /// clouds; or the built-in shapes; or single depth views of such meshes, rendered as for training
    #[arg(long, value_name = "DIR|FILE.h5|procedural|views:DIR")]
    data: DataSource,
    /// How to draw; not for views
    #[arg(long, value_enum, value_name = "NAME")]
    protocol: Option<Protocol>,
    /// How many pairs [default: one a model; 100 of the built-in shapes]
    #[arg(long, value_name = "M", value_parser = source::positive())]
    count: Option<usize>,
    /// File to write
    #[arg(long, value_name = "FILE.h5")]
    out: PathBuf,
}

impl PairsArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let extension = extension(&self.out);
        if !["h5", "hdf5"].contains(&extension.as_str()) {
            bail!(
                "--out {}: pairs are written as HDF5; name a file FILE.h5",
                self.out.display()
            );
        }
        let set = source::draw("pairs", &self.data, self.protocol, self.count, seed)?;
        set.save(&self.out)?;
        println!(
            "{} of {} in {}",
            count(set.source.len(), "pair", "pairs"),
            self.data,
            self.out.display()
        );
        Ok(())
    }
}
