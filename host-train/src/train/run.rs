//! A whole run: data, updates, validation, checkpoints.

use super::config::{Stage, TrainConfig};
use super::data::{clouds, problems};
use super::trainer::Trainer;
use crate::checkpoint::{BEST, Checkpoint, CheckpointError, LAST, Progress};
use crate::dataset::DatasetError;
use crate::dataset::pairs::PairSet;
use crate::dataset::pairs::Sample;
use crate::env::Problem;
use crate::eval::{Contestant, EvalError, EvalSettings, Method, evaluate};
use crate::export::{ExportError, WeightFile};
use crate::files::write_atomically;
use crate::metrics::Summary;
use crate::nn::{Parameters, Shape};
use crate::optim::Adam;
use crate::random::{Purpose, Rng, stream};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use serde_json::json;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Why a run stopped or did not start.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The clouds could not be read.
    #[error(transparent)]
    Data(#[from] DatasetError),
    /// There are too few clouds.
    #[error(
        "{0} training clouds are too few: give at least 3, of which one is held back for validation"
    )]
    TooFewClouds(usize),
    /// The run directory cannot be used.
    #[error("cannot write to run directory {path}")]
    Directory {
        /// The directory, or a file in it.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A run is in the directory already.
    #[error("{0} holds a run already: give --resume to go on with it, or another --out")]
    Exists(PathBuf),
    /// A checkpoint could not be read or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The initial policy could not be read.
    #[error(transparent)]
    Policy(#[from] ExportError),
    /// Validation failed.
    #[error("validation failed")]
    Validation(#[from] EvalError),
    /// The loss is no number any more.
    #[error(
        "the loss of update {update} is {loss}: lower the learning rate; the last checkpoint is whole"
    )]
    NotFinite {
        /// The update.
        update: u64,
        /// Its loss.
        loss: f64,
    },
    /// The threads could not be started.
    #[error("cannot start {threads} threads")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// What the system said.
        source: rayon::ThreadPoolBuildError,
    },
}

/// Runs a stage of training to its end, or to `stop`. Writes `config.json`, `metrics.jsonl`,
/// `last.safetensors` and `best/` into the run directory.
///
/// # Errors
/// See [`TrainError`]; what was checkpointed before stays.
pub fn run(config: &TrainConfig, resume: bool, stop: &AtomicBool) -> Result<(), TrainError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(config.threads)
        .build()
        .map_err(|source| TrainError::Threads {
            threads: config.threads,
            source,
        })?;
    pool.install(|| run_here(config, resume, stop))
}

fn run_here(config: &TrainConfig, resume: bool, stop: &AtomicBool) -> Result<(), TrainError> {
    let directory = |source| TrainError::Directory {
        path: config.out.clone(),
        source,
    };
    let last = config.out.join(LAST);
    if last.exists() && !resume {
        return Err(TrainError::Exists(config.out.clone()));
    }
    std::fs::create_dir_all(config.out.join("best")).map_err(directory)?;
    let text = serde_json::to_string_pretty(config).map_err(|e| directory(e.into()))?;
    write_atomically(&config.out.join("config.json"), text.as_bytes()).map_err(directory)?;
    let mut log = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(config.out.join("metrics.jsonl"))
        .map_err(directory)?;

    let (training, validation) = clouds(config)?;
    let (mut trainer, mut best) = start(config, resume && last.exists())?;
    let observations = config.roll_out.observations();
    let epoch_of = |update: u64| update * config.roll_out.problems as u64 / training.len() as u64;
    let total = (u64::from(config.epochs) * training.len() as u64)
        .div_ceil(config.roll_out.problems as u64);
    eprintln!(
        "training on {} clouds, validating on {}, {total} updates of {observations} observations, kernels {}",
        training.len(),
        validation.source.len(),
        reagent_core::kernels::Isa::best().name()
    );

    let bar = progress_bar(total - trainer.updates.min(total));
    let (mut epoch_loss, mut epoch_agreement, mut epoch_updates) = (0.0, 0.0, 0u32);
    let mut clock = Instant::now();
    while trainer.updates < total && !stop.load(Ordering::Relaxed) {
        let update = trainer.updates;
        let epoch = epoch_of(update) as u32;
        let learning_rate = config.schedule.rate(epoch);
        let problems = problems(config, &training, update);
        let stats = trainer.update(problems, learning_rate);
        finite(update, stats.loss)?;
        epoch_loss += stats.loss;
        epoch_agreement += stats.agreement;
        epoch_updates += 1;
        bar.inc(1);
        bar.set_message(format!("loss {:.3}", stats.loss));
        writeln!(
            log,
            "{}",
            json!({"update": update, "epoch": epoch, "lr": learning_rate, "loss": stats.loss, "agreement": stats.agreement})
        )
        .map_err(directory)?;

        if epoch_of(trainer.updates) as u32 > epoch || trainer.updates == total {
            let seconds = clock.elapsed().as_secs_f64();
            let rate = (epoch_updates as usize * observations) as f64 / seconds;
            let n = f64::from(epoch_updates);
            let errors = validate(&trainer.parameters, &validation)?;
            let line = json!({
                "epoch": epoch, "updates": trainer.updates, "loss": epoch_loss / n,
                "agreement": epoch_agreement / n, "samples_per_s": rate, "validation": errors,
            });
            writeln!(log, "{line}").map_err(directory)?;
            let improved = best.is_none_or(|(lowest, _)| errors.chamfer_mod < lowest);
            if improved {
                best = Some((errors.chamfer_mod, epoch));
            }
            let state = checkpoint(&trainer, best);
            if improved {
                state.save(&config.out.join(BEST))?;
            }
            state.save(&last)?;
            let report = format!(
                "epoch {epoch:3}  lr {learning_rate:.1e}  loss {:.3}  agreement {:.1} %  {rate:.0} samples/s  validation: ISO R {:.2} deg, median {:.2}, ISO t {:.4}, recall {:.0} %, modified CD {:.2e}{}",
                epoch_loss / n,
                100.0 * epoch_agreement / n,
                errors.r_iso_deg,
                errors.r_iso_median_deg,
                errors.t_iso,
                100.0 * errors.recall_r5_t005,
                errors.chamfer_mod,
                if improved { "  (best)" } else { "" },
            );
            if bar.is_hidden() {
                eprintln!("{report}");
            } else {
                bar.println(report);
            }
            (epoch_loss, epoch_agreement, epoch_updates) = (0.0, 0.0, 0);
            clock = Instant::now();
        }
    }
    bar.finish_and_clear();
    if trainer.updates < total {
        checkpoint(&trainer, best).save(&last)?;
        eprintln!(
            "stopped after update {} of {total}; go on with --resume",
            trainer.updates
        );
    }
    Ok(())
}

/// Trains a policy on with imitation until the time is up, and returns the new policy. Sample number `i`
/// is drawn by `sample` from a stream of its own; `progress` is told the updates done and the loss.
///
/// # Errors
/// [`TrainError::NotFinite`] or [`TrainError::Policy`].
pub fn fine_tune(
    start: &WeightFile,
    sample: impl Fn(&mut Rng, u64) -> Sample + Sync,
    budget: Duration,
    seed: u64,
    mut progress: impl FnMut(u64, f64),
) -> Result<WeightFile, TrainError> {
    let mut config = TrainConfig::new(Stage::Il, Vec::new(), PathBuf::new());
    config.seed = seed;
    // A short run: smaller buffers give more frequent, fresher ones, and the rate falls to zero with
    // the time that is left.
    config.roll_out.problems = 16;
    config.roll_out.trajectories = 2;
    let parameters = start.parameters(seed)?;
    let adam = Adam::new(parameters.values.len());
    let mut trainer = Trainer::new(parameters, adam, 0, seed, config.roll_out, config.expert);
    let batch = config.roll_out.problems as u64;
    let clock = Instant::now();
    loop {
        let spent = clock.elapsed().as_secs_f32() / budget.as_secs_f32().max(1e-3);
        if spent >= 1.0 {
            break;
        }
        let update = trainer.updates;
        let problems = (update * batch..(update + 1) * batch)
            .into_par_iter()
            .map(|i| Problem::from(sample(&mut stream(seed, Purpose::Augment, i), i)))
            .collect();
        let stats = trainer.update(problems, config.schedule.initial * (1.0 - spent));
        finite(update, stats.loss)?;
        progress(trainer.updates, stats.loss);
    }
    Ok(WeightFile::from_parameters(&trainer.parameters)?)
}

/// Refuses a loss that is no number.
fn finite(update: u64, loss: f64) -> Result<(), TrainError> {
    if loss.is_finite() {
        Ok(())
    } else {
        Err(TrainError::NotFinite { update, loss })
    }
}

/// The trainer at the start of a run, or where it was left; and the best validation error so far.
fn start(config: &TrainConfig, resume: bool) -> Result<(Trainer, Option<(f64, u32)>), TrainError> {
    let (parameters, adam, progress) = if resume {
        let checkpoint = Checkpoint::load(&config.out.join(LAST))?;
        (checkpoint.parameters, checkpoint.adam, checkpoint.progress)
    } else {
        let parameters = match &config.init {
            None => Parameters::random(Shape::PAPER, config.seed),
            Some(path) if path.extension().is_some_and(|e| e == "rgw") => {
                WeightFile::load(path)?.parameters(config.seed)?
            }
            Some(path) => Checkpoint::load(&Checkpoint::find(path)?)?.parameters,
        };
        let adam = Adam::new(parameters.values.len());
        (parameters, adam, Progress::default())
    };
    let trainer = Trainer::new(
        parameters,
        adam,
        progress.updates,
        config.seed,
        config.roll_out,
        config.expert,
    );
    Ok((trainer, progress.best))
}

fn checkpoint(trainer: &Trainer, best: Option<(f64, u32)>) -> Checkpoint {
    Checkpoint {
        parameters: trainer.parameters.clone(),
        adam: trainer.adam.clone(),
        progress: Progress {
            updates: trainer.updates,
            optimiser_steps: trainer.adam.steps,
            best,
        },
    }
}

/// Errors of the arg-max policy on the validation pairs.
fn validate(parameters: &Parameters, pairs: &PairSet) -> Result<Summary, TrainError> {
    let file = WeightFile::from_parameters(parameters)?;
    let contestant = Contestant {
        name: "policy".into(),
        method: Method::Policy(file.policy()),
    };
    let settings = EvalSettings {
        steps: reagent_core::dims::STEPS,
        threads: rayon::current_num_threads(),
        per_step: false,
    };
    let outcomes = evaluate(pairs, &[contestant], &settings, &|| {})?;
    Ok(outcomes[0].row.summary)
}

/// A bar on a terminal, nothing otherwise.
fn progress_bar(updates: u64) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} updates  {msg}  eta {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(updates).with_style(style)
}
