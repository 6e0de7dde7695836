//! `host-train export`

use super::methods::{Decide, steps};
use super::source::{self, DataSource};
use crate::dataset::pairs::PairSet;
use crate::policy::checkpoint::Checkpoint;
use crate::policy::{WeightFile, parameters_of};
use crate::protocol::Protocol;
use crate::words::count;
use clap::{Args, ValueEnum};
use reagent_core::{Decision, Policy};
use std::path::PathBuf;

/// Write the policy of a run as a weight file for robots
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// Run directory (its best model), checkpoint, or f32 weight file
    #[arg(long, value_name = "RUN_DIR|CHECKPOINT|FILE.rgw")]
    run: PathBuf,
    /// Number format
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = Format::F32)]
    format: Format,
    /// With int8: pairs to calibrate the integers on, or a data set whose training clouds are drawn as noisy pairs
    #[arg(
        long,
        value_name = "DIR|FILE.h5|procedural[:COUNT]|views:DIR",
        default_value = "procedural:128"
    )]
    calibration: DataSource,
    /// How steps follow from probabilities [default: a weight file's own; both-ways for runs and checkpoints]
    #[arg(long, value_enum, value_name = "HOW")]
    decide: Option<Decide>,
    /// Steps from one look at all points of the source to the next; steps in between look only at its critical points
    /// (1: every step looks at all) [default: a weight file's own; 1 for runs and checkpoints]
    #[arg(long, value_name = "STEPS", value_parser = steps())]
    rescan: Option<u16>,
    /// File to write
    #[arg(long, value_name = "FILE.rgw")]
    out: PathBuf,
}

/// Number formats of weight files.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// 32-bit floating point, exactly as trained
    F32,
    /// 8-bit integers: a quarter of the size, and the same bits on every machine
    Int8,
}

impl ExportArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let parameters = parameters_of(&self.run)?;
        let (decision, rescan, sight) = if self.run.extension().is_some_and(|e| e == "rgw") {
            let file = WeightFile::load(&self.run)?;
            let Policy {
                decision,
                rescan,
                sight,
                ..
            } = file.policy();
            (decision, rescan, sight)
        } else {
            let sight = Checkpoint::load(&Checkpoint::find(&self.run)?)?.sight;
            (Decision::default(), 1, sight)
        };
        let decision = self.decide.map_or(decision, Decision::from);
        let rescan = self.rescan.unwrap_or(rescan);
        let file = match self.format {
            Format::F32 => WeightFile::from_parameters(&parameters)?,
            Format::Int8 => {
                let pairs = calibration(&self.calibration, seed)?;
                if pairs.source.len() < FEW_PAIRS {
                    tracing::warn!(
                        "calibrated on {}: with fewer than {FEW_PAIRS}, more actions differ from those in f32",
                        count(pairs.source.len(), "cloud", "clouds")
                    );
                }
                WeightFile::from_parameters_int8_within(sight, &parameters, &pairs)?
            }
        };
        let file = file.deciding(decision).rescanning(rescan).seeing(sight);
        file.save(&self.out)?;
        println!("{}", self.out.display());
        Ok(())
    }
}

/// Most pairs that integers are calibrated on.
const PAIRS: usize = 128;

/// More pairs change next to nothing; with fewer, too many activations exceed the calibrated ranges.
const FEW_PAIRS: usize = 64;

fn calibration(data: &DataSource, seed: u64) -> anyhow::Result<PairSet> {
    let mut pairs = match data {
        DataSource::Directory(path) if path.is_file() => PairSet::load(path)?,
        data => source::draw_training(data, Protocol::M40Models, PAIRS, seed)?,
    };
    pairs.source.truncate(PAIRS);
    pairs.target.truncate(PAIRS);
    pairs.target_from_source.truncate(PAIRS);
    Ok(pairs)
}
