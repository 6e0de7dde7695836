//! `host-train train`

use super::source::{DataSource, positive};
use crate::learn::env::Accumulation;
use crate::learn::expert::Expert;
use crate::learn::nn::Search;
use crate::random::SEED;
use crate::report::Report;
use crate::train::record::RunRecord;
use crate::train::{self, Anneal, Categories, Follow, Network, Stage, TrainConfig};
use anyhow::{Context, bail};
use clap::{ArgAction, Args};
use reagent_core::cut::Cut;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Train a policy
///
/// Writes RUN_DIR/config.json, metrics.jsonl, plots/, checkpoints and best/. Ctrl-C or SIGTERM writes a checkpoint
/// first; --resume goes on exactly from there, with the options of the run. The model that is kept is the
/// best on a validation split carved out of the training split by mesh. Without options it is the paper's
/// method: stages pretrain (imitation, clean clouds), then il (imitation, noisy clouds) or ilrl (with
/// reinforcement), each with --init of the one before.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Data sets (modelnet40_ply_hdf5_2048, ScanObjectNN, trees of loose meshes and clouds, BOP layout) or built-in
    /// shapes, taken together; views:DIR and views:procedural[:COUNT] are depth views of meshes, rendered as samples
    /// are drawn
    #[arg(long, value_name = "DIR|FILE.h5|procedural[:COUNT]|views:DIR", num_args = 1.., required_unless_present = "resume")]
    data: Vec<DataSource>,
    /// What to train
    #[arg(
        long,
        value_enum,
        value_name = "STAGE",
        required_unless_present = "resume"
    )]
    stage: Option<Stage>,
    /// Directory of the run
    #[arg(long, value_name = "RUN_DIR")]
    out: PathBuf,
    /// Go on from the last checkpoint of the run, with its options; --epochs may be more. A run that has reached its end
    /// has nothing left to do
    #[arg(long)]
    resume: bool,
    /// Start from a run, a checkpoint or a policy instead of random weights, with a fresh optimiser
    #[arg(long, value_name = "RUN_OR_WEIGHTS", conflicts_with = "resume")]
    init: Option<PathBuf>,
    /// Passes over the clouds [default: the paper's 50]
    #[arg(long, value_name = "N", value_parser = positive())]
    epochs: Option<usize>,
    /// Threads; results do not depend on it [default: all cores]
    #[arg(long, value_name = "N", value_parser = positive())]
    threads: Option<usize>,
    /// Minutes between checkpoints within an epoch; 0 for one after every update [default: 5]
    #[arg(long, value_name = "M", value_parser = at_least_0)]
    checkpoint_minutes: Option<f64>,
    #[command(flatten)]
    data_options: DataOptions,
    #[command(flatten)]
    method: MethodOptions,
    #[command(flatten)]
    optimiser: OptimiserOptions,
}

/// What the clouds look like.
#[derive(Debug, Args)]
#[command(next_help_heading = "Clouds")]
struct DataOptions {
    /// Categories of a data set to train on: "first" are its first 20 in alphabetical order [default: first, the paper's]
    #[arg(long, value_enum, value_name = "WHICH")]
    categories: Option<Categories>,
    /// Points drawn from each cloud [default: the paper's 1024]
    #[arg(long, value_name = "N", value_parser = positive())]
    points: Option<usize>,
    /// Look only at points of the source within so many radii of the target's centre, in training and wherever the
    /// policy runs; rounded to sixteenths, 0 for no limit [default: 1.25 where there are views, else 0]
    #[arg(long, value_name = "RADII", value_parser = cut)]
    cut: Option<Cut>,
    /// Look only at points of the target that have some of the source near them, chosen anew every so many steps, in
    /// training and wherever the policy runs; 0 for all points, always [default: 3 where there are views, else 0]
    #[arg(long, value_name = "STEPS", value_parser = focus())]
    focus: Option<u8>,
    /// Do not deform shapes by scale, shear and mirror (design table; the paper does)
    #[arg(long)]
    no_augmentation: bool,
    /// In half of the sources, least share of the points that are kept on one side of a random plane; uniform from here
    /// to 1 [default: 1, whole shapes as in the paper]
    #[arg(long, value_name = "SHARE", value_parser = up_to_1)]
    min_overlap: Option<f32>,
    /// In half of the sources, largest share of outliers; uniform from 0 [default: 0, as in the paper]
    #[arg(long, value_name = "SHARE", value_parser = outliers)]
    max_outliers: Option<f32>,
}

/// How observations are gathered and what is minimised.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
struct MethodOptions {
    /// The expert that labels the observations [default: steady, the paper's]
    #[arg(long, value_enum, value_name = "WHO")]
    expert: Option<Expert>,
    /// Whose actions trajectories take [default: stochastic, the paper's]
    #[arg(long, value_enum, value_name = "WHOSE")]
    follow: Option<Follow>,
    /// How actions accumulate [default: global, the paper's]
    #[arg(long, value_enum, value_name = "HOW")]
    accumulation: Option<Accumulation>,
    /// Widths of the network [default: wide, the paper's]
    #[arg(long = "shape", value_enum, value_name = "WIDTHS")]
    network: Option<Network>,
    /// Problems rolled out together [default: 32, the authors' code's]
    #[arg(long, value_name = "N", value_parser = positive())]
    problems: Option<usize>,
    /// Trajectories from each problem [default: the paper's 4]
    #[arg(long, value_name = "N", value_parser = positive())]
    trajectories: Option<usize>,
    /// How to find the points that reach a feature's maximum [default: auto]
    #[arg(long, value_enum, value_name = "HOW")]
    search: Option<Search>,
    /// Weight of the reinforcement term [default: the paper's 2 in stage ilrl; 0.1 is its value for LINEMOD]
    #[arg(long, value_name = "W", value_parser = at_least_0)]
    alpha: Option<f64>,
    /// Normalise advantages to mean 0 and standard deviation 1 in each mini-batch (the authors' code does not)
    #[arg(long)]
    normalise_advantages: bool,
    /// Clip value estimates around those of the roll-out (the authors' code does not)
    #[arg(long)]
    clip_values: bool,
    /// Bootstrap returns with the value estimate of the state after the last step (the authors' code counts it as 0)
    #[arg(long)]
    bootstrap: bool,
}

/// How the parameters are updated.
#[derive(Debug, Args)]
#[command(next_help_heading = "Optimiser")]
struct OptimiserOptions {
    /// Learning rate at the start [default: the paper's 1e-3 in pretrain, 1e-4 after]
    #[arg(long, value_name = "RATE", value_parser = up_to_1)]
    learning_rate: Option<f32>,
    /// Epochs between halvings of the learning rate [default: the paper's 10]
    #[arg(long, value_name = "N", value_parser = positive())]
    halve_every: Option<usize>,
    /// How the learning rate falls [default: halve, the paper's]
    #[arg(long, value_enum, value_name = "HOW")]
    anneal: Option<Anneal>,
    /// Largest gradient norm; longer gradients are scaled down to it [default: no limit, as in the authors' code]
    #[arg(long, value_name = "LENGTH", value_parser = above_0)]
    clip_gradient: Option<f32>,
    /// Validate and export an average of the weights, with this decay per mini-batch, such as 0.999 [default: no
    /// average, as in the authors' code]
    #[arg(long, value_name = "DECAY", value_parser = decay)]
    average: Option<f32>,
    /// Observations of one optimiser step [default: the paper's 32]
    #[arg(long, value_name = "N", value_parser = positive(), action = ArgAction::Set)]
    mini_batch: Option<usize>,
}

/// Draws the curves so far into RUN_DIR/plots. Training goes on if they cannot be drawn.
fn draw(run: &Path) {
    let drawn = Report::read(&[run.to_owned()]).and_then(|r| r.write_plots(&run.join("plots")));
    if let Err(error) = drawn {
        eprintln!("no plots: {error}");
    }
}

/// Overwrites `place` with an option's value, if it was given.
fn set<T>(place: &mut T, given: Option<T>) {
    if let Some(value) = given {
        *place = value;
    }
}

impl TrainArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let resume = self.resume;
        let config = self.config(seed)?;
        let stop = stop_on_signal().context("cannot listen for Ctrl-C")?;
        train::run(&config, resume, &stop, &draw)?;
        if stop.load(Ordering::Relaxed) {
            bail!(
                "interrupted: {} holds a checkpoint, go on with --resume",
                config.out.display()
            );
        }
        Ok(())
    }

    /// The paper's configuration, or that of the run to resume, changed by the options given.
    fn config(self, seed: u64) -> anyhow::Result<TrainConfig> {
        let mut config = match self.stage {
            _ if self.resume => RunRecord::load(&self.out)?.config,
            Some(stage) => TrainConfig::new(stage, self.data.clone(), self.out.clone()),
            None => bail!("give --stage"),
        };
        config.out = self.out;
        if !(self.resume && seed == SEED) {
            config.seed = seed;
        }
        if !self.data.is_empty() {
            config.data = self.data;
        }
        set(&mut config.stage, self.stage);
        if self.init.is_some() {
            config.init = self.init;
        }
        set(&mut config.epochs, self.epochs.map(|n| n as u32));
        set(&mut config.threads, self.threads);
        set(&mut config.checkpoint_minutes, self.checkpoint_minutes);

        let given = self.data_options;
        set(&mut config.categories, given.categories);
        set(&mut config.points, given.points);
        config.augmentation &= !given.no_augmentation;
        set(&mut config.sight.cut, given.cut);
        set(&mut config.sight.focus, given.focus);
        set(&mut config.disturbance.min_overlap, given.min_overlap);
        set(&mut config.disturbance.max_outliers, given.max_outliers);

        let given = self.method;
        set(&mut config.network, given.network);
        set(&mut config.roll_out.problems, given.problems);
        set(&mut config.roll_out.trajectories, given.trajectories);
        let method = &mut config.method;
        set(&mut method.expert, given.expert);
        set(&mut method.follow, given.follow);
        set(&mut method.accumulation, given.accumulation);
        set(&mut method.search, given.search);
        set(&mut method.ppo.alpha, given.alpha.map(|a| a as f32));
        method.ppo.normalise_advantages |= given.normalise_advantages;
        method.ppo.clip_values |= given.clip_values;
        method.ppo.bootstrap |= given.bootstrap;

        let given = self.optimiser;
        if given.clip_gradient.is_some() {
            method.clip_gradient = given.clip_gradient;
        }
        if given.average.is_some() {
            method.average = given.average;
        }
        set(&mut config.learning_rate.initial, given.learning_rate);
        set(&mut config.learning_rate.anneal, given.anneal);
        let halve_every = given.halve_every.map(|n| n as u32);
        set(&mut config.learning_rate.halve_every, halve_every);
        set(&mut config.roll_out.mini_batch, given.mini_batch);
        Ok(config)
    }
}

/// Steps between two choices of the target's points; a policy file has four bits for it.
pub(super) fn focus() -> clap::builder::RangedI64ValueParser<u8> {
    clap::value_parser!(u8).range(..16)
}

/// Radii, or 0 for no limit.
pub(super) fn cut(text: &str) -> Result<Cut, String> {
    match text.parse() {
        Ok(0.0) => Ok(Cut::NONE),
        Ok(radii) => {
            Cut::within(radii).ok_or_else(|| "give 0, or a number from 0.07 to 15.9".into())
        }
        Err(_) => Err("give a number of radii, such as 1.5".into()),
    }
}

/// A learning rate or a share above 0 and at most 1.
fn up_to_1(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && number <= 1.0 => Ok(number),
        _ => Err("give a number above 0 and at most 1".into()),
    }
}

/// A share of at least 0 and below 1.
fn outliers(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(share) if (0.0..1.0).contains(&share) => Ok(share),
        _ => Err("give a share of at least 0 and below 1".into()),
    }
}

/// A decay above 0 and below 1.
fn decay(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(decay) if decay > 0.0 && decay < 1.0 => Ok(decay),
        _ => Err("give a number above 0 and below 1".into()),
    }
}

fn above_0(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("give a number above 0".into()),
    }
}

fn at_least_0(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x >= 0.0 && x.is_finite() => Ok(x),
        _ => Err("give a number of at least 0".into()),
    }
}

/// A flag that the first Ctrl-C or SIGTERM sets; the second ends the process. SIGHUP is left alone, so that `nohup`
/// works.
fn stop_on_signal() -> std::io::Result<Arc<AtomicBool>> {
    let signals = [SIGINT, SIGTERM];
    let stop = Arc::new(AtomicBool::new(false));
    for signal in signals {
        // In this order, so that the first signal does not find the flag set.
        flag::register_conditional_shutdown(signal, 1, stop.clone())?;
        flag::register(signal, stop.clone())?;
    }
    #[cfg(unix)]
    {
        let mut signals = signal_hook::iterator::Signals::new(signals)?;
        std::thread::spawn(move || {
            if signals.forever().next().is_some() {
                eprintln!(
                    "stopping after this update; press Ctrl-C again to stop at once and lose what follows the last checkpoint"
                );
            }
        });
    }
    Ok(stop)
}
