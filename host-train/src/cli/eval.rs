//! `host-train eval`

use super::bop_eval::{self, EvalProtocol};
use super::methods::MethodArgs;
use super::output::{check_files, write_json, write_text};
use super::progress::Progress;
use super::source::DataSource;
use super::{bad_usage, source, table};
use crate::bop::evaluate::Refinements;
use crate::dataset::pairs::{PairSet, Symmetry, save_poses};
use crate::measure::agreement::agreement;
use crate::measure::document::Document;
use crate::measure::eval::{EvalSettings, Row, evaluate};
use crate::policy::{REAGENT, VIEWS};
use crate::register::trace;
use crate::words::count;
use anyhow::Context;
use clap::{ArgGroup, Args};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Register pairs by policies and baselines and print the paper's metrics
///
/// Errors: MAE and ISO of rotation (degrees) and translation (units of the clouds), area under the ADI recall
/// curve up to a tenth of the diameter (percent), modified Chamfer distance (not of views), recall at 5 degrees and .05
/// units, average distance (AD) of model points below parts of the diameter. FILE.json beside FILE.h5 may list poses that look
/// like each pair's true one ("truths", [3][4]) and whether the object is symmetric ("sym": ADI counts, else ADD). Clouds are used as they are, without normalisation:
/// lengths in FILE.h5 must be in radii of the target, whose mean lies at the origin.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("on").args(["pairs", "data"]).required(true)))]
pub(super) struct EvalArgs {
    #[command(flatten)]
    methods: MethodArgs,
    /// Pairs drawn beforehand (source, target, transform_gt; raw, label and view_point if there)
    #[arg(long, value_name = "FILE.h5")]
    pairs: Option<PathBuf>,
    /// Draw pairs from the test split of a data set, or from the built-in shapes, or single depth views of such meshes. Of a bag
    /// (.mcap) in a data set, only the first cloud is a model
    #[arg(long, value_name = "DIR|procedural|views:DIR")]
    data: Option<DataSource>,
    /// How to draw them; not for views
    #[arg(long, value_enum, value_name = "NAME", conflicts_with = "pairs")]
    protocol: Option<EvalProtocol>,
    /// Initial poses for protocol bop, in the BOP results format (scene_id,im_id,obj_id,score,R,t,time; mm)
    #[arg(long, value_name = "FILE.csv", conflicts_with = "pairs")]
    estimates: Option<PathBuf>,
    /// Write refined poses in the same format; with several methods, one FILE-METHOD.csv each
    #[arg(
        long,
        value_name = "FILE.csv",
        requires = "estimates",
        conflicts_with = "pairs"
    )]
    results: Option<PathBuf>,
    /// How many to draw [default: one a model; 100 of the built-in shapes; all objects that have an estimate]
    #[arg(long, value_name = "M", conflicts_with = "pairs", value_parser = source::positive())]
    count: Option<usize>,
    /// Also report policies after every step, with cumulative times
    #[arg(long)]
    per_step: bool,
    /// Also report the share of axes on which each further policy of --weights acts like the first, step by step from
    /// the poses that the first reaches
    #[arg(long)]
    agreement: bool,
    /// Write errors and times (milliseconds) as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the record that a policy file is shipped with: its SHA-256, this program's version, and every metric
    #[arg(long, value_name = "FILE", conflicts_with = "estimates")]
    record: Option<PathBuf>,
    /// Write the final poses, one dataset [M,3,4] for each method
    #[arg(long, value_name = "FILE.h5")]
    poses: Option<PathBuf>,
    /// Write the first pairs as every policy registers them, step by step; `report` shows them
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Number of pairs in the trace
    #[arg(long, value_name = "N", default_value_t = 5, requires = "trace", value_parser = source::positive())]
    traced: usize,
}

/// The record of an evaluation: what `--record` writes.
#[derive(Serialize)]
struct Record<'a> {
    program: &'static str,
    /// SHA-256 of each policy file, by the name that it is reported under.
    weights: BTreeMap<&'a str, String>,
    /// Name of the pairs' file, or what was drawn.
    on: &'a str,
    pairs: usize,
    seed: u64,
    steps: usize,
    methods: BTreeMap<&'a str, &'a Row>,
}

impl EvalArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        check_files(&self.pairs, self.outputs())?;
        let policies = self.methods.policies("eval")?;
        let mut refinements = None;
        let (set, origin) = match (&self.pairs, &self.data, self.protocol) {
            (Some(path), _, _) => (PairSet::load(path)?, path.display().to_string()),
            (
                None,
                Some(DataSource::Bop(root) | DataSource::Directory(root)),
                Some(EvalProtocol::Bop),
            ) => {
                let Some(estimates) = &self.estimates else {
                    bad_usage(
                        "eval",
                        "--protocol bop refines poses: give --estimates FILE.csv",
                    );
                };
                let mut found = Refinements::open(root, estimates, self.count, seed)?;
                let set = std::mem::take(&mut found.set);
                let origin = bop_eval::describe(&found, root, estimates);
                refinements = Some(found);
                (set, origin)
            }
            (None, Some(_), Some(EvalProtocol::Bop)) => {
                bad_usage("eval", "--protocol bop needs a directory");
            }
            (None, Some(data), protocol) => {
                if self.estimates.is_some() {
                    bad_usage("eval", "--estimates is for --protocol bop");
                }
                let protocol = match protocol {
                    Some(EvalProtocol::Models(protocol)) => Some(protocol),
                    _ => None,
                };
                let set = source::draw("eval", data, protocol, self.count, seed)?;
                (set, data.to_string())
            }
            (None, None, _) => bad_usage("eval", "give --pairs FILE.h5 or --data"),
        };
        let symmetries = self.symmetries(&set)?;
        let of_views = set.is_of_views();
        let bundled = if of_views { VIEWS } else { REAGENT };
        let policies = self.methods.or_bundled(policies, bundled)?;
        let contestants = self.methods.contestants(&policies, seed);
        let settings = EvalSettings {
            steps: self.methods.steps,
            threads: self.methods.threads,
            per_step: self.per_step,
        };
        let pairs = set.source.len();
        let progress = Progress::new(pairs * contestants.len(), "registrations");
        let outcomes = evaluate(&set, &contestants, &settings, &|| progress.tick());
        progress.finish();
        let outcomes = outcomes.with_context(|| origin.clone())?;

        println!(
            "{} of {origin}{symmetries}\n",
            count(pairs, "pair", "pairs")
        );
        print!("{}", table::methods(&outcomes, of_views));
        for outcome in outcomes.iter().filter(|o| !o.per_step.is_empty()) {
            print!(
                "\n{}",
                table::steps(&outcome.name, &outcome.per_step, of_views)
            );
        }
        let agreement = if self.agreement {
            agreement(&set, &contestants, &settings).with_context(|| origin.clone())?
        } else {
            BTreeMap::new()
        };
        for (name, found) in &agreement {
            print!("\n{}", table::agreement(name, found));
        }
        if let Some(path) = &self.trace {
            let traced =
                crate::measure::trace::pairs(&set, &contestants, settings.steps, self.traced);
            write_text(
                path,
                &trace::to_text(&traced.with_context(|| origin.clone())?)?,
            )?;
        }
        if let Some(path) = &self.record {
            let record = Record {
                program: concat!("host-train ", env!("CARGO_PKG_VERSION")),
                weights: policies.sha256(),
                on: origin.rsplit('/').next().unwrap_or(&origin),
                pairs,
                seed,
                steps: self.methods.steps,
                methods: outcomes.iter().map(|o| (o.name.as_str(), &o.row)).collect(),
            };
            write_json(path, &record)?;
        }
        let document = Document::new(pairs, &outcomes, agreement);
        if let Some(found) = &refinements {
            let (json, results) = (self.json.as_deref(), self.results.as_deref());
            bop_eval::report(found, &outcomes, document, json, results)?;
        } else if let Some(path) = &self.json {
            write_json(path, &document)?;
        }
        if let Some(path) = &self.poses {
            let poses: Vec<_> = outcomes
                .into_iter()
                .map(|o| (o.name, o.target_from_source))
                .collect();
            save_poses(path, &poses)?;
        }
        Ok(())
    }

    fn outputs(&self) -> [&Option<PathBuf>; 5] {
        [
            &self.json,
            &self.record,
            &self.poses,
            &self.trace,
            &self.results,
        ]
    }

    /// Where the symmetries of the pairs came from, if there are any; no output may take their place.
    fn symmetries(&self, set: &PairSet) -> anyhow::Result<String> {
        let (Some(pairs), Some(symmetries)) = (&self.pairs, &set.symmetries) else {
            return Ok(String::new());
        };
        Symmetry::keep_beside(pairs, self.outputs())?;
        let listed = count(symmetries.len(), "symmetry", "symmetries");
        let list = Symmetry::list_beside(pairs);
        Ok(format!(", {listed} from {}", list.display()))
    }
}
