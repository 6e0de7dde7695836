//! The command line. Each command has one file with its arguments and the function that runs it.
//!
//! Exit status: 0 on success, 2 on bad usage (clap's), 1 on failure, with one line on stderr that says
//! what was wrong, where, and what to do; 3 where `register --fail-below` was not reached.

mod bench;
mod bop_eval;
mod bop_synth;
mod calibrate;
mod eval;
mod export;
mod import;
#[cfg(feature = "publish")]
mod keygen;
mod methods;
mod output;
mod page;
mod pairs;
mod progress;
mod register;
mod replay;
mod report;
mod source;
mod sweep;
mod table;
mod track;
mod train;
mod views;

pub use output::{check_outputs, write_json};
pub use register::{Initial, Input, SourceArgs, Units};

#[cfg(feature = "publish")]
use crate::publish::{self, PublishArgs};
use crate::random::SEED;
use crate::words::count;
use clap::{CommandFactory, Parser, Subcommand};
use reagent_link::log::{self, LogArgs};

/// Train, evaluate, export and publish ReAgent point cloud registration policies.
///
/// Clouds are in any unit of length unless a command says otherwise; angles on the command line and in
/// tables are degrees. Poses are 3x4 matrices [R | t] that map the source onto the target.
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, mut_subcommands(adapted))]
pub struct Cli {
    /// Seed of every random draw [default: 42]; the same seed gives the same result on any number of threads
    #[arg(
        long,
        global = true,
        value_name = "S",
        value_parser = seed,
        allow_negative_numbers = true
    )]
    seed: Option<u64>,
    /// How it logs.
    #[command(flatten)]
    pub log: LogArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Seeded(Seeded),
    #[command(flatten)]
    Seedless(Seedless),
}

/// Commands that draw from the seed.
#[derive(Debug, Subcommand)]
#[allow(clippy::large_enum_variant, reason = "one exists")]
enum Seeded {
    Train(train::TrainArgs),
    Bench(bench::BenchArgs),
    Eval(eval::EvalArgs),
    Sweep(sweep::SweepArgs),
    Register(register::RegisterArgs),
    Track(track::TrackArgs),
    Pairs(pairs::PairsArgs),
    Views(views::ViewsArgs),
    BopSynth(bop_synth::BopSynthArgs),
    Export(export::ExportArgs),
    Calibrate(calibrate::CalibrateArgs),
}

/// Commands that do not depend on the seed; keys come from the system's random source.
#[derive(Debug, Subcommand)]
#[allow(clippy::large_enum_variant, reason = "one exists")]
enum Seedless {
    Import(import::ImportArgs),
    #[cfg(feature = "publish")]
    Keygen(keygen::KeygenArgs),
    #[cfg(feature = "publish")]
    Publish(PublishArgs),
    Report(report::ReportArgs),
    Page(page::PageArgs),
    Replay(replay::ReplayArgs),
}

fn seed(text: &str) -> Result<u64, String> {
    let refused = |_| format!("a seed is a whole number from 0 to {}", u64::MAX);
    text.parse().map_err(refused)
}

/// Lets options refuse negative numbers themselves, and hides --seed from the help of a command that refuses it.
fn adapted(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|arg| {
        let is_option = !arg.is_positional() && arg.get_action().takes_values();
        arg.allow_negative_numbers(is_option)
    });
    if !Seedless::has_subcommand(command.get_name()) {
        return command;
    }
    let unused = clap::Arg::new("seed").long("seed").hide(true);
    command.arg(unused.value_parser(seed).allow_negative_numbers(true))
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// Whatever went wrong, as a chain from the general to the specific.
    pub fn run(self) -> anyhow::Result<()> {
        match self.command {
            Command::Seeded(command) => command.run(self.seed.unwrap_or(SEED)),
            Command::Seedless(_) if self.seed.is_some() => {
                let said = "--seed changes nothing here: nothing is drawn from it";
                let kind = clap::error::ErrorKind::ArgumentConflict;
                log::bad_usage(&Cli::command().error(kind, said))
            }
            Command::Seedless(command) => command.run(),
        }
    }
}

impl Seeded {
    fn run(self, seed: u64) -> anyhow::Result<()> {
        match self {
            Seeded::Train(args) => args.run(seed),
            Seeded::Bench(args) => args.run(seed),
            Seeded::Eval(args) => args.run(seed),
            Seeded::Sweep(args) => args.run(seed),
            Seeded::Register(args) => args.run(seed),
            Seeded::Track(args) => args.run(seed),
            Seeded::Pairs(args) => args.run(seed),
            Seeded::Views(args) => args.run(seed),
            Seeded::BopSynth(args) => args.run(seed),
            Seeded::Export(args) => args.run(seed),
            Seeded::Calibrate(args) => args.run(seed),
        }
    }
}

impl Seedless {
    fn run(self) -> anyhow::Result<()> {
        match self {
            Seedless::Import(args) => args.run(),
            #[cfg(feature = "publish")]
            Seedless::Keygen(args) => args.run(),
            #[cfg(feature = "publish")]
            Seedless::Publish(args) => {
                use anyhow::Context;
                let runtime =
                    tokio::runtime::Runtime::new().context("cannot start the network threads")?;
                Ok(runtime.block_on(publish::run(args))?)
            }
            Seedless::Report(args) => args.run(),
            Seedless::Page(args) => args.run(),
            Seedless::Replay(args) => args.run(),
        }
    }
}

/// Poses were found, but are less probable than was asked for.
#[derive(Debug, thiserror::Error)]
#[error(
    "{} with a probability below the {least} of --fail-below; the lowest is {lowest}",
    count(*poses, "pose", "poses")
)]
pub struct BelowProbability {
    /// Number of such poses.
    pub poses: usize,
    /// The lowest probability.
    pub lowest: f32,
    /// The probability that was asked for.
    pub least: f32,
}

impl BelowProbability {
    /// Fails if any of these is below the least that was asked for. A pose without a probability counts as below.
    ///
    /// # Errors
    /// How many are.
    pub fn check(
        probabilities: impl Iterator<Item = Option<f32>>,
        least: Option<f32>,
    ) -> Result<(), BelowProbability> {
        let Some(least) = least else {
            return Ok(());
        };
        let probabilities = probabilities.map(Option::unwrap_or_default);
        let below: Vec<f32> = probabilities.filter(|&p| p < least).collect();
        match below.iter().copied().reduce(f32::min) {
            None => Ok(()),
            Some(lowest) => Err(BelowProbability {
                poses: below.len(),
                lowest,
                least,
            }),
        }
    }
}

/// A probability, as an argument.
///
/// # Errors
/// What is none.
pub fn probability(text: &str) -> Result<f32, &'static str> {
    match text.parse::<f32>() {
        Ok(p) if (0.0..=1.0).contains(&p) => Ok(p),
        _ => Err("a probability is a number from 0 to 1"),
    }
}

/// The exit status of a failure.
pub fn status(error: &anyhow::Error) -> u8 {
    if error.is::<BelowProbability>() { 3 } else { 1 }
}

/// Exits as clap does on bad usage: message, usage, status 2.
fn bad_usage(command: &str, message: &str) -> ! {
    let mut cli = Cli::command();
    cli.build();
    let command = cli
        .find_subcommand_mut(command)
        .expect("a command of this program");
    let kind = clap::error::ErrorKind::ArgumentConflict;
    log::bad_usage(&command.error(kind, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
