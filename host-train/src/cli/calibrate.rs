//! `host-train calibrate`

use super::output::{check_outputs, write_json};
use super::source;
use crate::dataset::{self, Split, modelnet};
use crate::measure::calibrate::{Kind, Row, collect, fit, probability};
use crate::measure::quality::Quality;
use crate::policy::{REAGENT, VIEWS, WeightFile};
use crate::views::Views;
use clap::Args;
use reagent_core::pipeline::Mode;
use serde::Serialize;
use std::path::PathBuf;

/// Share of the meshes on which the fitted probabilities are tested.
const HELD_BACK: f64 = 0.3;

/// Fit the probability of a verdict on pairs of training models
///
/// Registers training models by policy and polishing or verification: as they are, in part, without noise, distorted,
/// as rendered views with and without a known view point, and against another mesh. Fits a logistic model on seven
/// tenths of the meshes and tests it on the rest, beside the built-in model and one fitted without the kind of pair at
/// hand. Prints the weights as they stand in core's evidence.rs, and the quality for each kind of pair.
#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Data set whose training split is used
    #[arg(long, value_name = "DIR", value_parser = data_set)]
    data: PathBuf,
    /// Meshes to render views of [default: built-in shapes]
    #[arg(long, value_name = "DIR")]
    meshes: Option<PathBuf>,
    /// Policy [default: the bundled ones for whole clouds and for views]
    #[arg(long, value_name = "FILE.rgw")]
    weights: Option<PathBuf>,
    /// Pairs of each kind
    #[arg(long, value_name = "N", default_value_t = 600, value_parser = source::positive())]
    count: usize,
    /// Write weights, quality and outcomes as JSON, for `report` too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn data_set(text: &str) -> Result<PathBuf, String> {
    match text {
        "procedural" => Err(
            "probabilities are fitted to models of real things: give a folder of meshes or clouds, \
             as `train --data` takes it; built-in shapes are seen as views without --meshes"
                .into(),
        ),
        _ => Ok(text.into()),
    }
}

/// Modes that are calibrated; each has its own weights.
const MODES: [Mode; 2] = [Mode::Polish, Mode::Verify];
/// Number of built-in shapes to render views of if no meshes are given.
const BUILT_IN: u64 = 200;

/// What `--json` writes.
#[derive(Serialize)]
struct Document {
    /// For a pose that was polished alone, and for one that was compared with others.
    weights: [Vec<f64>; 2],
    quality: Vec<Line>,
}

#[derive(Serialize)]
struct Line {
    pairs: String,
    fitted: Quality,
    /// With weights that were fitted to the other kinds.
    left_out: Quality,
    built_in: Quality,
    outcomes: Outcomes,
}

/// For each pair, the built-in model's probability, and 1 if the pose was right.
#[derive(Serialize)]
struct Outcomes {
    probability: Vec<f32>,
    right: Vec<u8>,
}

impl CalibrateArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        check_outputs([&self.json])?;
        let named = |default: &str| self.weights.clone().unwrap_or_else(|| default.into());
        let [whole, of_views] = [REAGENT, VIEWS].map(|default| WeightFile::load(&named(default)));
        let (whole, of_views) = (whole?, of_views?);
        let policies = [whole.policy(), of_views.policy()];
        let models = dataset::load(&self.data, Split::Train, seed)?;
        let (mut fitted, mut tried) = modelnet::validation_split(models, seed, HELD_BACK);
        let views = match &self.meshes {
            Some(dir) => Views::open(dir, Split::Train, seed)?,
            None => Views::procedural(seed, 0..BUILT_IN),
        };
        let [views_fitted, views_tried] = views.split(|objects| {
            let (fitted, tried) = modelnet::validation_split(objects, seed, HELD_BACK);
            [fitted, tried]
        });
        // Two samples of a sparse cloud share points, which those of a sensor do not; so dense clouds are added.
        fitted.extend(views_fitted.models(seed));
        tried.extend(views_tried.models(seed));
        let held_back = ((self.count as f64 * HELD_BACK) as usize).max(1);
        let count = self.count - held_back;
        let training = collect(policies, &fitted, &views_fitted, count, seed)?;
        let rows_but = |mode: Mode, left_out: Option<Kind>| {
            let others = training
                .iter()
                .filter(move |(kind, of, _)| *of == mode && Some(*kind) != left_out);
            others.flat_map(|(_, _, rows)| rows)
        };
        let weights = MODES.map(|mode| fit(rows_but(mode, None)));
        println!("const WEIGHTS: [[f32; FEATURES]; 2] = {weights:.4?};\n");

        let seed = seed.wrapping_add(1000);
        let rows = collect(policies, &tried, &views_tried, held_back, seed)?;
        let line = |(place, pairs): (usize, String), left_out: Option<Kind>, rows: &[&Row]| {
            let (mode, weights) = (MODES[place], weights[place]);
            let without = left_out.map_or(weights, |kind| fit(rows_but(mode, Some(kind))));
            let quality = |of: &dyn Fn(&Row) -> f64| {
                Quality::of(rows.iter().map(|row| (of(row), row.right)).collect())
            };
            Line {
                pairs,
                fitted: quality(&|row| probability(row, &weights)),
                left_out: quality(&|row| probability(row, &without)),
                built_in: quality(&|row| f64::from(row.probability)),
                outcomes: Outcomes {
                    probability: rows.iter().map(|row| row.probability).collect(),
                    right: rows.iter().map(|row| u8::from(row.right)).collect(),
                },
            }
        };
        let mut quality = Vec::new();
        for (place, mode) in MODES.into_iter().enumerate() {
            let of = |kinds: &[Kind]| -> Vec<&Row> {
                rows.iter()
                    .filter(|(kind, of, _)| kinds.contains(kind) && *of == mode)
                    .flat_map(|(_, _, rows)| rows)
                    .collect()
            };
            for kind in Kind::ALL {
                let name = format!("{mode:?} {kind:?}");
                quality.push(line((place, name), Some(kind), &of(&[kind])));
            }
            let mut add = |name: &str, kinds: &[Kind]| {
                let name = format!("{mode:?} {name}");
                quality.push(line((place, name), None, &of(kinds)));
            };
            add("Noisy and Wrong", &[Kind::Noisy, Kind::Wrong]);
            add("Parts and WrongParts", &[Kind::Parts, Kind::WrongParts]);
            add("View and WrongView", &[Kind::View, Kind::WrongView]);
            let seen = [Kind::SeenView, Kind::SeenWrongView];
            add("SeenView and SeenWrongView", &seen);
            add("all", &Kind::ALL);
        }
        println!(
            "on meshes held back               pairs  right  fitted: AUC  ECE    held right: wrong, right  kind left out: ECE  built in: AUC  ECE"
        );
        for Line {
            pairs,
            fitted: f,
            left_out,
            built_in,
            ..
        } in &quality
        {
            println!(
                "{pairs:33} {:<6} {:<6.3} {:<12.4} {:<6.3} {:<17.3} {:<7.3} {:<20.3} {:<14.4} {:.3}",
                f.count,
                f.right,
                f.auc,
                f.ece,
                f.wrong_held_right,
                f.right_held_right,
                left_out.ece,
                built_in.auc,
                built_in.ece
            );
        }
        if let Some(path) = &self.json {
            let weights = weights.map(Vec::from);
            write_json(path, &Document { weights, quality })?;
        }
        Ok(())
    }
}
