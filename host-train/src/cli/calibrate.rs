//! `host-train calibrate`

use super::output::write_json;
use super::source;
use crate::calibrate::{Kind, Quality, Row, collect, fit, probability};
use crate::dataset::{self, Split, modelnet};
use crate::export::WeightFile;
use clap::Args;
use reagent_core::pipeline::Mode;
use serde::Serialize;
use std::path::PathBuf;

/// Share of the meshes on which the fitted probabilities are tried.
const HELD_BACK: f64 = 0.3;

/// Fit the probability of a verdict on pairs of training models
///
/// Registers training models as they are, in part, without noise and against another mesh, by policy and polishing
/// or verification; fits a logistic model on seven tenths of the meshes and tries it on the rest, beside the one
/// that is built in. Prints the weights as they stand in core's verdict.rs, and quality by kind of pair.
#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Data set whose training split is used
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Policy [default: the bundled one]
    #[arg(long, value_name = "FILE.rgw")]
    weights: Option<PathBuf>,
    /// Pairs of each kind
    #[arg(long, value_name = "N", default_value_t = 600, value_parser = source::positive())]
    count: usize,
    /// Write weights, quality and outcomes as JSON, for `report` too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Document {
    weights: Vec<f64>,
    quality: Vec<Line>,
}

#[derive(Serialize)]
struct Line {
    pairs: String,
    fitted: Quality,
    built_in: Quality,
    outcomes: Outcomes,
}

/// Of each pair, the probability as built in, and 1 where the pose was right.
#[derive(Serialize)]
struct Outcomes {
    probability: Vec<f32>,
    right: Vec<u8>,
}

impl CalibrateArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let file = WeightFile::load_or_pretrained(self.weights.as_deref())?;
        let models = dataset::load(&self.data, Split::Train, seed)?;
        let (fitted, tried) = modelnet::validation_split(models, seed, HELD_BACK);
        let held_back = ((self.count as f64 * HELD_BACK) as usize).max(1);
        let rows = collect(file.policy(), &fitted, self.count - held_back, seed)?;
        let weights = fit(rows.iter().flat_map(|(_, _, rows)| rows));
        println!("const WEIGHTS: [f32; FEATURES] = {weights:.4?};\n");

        let rows = collect(file.policy(), &tried, held_back, seed.wrapping_add(1000))?;
        let line = |pairs: String, rows: &[&Row]| Line {
            pairs,
            fitted: Quality::of(
                rows.iter()
                    .map(|row| (probability(row, &weights), row.right))
                    .collect(),
            ),
            built_in: Quality::of(
                rows.iter()
                    .map(|row| (f64::from(row.probability), row.right))
                    .collect(),
            ),
            outcomes: Outcomes {
                probability: rows.iter().map(|row| row.probability).collect(),
                right: rows.iter().map(|row| row.right.into()).collect(),
            },
        };
        let mut quality = Vec::new();
        for mode in [Mode::Polish, Mode::Verify] {
            let of = |kinds: &[Kind]| -> Vec<&Row> {
                rows.iter()
                    .filter(|(kind, of, _)| kinds.contains(kind) && *of == mode)
                    .flat_map(|(_, _, rows)| rows)
                    .collect()
            };
            for kind in Kind::ALL {
                quality.push(line(format!("{mode:?} {kind:?}"), &of(&[kind])));
            }
            let both = [Kind::Noisy, Kind::Wrong];
            quality.push(line(format!("{mode:?} Noisy and Wrong"), &of(&both)));
            quality.push(line(format!("{mode:?} all"), &of(&Kind::ALL)));
        }
        println!(
            "on meshes held back       pairs   right   AUC     Brier   risk     built in: AUC, Brier"
        );
        for Line {
            pairs,
            fitted: f,
            built_in,
            ..
        } in &quality
        {
            println!(
                "{pairs:24}  {:<7} {:<7.3} {:<7.4} {:<7.4} {:<8.4} {:.4} {:.4}",
                f.count, f.right, f.auc, f.brier, f.risk_coverage, built_in.auc, built_in.brier
            );
        }
        if let Some(path) = &self.json {
            let weights = weights.to_vec();
            write_json(path, &Document { weights, quality })?;
        }
        Ok(())
    }
}
