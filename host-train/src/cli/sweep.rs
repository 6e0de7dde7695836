//! `host-train sweep`

use super::methods::MethodArgs;
use super::output::{check_outputs, write_json};
use super::progress::Progress;
use super::source::DataSource;
use super::{bad_usage, source, table};
use crate::measure::eval::EvalSettings;
use crate::measure::sweep::{Document, Drawing, SweepError, Vary, sweep};
use crate::policy::REAGENT;
use crate::protocol::{Conditions, Protocol};
use anyhow::Context;
use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Measure errors while one condition of a protocol is varied: the paper's ablation figure, and beyond
///
/// Prints quartiles of every method at every value. All values are measured on the same models, points and directions;
/// other conditions are as in the protocol. Cropped and cluttered sources count with all their points in the Chamfer
/// distance.
#[derive(Debug, Args)]
pub(super) struct SweepArgs {
    /// Test split of a data set, or the built-in shapes
    #[arg(long, value_name = "DIR|procedural")]
    data: DataSource,
    /// Protocol for the conditions that are not varied: m40-models, m40-categories or scan
    #[arg(long, value_enum, value_name = "NAME")]
    protocol: Protocol,
    /// What to vary, separated by commas: noise, rotation, translation, overlap, points, outliers, or all
    #[arg(long, value_name = "LIST", value_delimiter = ',', required = true, value_parser = names())]
    vary: Vec<String>,
    /// Values to measure, separated by commas, if a single condition is varied. Noise: standard deviation, clipped at
    /// .1; rotation: upper bound about each axis, degrees; translation: upper bound along each axis; overlap: share
    /// of the source's points left on one side of a random plane; points: of each cloud; outliers: share of the
    /// source's points replaced by points uniform in the unit ball [default: five or six of each]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    values: Vec<f64>,
    /// Pairs at each value [default: one a model; 100 of the built-in shapes]
    #[arg(long, value_name = "M", value_parser = source::positive())]
    count: Option<usize>,
    #[command(flatten)]
    methods: MethodArgs,
    /// Write summaries and the errors of every pair as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

const ALL: &str = "all";

fn names() -> PossibleValuesParser {
    let values = Vary::ALL.iter().filter_map(Vary::to_possible_value);
    PossibleValuesParser::new(values.chain([clap::builder::PossibleValue::new(ALL)]))
}

impl SweepArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        check_outputs([&self.json])?;
        let named = |vary: &Vary| {
            let value = vary.to_possible_value().expect("no value is hidden");
            self.vary
                .iter()
                .any(|name| name == ALL || name == value.get_name())
        };
        let varied: Vec<Vary> = Vary::ALL.into_iter().filter(named).collect();
        if varied.len() > 1 && !self.values.is_empty() {
            bad_usage("sweep", "--values needs a single condition in --vary");
        }
        let Some(base) = Conditions::of(self.protocol) else {
            bad_usage(
                "sweep",
                "--protocol must be m40-models, m40-categories or scan",
            );
        };
        let values = |vary: Vary| -> &[f64] {
            if self.values.is_empty() {
                vary.values()
            } else {
                &self.values
            }
        };
        for (vary, value) in varied
            .iter()
            .flat_map(|&v| values(v).iter().map(move |&x| (v, x)))
        {
            if let Err(error) = vary.at(value, &base) {
                bad_usage("sweep", &error.to_string());
            }
        }

        let policies = self.methods.policies("sweep")?;
        let policies = self.methods.or_bundled(policies, REAGENT)?;
        let contestants = self.methods.contestants(&policies, seed);
        let models = source::models(&self.data, self.protocol, self.count, seed)?;
        let count = self.count.unwrap_or(models.len());
        let drawing = Drawing {
            models: &models,
            base,
            count,
            seed,
        };
        let settings = EvalSettings {
            steps: self.methods.steps,
            threads: self.methods.threads,
            per_step: false,
        };
        let total: usize = varied.iter().map(|&vary| values(vary).len()).sum();
        let progress = Progress::new(total * count * contestants.len(), "registrations");
        let run = |&vary: &Vary| {
            let tick = || progress.tick();
            sweep(&drawing, vary, values(vary), &contestants, &settings, &tick)
        };
        let results = varied
            .iter()
            .map(run)
            .collect::<Result<Vec<_>, SweepError>>();
        progress.finish();
        let document = Document {
            sweep: results.with_context(|| self.data.to_string())?,
        };
        for (i, varied) in document.sweep.iter().enumerate() {
            let gap = if i > 0 { "\n" } else { "" };
            print!("{gap}{}", table::varied(varied, &contestants));
        }
        if let Some(path) = &self.json {
            write_json(path, &document)?;
        }
        Ok(())
    }
}
