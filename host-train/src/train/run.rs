//! A whole run: data, updates, validation, checkpoints.

use super::config::TrainConfig;
use super::data::{TrainingData, fingerprint, load, problems};
use super::error::TrainError;
use super::progress::{Display, EpochEnd, update_line};
use super::record::{RunDirectory, RunRecord, lock};
use super::state::{checkpoint, start};
use super::validate::validate;
use crate::dataset::modelnet::FIRST_HALF;
use crate::dataset::pairs::PairSet;
use crate::policy::checkpoint::{BEST, Checkpoint, LAST, PREVIOUS, Progress};
use crate::words::count;
use reagent_core::cut::Cut;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Updates below which a policy hardly learns.
const FEW_UPDATES: u64 = 200;

/// Runs a stage of training to its end, or until `stop`. The table of [`super::record`] lists what it writes;
/// `after_epoch` is called whenever the log has gained an epoch.
///
/// # Errors
/// See [`TrainError`]; checkpoints written before stay.
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

/// Runs `work` on so many threads; 0 takes all cores.
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
    let is_free = || match !resume && kept.iter().any(|path| path.exists()) {
        true => Err(TrainError::Exists(config.out.clone())),
        false => Ok(()),
    };
    is_free()?;

    // Data, network and optimiser, a folder for the results.
    let (training, validation) = load(config)?;
    let before = match resume {
        true => Some(RunRecord::load(&config.out)?),
        false => None,
    };
    let _locked = lock(&config.out)?;
    // Another run may have ended here while the data was read.
    is_free()?;
    let record = RunRecord {
        version: env!("CARGO_PKG_VERSION").into(),
        data_sha256: fingerprint(&training),
        config: config.clone(),
    };
    let resumed = match resume {
        true => Checkpoint::load_newest(&config.out)?,
        false => None,
    };
    // A run that was stopped before its first checkpoint starts again.
    let done = resumed.as_ref().map_or(0, |c| c.progress.updates);
    let updates_before = resume.then_some(done);
    let total = config.updates(training.len());
    if let Some(before) = &before {
        before.check_resumed(&record)?;
        if total <= done && config.epochs < before.config.epochs {
            return Err(TrainError::Ended {
                path: config.out.clone(),
                done,
                epochs: config.epochs,
                total,
            });
        }
    }
    let (mut trainer, mut progress) = start(config, resumed)?;
    if resume && total <= done {
        eprintln!(
            "nothing left to do: all {} are done; more --epochs go on",
            count(total as usize, "update", "updates")
        );
        eprintln!("{}", next_command(config, &progress));
        return Ok(());
    }
    // Four vectors of a checkpoint, and an average; last, previous, best and one being written.
    let room = trainer.agent.parameters.values.len() * 4 * 5 * 4;
    let mut directory = RunDirectory::open(&record, updates_before, room)?;

    let epoch_of = |update: u64| config.epoch_of(update, training.len());
    tell_size(config, &training, &validation, total);
    let mut display = Display::start(config, total, trainer.updates);
    let mut saved = Instant::now();
    let mut next = problems(config, &training, trainer.updates)?;

    while trainer.updates < total && !stop.load(Ordering::Relaxed) {
        let update = trainer.updates;
        let epoch = epoch_of(update);
        let rate = config.learning_rate.at(epoch, update as f32 / total as f32);

        // Algorithm 1 of the paper: roll-outs, rewards, returns and advantages, mini-batches. The next update's
        // clouds are drawn meanwhile.
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
        stats.add_to(&mut progress.epoch);
        directory.log(&update_line(update, epoch, rate, &stats))?;
        display.update(trainer.updates, &stats);

        // The end of an epoch: validation, and the best network so far.
        if epoch_of(trainer.updates) > epoch || trainer.updates == total {
            let samples_per_s = display.samples_per_s(trainer.updates);
            let errors = validate(config, trainer.result(), &validation)?;
            // A cut source is not near the target even in place, so its Chamfer distance says nothing.
            let error = match config.sight.cut {
                Cut::NONE => errors.chamfer_mod,
                _ => 100.0 - errors.adi_auc_pct,
            };
            let improved = progress.best.is_none_or(|(lowest, _)| error < lowest);
            if improved {
                progress.best = Some((error, epoch));
            }
            let end = EpochEnd {
                epoch,
                updates: trainer.updates,
                rate,
                sums: std::mem::take(&mut progress.epoch),
                samples_per_s,
                errors: &errors,
                improved,
            };
            directory.log(&end.line())?;
            let state = checkpoint(config, &trainer, &progress);
            if improved {
                state.save(&config.out.join(BEST))?;
            }
            state.save_newest(&config.out)?;
            saved = Instant::now();
            display.epoch(&end);
            after_epoch(&config.out);
            display.next_epoch(trainer.updates);
        } else if saved.elapsed().as_secs_f64() >= 60.0 * config.checkpoint_minutes {
            checkpoint(config, &trainer, &progress).save_newest(&config.out)?;
            saved = Instant::now();
        }
    }

    display.end();
    if trainer.updates == total {
        eprintln!("{}", next_command(config, &progress));
    } else {
        checkpoint(config, &trainer, &progress).save_newest(&config.out)?;
        eprintln!(
            "stopped after update {} of {total}; go on with --resume",
            trainer.updates
        );
    }
    Ok(())
}

/// Says what a run consists of, and what is unusual about it.
fn tell_size(config: &TrainConfig, training: &TrainingData, validation: &PairSet, total: u64) {
    let of = |number: u64, one, several| count(number as usize, one, several);
    let clouds = training.len() as u64;
    eprintln!(
        "training on {}, validating on {} drawn from {} more, {} of {}, kernels {}",
        of(clouds, "cloud", "clouds"),
        count(validation.source.len(), "pair", "pairs"),
        training.held_back,
        of(total, "update", "updates"),
        count(
            config.roll_out.observations(),
            "observation",
            "observations"
        ),
        reagent_core::kernels::Isa::best().name()
    );
    if training.categories_left_out > 0 {
        let left_out = count(training.categories_left_out, "category", "categories");
        let trained = FIRST_HALF.end;
        eprintln!("{left_out} left out: training takes the first {trained} (--categories all)");
    }
    if total < FEW_UPDATES {
        let epochs = (FEW_UPDATES * config.roll_out.problems as u64).div_ceil(clouds);
        eprintln!(
            "{} will teach little: with --epochs {epochs} there are {FEW_UPDATES}, and thousands teach more",
            of(total, "update", "updates")
        );
    }
}

/// The best epoch so far, and what to do with it.
fn next_command(config: &TrainConfig, progress: &Progress) -> String {
    let run = config.out.display();
    let best = match progress.best {
        Some((_, epoch)) => format!("epoch {epoch} was best on validation"),
        None => "no epoch was validated".into(),
    };
    match config.deployable() {
        true => format!("{best}: host-train export --run {run} --out {run}.rgw"),
        false => format!("{best}: host-train eval --weights {run}"),
    }
}
