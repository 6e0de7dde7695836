//! `host-train eval`

use super::bop_eval::{self, EvalProtocol};
use super::output::write_json;
use super::progress::Progress;
use super::source::DataSource;
use super::{bad_usage, source, table};
use crate::bop::evaluate::Refinements;
use crate::dataset::pairs::{PairSet, save_poses};
use crate::eval::{Contestant, Document, EvalSettings, Method, evaluate};
use crate::export::WeightFile;
use anyhow::Context;
use clap::{ArgGroup, Args, ValueEnum};
use reagent_core::dims::STEPS;
use std::path::{Path, PathBuf};

/// Register pairs by policies and baselines and print the paper's metrics
///
/// Errors: MAE and ISO of rotation (degrees) and translation (units of the clouds), area under the ADI recall
/// curve up to a tenth of the diameter (percent), modified Chamfer distance, recall at 5 degrees and .05
/// units. Clouds are used as they are, without normalisation.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("on").args(["pairs", "data"]).required(true)))]
pub(super) struct EvalArgs {
    /// Policies to evaluate, each reported under its file stem [default: the bundled one, as "reagent"]
    #[arg(long, value_name = "FILE.rgw", num_args = 1..)]
    weights: Vec<PathBuf>,
    /// Pairs drawn beforehand (source, target, transform_gt; raw and label if there)
    #[arg(long, value_name = "FILE.h5")]
    pairs: Option<PathBuf>,
    /// Draw pairs from the test split of a data set, or from the built-in shapes
    #[arg(long, value_name = "DIR|procedural", requires = "protocol")]
    data: Option<DataSource>,
    /// How to draw them
    #[arg(long, value_enum, value_name = "NAME", conflicts_with = "pairs")]
    protocol: Option<EvalProtocol>,
    /// Initial poses for protocol bop, in the BOP results format (scene_id,im_id,obj_id,score,R,t,time; mm)
    #[arg(long, value_name = "FILE.csv", conflicts_with = "pairs")]
    estimates: Option<PathBuf>,
    /// Write refined poses in the same format; with several methods, one FILE-METHOD.csv each
    #[arg(long, value_name = "FILE.csv", requires = "estimates")]
    results: Option<PathBuf>,
    /// How many to draw [default: one a model; 100 of the built-in shapes; all objects that have an estimate]
    #[arg(long, value_name = "M", conflicts_with = "pairs", value_parser = source::positive())]
    count: Option<usize>,
    /// What to run, separated by commas; "policy" stands for every file of --weights [default: policy]
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',')]
    methods: Vec<MethodName>,
    /// Refinement steps of a policy
    #[arg(long, value_name = "N", default_value_t = STEPS, value_parser = source::positive())]
    steps: usize,
    /// Also report policies after every step, with cumulative times
    #[arg(long)]
    per_step: bool,
    /// Threads over pairs; times are undisturbed only with 1
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = source::positive())]
    threads: usize,
    /// Write errors and times (milliseconds) as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the final poses, one dataset [M,3,4] a method
    #[arg(long, value_name = "FILE.h5")]
    poses: Option<PathBuf>,
}

/// Name under which the bundled policy is reported.
const BUNDLED: &str = "reagent";

/// What `--methods` accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// Every policy of --weights, or the bundled one
    Policy,
    /// Point-to-point ICP, correspondence distance 0.5
    Icp,
    /// The initial error
    Init,
}

impl EvalArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let methods = if self.methods.is_empty() {
            vec![MethodName::Policy]
        } else {
            self.methods
        };
        let policies = methods.contains(&MethodName::Policy);
        if !policies && !self.weights.is_empty() {
            bad_usage(
                "eval",
                "--weights is given, but \"policy\" is not among --methods",
            );
        }
        let weights = if self.weights.is_empty() {
            vec![(BUNDLED.into(), WeightFile::pretrained())]
        } else {
            let load = |path: &PathBuf| WeightFile::load(path).map(|file| (stem(path), file));
            self.weights.iter().map(load).collect::<Result<_, _>>()?
        };

        let mut contestants = Vec::new();
        for method in methods {
            match method {
                MethodName::Policy => {
                    contestants.extend(weights.iter().map(|(name, file)| Contestant {
                        name: name.clone(),
                        method: Method::Policy(file.policy()),
                    }))
                }
                MethodName::Icp => {
                    contestants.push(Contestant {
                        name: "icp".into(),
                        method: Method::Icp,
                    });
                }
                MethodName::Init => {
                    contestants.push(Contestant {
                        name: "init".into(),
                        method: Method::Init,
                    });
                }
            }
        }

        let mut refinements = None;
        let (set, origin) = match (&self.pairs, &self.data, self.protocol) {
            (Some(path), _, _) => (PairSet::load(path)?, path.display().to_string()),
            (None, Some(data), Some(EvalProtocol::Models(protocol))) => {
                if self.estimates.is_some() {
                    bad_usage("eval", "--estimates is for --protocol bop");
                }
                let set = source::draw(data, protocol, self.count, seed)?;
                (set, data.to_string())
            }
            (None, Some(DataSource::Directory(root)), Some(EvalProtocol::Bop)) => {
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
            _ => bad_usage(
                "eval",
                "give --pairs FILE.h5, or --data and --protocol; bop needs a directory",
            ),
        };
        let settings = EvalSettings {
            steps: self.steps,
            threads: self.threads,
            per_step: self.per_step,
        };
        let pairs = set.source.len();
        let progress = Progress::new(pairs * contestants.len(), "registrations");
        let outcomes = evaluate(&set, &contestants, &settings, &|| progress.tick());
        progress.finish();
        let outcomes = outcomes.with_context(|| origin.clone())?;

        println!("{pairs} pairs of {origin}\n");
        print!("{}", table::methods(&outcomes));
        for outcome in outcomes.iter().filter(|o| !o.per_step.is_empty()) {
            print!("\n{}", table::steps(&outcome.name, &outcome.per_step));
        }
        let document = Document::new(pairs, &outcomes);
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
}

/// Name under which a weight file is reported.
fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}
