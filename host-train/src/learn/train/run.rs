//! A whole run: data, updates, validation, checkpoints.

use super::config::TrainConfig;
use super::data::{fingerprint, load, problems};
use super::record::{RunDirectory, RunRecord};
use super::trainer::{Diverged, Trainer};
use super::validate::validate;
use crate::dataset::DatasetError;
use crate::dataset::bop::BopError;
use crate::eval::EvalError;
use crate::learn::env::Accumulation;
use crate::learn::nn::{Parameters, Shape};
use crate::measure::metrics::Summary;
use crate::policy::checkpoint::{
    BEST, Checkpoint, CheckpointError, EpochSums, LAST, PREVIOUS, Progress,
};
use crate::policy::{ExportError, WeightFile};
use indicatif::{ProgressBar, ProgressStyle};
use reagent_core::cut::Cut;
use serde_json::json;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Why a run stopped or did not start.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The clouds could not be read.
    #[error(transparent)]
    Data(#[from] DatasetError),
    /// Depth images, annotations or models in BOP layout could not be read.
    #[error(transparent)]
    Bop(#[from] BopError),
    /// There are too few clouds.
    #[error(
        "{0} training clouds are too few: give at least 3, of which one is held back for validation"
    )]
    TooFewClouds(usize),
    /// No mesh can be seen.
    #[error("nothing is seen of any of the meshes: they are too thin to be rendered")]
    NothingSeen,
    /// Options that contradict each other.
    #[error("{0}")]
    Contradiction(&'static str),
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
    /// There is no run to resume, or its record is unreadable.
    #[error("no run to resume: {path}: {what}")]
    Record {
        /// The record.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A run cannot be resumed as another one.
    #[error(
        "{path} holds another run: {differences}; leave these options out, or give another --out"
    )]
    Incompatible {
        /// The run directory.
        path: PathBuf,
        /// What differs.
        differences: String,
    },
    /// The initial network has other widths.
    #[error(
        "{path} is a network of {found:?}, the run's is {wanted:?}: give the --shape that it was trained with"
    )]
    Shape {
        /// Where the initial network came from.
        path: PathBuf,
        /// Its widths.
        found: Shape,
        /// The run's.
        wanted: Shape,
    },
    /// The initial network was trained under another accumulation.
    #[error(
        "{path} was trained with {found:?} accumulation, this run has {wanted:?}: give the --accumulation that it was trained with"
    )]
    Accumulation {
        /// Where the initial network came from.
        path: PathBuf,
        /// Its accumulation.
        found: Accumulation,
        /// The run's.
        wanted: Accumulation,
    },
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
        "update {update} diverged in mini-batch {mini_batch}: loss {loss}, gradient norm {gradient_norm}; lower the learning rate or give --clip-gradient{}",
        .saved.as_ref().map(|path| format!("; the mini-batch and the state before it are in {}", path.display())).unwrap_or_default()
    )]
    Diverged {
        /// The update.
        update: u64,
        /// The mini-batch of the update.
        mini_batch: usize,
        /// Its loss.
        loss: f64,
        /// Length of its gradient.
        gradient_norm: f64,
        /// Where it was saved.
        saved: Option<PathBuf>,
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

impl TrainError {
    pub(super) fn diverged(update: u64, what: &Diverged, saved: Option<PathBuf>) -> Self {
        TrainError::Diverged {
            update,
            mini_batch: what.mini_batch,
            loss: what.losses.total,
            gradient_norm: what.gradient_norm,
            saved,
        }
    }
}

/// Runs a stage of training to its end, or to `stop`. What it writes is in the table of
/// [`super::record`]; `after_epoch` is called when the log has an epoch more.
///
/// # Errors
/// See [`TrainError`]; what was checkpointed before stays.
pub fn run(
    config: &TrainConfig,
    resume: bool,
    stop: &AtomicBool,
    after_epoch: &(dyn Fn(&Path) + Sync),
) -> Result<(), TrainError> {
    on_threads(config.threads, || {
        run_here(config, resume, stop, after_epoch)
    })
}

/// Works on so many threads; 0 takes all cores.
pub(super) fn on_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> Result<T, TrainError> + Send,
) -> Result<T, TrainError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|source| TrainError::Threads { threads, source })?;
    pool.install(work)
}

fn run_here(
    config: &TrainConfig,
    resume: bool,
    stop: &AtomicBool,
    after_epoch: &(dyn Fn(&Path) + Sync),
) -> Result<(), TrainError> {
    config.check()?;
    let kept = [LAST, PREVIOUS].map(|name| config.out.join(name));
    if !resume && kept.iter().any(|path| path.exists()) {
        return Err(TrainError::Exists(config.out.clone()));
    }
    let (training, validation) = load(config)?;
    let record = RunRecord {
        version: env!("CARGO_PKG_VERSION").into(),
        data_sha256: fingerprint(&training),
        config: config.clone(),
    };
    let resumed = if resume {
        Checkpoint::load_newest(&config.out)?
    } else {
        None
    };
    // A run that was stopped before its first checkpoint starts again.
    let done = resumed.as_ref().map_or(0, |c| c.progress.updates);
    let updates_before = resume.then_some(done);
    let (mut trainer, mut progress) = start(config, resumed)?;
    // Four vectors of a checkpoint, and an average; last, previous, best and one being written.
    let room = trainer.agent.parameters.values.len() * 4 * 5 * 4;
    let mut directory = RunDirectory::open(&record, updates_before, room)?;

    let observations = config.roll_out.observations();
    let total = config.updates(training.len());
    let epoch_of = |update: u64| config.epoch_of(update, training.len());
    eprintln!(
        "training on {} clouds, validating on {}, {total} updates of {observations} observations, kernels {}",
        training.len(),
        validation.source.len(),
        reagent_core::kernels::Isa::best().name()
    );

    let bar = progress_bar(total, trainer.updates);
    let mut epoch_clock = Pace::start(trainer.updates);
    let mut saved = Instant::now();
    let mut next = problems(config, &training, trainer.updates)?;
    while trainer.updates < total && !stop.load(Ordering::Relaxed) {
        let update = trainer.updates;
        let epoch = epoch_of(update);
        let rate = config.learning_rate.at(epoch, update as f32 / total as f32);
        // The next update's clouds are drawn while this one is worked on.
        let now = std::mem::take(&mut next);
        let (result, prepared) = rayon::join(
            || trainer.update(now, rate),
            || problems(config, &training, update + 1),
        );
        next = prepared?;
        let stats = match result {
            Ok(stats) => stats,
            Err(diverged) => {
                let saved = directory.save_diverged(update, &diverged)?;
                checkpoint(config, &trainer, &progress)
                    .save(&config.out.join("diverged.safetensors"))?;
                return Err(TrainError::diverged(update, &diverged, Some(saved)));
            }
        };
        let sums = &mut progress.epoch;
        sums.updates += 1;
        sums.loss += stats.loss;
        sums.agreement += stats.agreement;
        if let Some(reward) = stats.reward {
            *sums.reward.get_or_insert_default() += reward;
        }
        let mut line = json!({"update": update, "epoch": epoch, "lr": rate});
        merge(&mut line, json!(stats));
        directory.log(&line)?;
        let pace = epoch_clock.samples_per_s(trainer.updates, observations);
        bar.inc(1);
        bar.set_message(format!("loss {:.3}  {pace:.0} samples/s", stats.loss));

        if epoch_of(trainer.updates) > epoch || trainer.updates == total {
            let errors = validate(config, trainer.result(), &validation)?;
            // A source of which a part is cut off is not near the target even where it belongs.
            let error = match config.cut {
                Cut::NONE => errors.chamfer_mod,
                _ => 100.0 - errors.adi_auc_pct,
            };
            let improved = progress.best.is_none_or(|(lowest, _)| error < lowest);
            if improved {
                progress.best = Some((error, epoch));
            }
            let sums = std::mem::take(&mut progress.epoch);
            let n = f64::from(sums.updates);
            let mut line = json!({
                "epoch": epoch, "updates": trainer.updates, "lr": rate, "loss": sums.loss / n,
                "agreement": sums.agreement / n, "samples_per_s": pace, "validation": errors,
                "best": improved,
            });
            if let Some(reward) = sums.reward {
                merge(&mut line, json!({"reward": reward / n}));
            }
            directory.log(&line)?;
            let state = checkpoint(config, &trainer, &progress);
            if improved {
                state.save(&config.out.join(BEST))?;
            }
            state.save_newest(&config.out)?;
            saved = Instant::now();
            let left = (total - trainer.updates) as f64 * observations as f64 / pace;
            let report = report(epoch, rate, &sums, pace, left, &errors, improved);
            if bar.is_hidden() {
                eprintln!("{report}");
            } else {
                bar.println(report);
            }
            after_epoch(&config.out);
            epoch_clock = Pace::start(trainer.updates);
        } else if saved.elapsed().as_secs_f64() >= 60.0 * config.checkpoint_minutes {
            checkpoint(config, &trainer, &progress).save_newest(&config.out)?;
            saved = Instant::now();
        }
    }
    bar.finish_and_clear();
    if trainer.updates < total {
        checkpoint(config, &trainer, &progress).save_newest(&config.out)?;
        eprintln!(
            "stopped after update {} of {total}; go on with --resume",
            trainer.updates
        );
    }
    Ok(())
}

/// The trainer at the start of a run, or where it was left, and the progress made so far.
fn start(
    config: &TrainConfig,
    resumed: Option<Checkpoint>,
) -> Result<(Trainer, Progress), TrainError> {
    let wanted = config.network.shape();
    let accumulation = config.method.accumulation;
    let (checkpoint, path) = match (resumed, &config.init) {
        (Some(checkpoint), _) => (checkpoint, config.out.clone()),
        (None, None) => {
            let parameters = Parameters::random(wanted, config.seed);
            (
                Checkpoint::start(parameters, accumulation, config.cut),
                PathBuf::new(),
            )
        }
        (None, Some(path)) => {
            let (parameters, found) = if path.extension().is_some_and(|e| e == "rgw") {
                let parameters = WeightFile::load(path)?.parameters(config.seed)?;
                (parameters, Accumulation::Global)
            } else {
                let checkpoint = Checkpoint::load(&Checkpoint::find(path)?)?;
                let found = checkpoint.accumulation;
                (checkpoint.result(), found)
            };
            if found != accumulation {
                return Err(TrainError::Accumulation {
                    path: path.clone(),
                    found,
                    wanted: accumulation,
                });
            }
            (
                Checkpoint::start(parameters, accumulation, config.cut),
                path.clone(),
            )
        }
    };
    let found = checkpoint.parameters.shape;
    if found != wanted {
        return Err(TrainError::Shape {
            path,
            found,
            wanted,
        });
    }
    let Checkpoint {
        parameters,
        adam,
        averaged,
        accumulation: _,
        cut: _,
        progress,
    } = checkpoint;
    let mut trainer = Trainer::new(
        parameters,
        adam,
        progress.updates,
        config.seed,
        config.roll_out,
        config.method,
    );
    if averaged.is_some() {
        trainer.averaged = averaged;
    }
    Ok((trainer, progress))
}

fn checkpoint(config: &TrainConfig, trainer: &Trainer, progress: &Progress) -> Checkpoint {
    Checkpoint {
        parameters: trainer.agent.parameters.clone(),
        adam: trainer.adam.clone(),
        averaged: trainer.averaged.clone(),
        accumulation: config.method.accumulation,
        cut: config.cut,
        progress: Progress {
            updates: trainer.updates,
            optimiser_steps: trainer.adam.steps,
            ..progress.clone()
        },
    }
}

/// Adds the fields of one object to another.
fn merge(line: &mut serde_json::Value, more: serde_json::Value) {
    if let (Some(line), serde_json::Value::Object(more)) = (line.as_object_mut(), more) {
        line.extend(more);
    }
}

/// Speed since a moment.
struct Pace {
    since: Instant,
    update: u64,
}

impl Pace {
    fn start(update: u64) -> Self {
        Pace {
            since: Instant::now(),
            update,
        }
    }

    fn samples_per_s(&self, updates: u64, observations: usize) -> f64 {
        (updates - self.update) as f64 * observations as f64 / self.since.elapsed().as_secs_f64()
    }
}

/// One line on an epoch.
fn report(
    epoch: u32,
    rate: f32,
    sums: &EpochSums,
    pace: f64,
    left_s: f64,
    errors: &Summary,
    improved: bool,
) -> String {
    let n = f64::from(sums.updates);
    let reward = sums
        .reward
        .map(|r| format!("  reward {:.3}", r / n))
        .unwrap_or_default();
    format!(
        "epoch {epoch:3}  lr {rate:.1e}  loss {:.3}  agreement {:.1} %{reward}  {pace:.0} samples/s, {} left  validation: ISO R {:.2} deg, median {:.2}, ISO t {:.4}, recall {:.0} %, modified CD {:.2e}{}",
        sums.loss / n,
        100.0 * sums.agreement / n,
        indicatif::HumanDuration(Duration::from_secs_f64(left_s.max(0.0))),
        errors.r_iso_deg,
        errors.r_iso_median_deg,
        errors.t_iso,
        100.0 * errors.recall_r5_t005,
        errors.chamfer_mod,
        if improved { "  (best)" } else { "" },
    )
}

/// A bar on a terminal, nothing otherwise.
fn progress_bar(total: u64, done: u64) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} updates  {msg}  eta {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(total)
        .with_style(style)
        .with_position(done);
    bar.reset_eta();
    bar
}
