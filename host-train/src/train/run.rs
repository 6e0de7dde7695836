//! A whole run: data, updates, validation, checkpoints.

use super::begin::{Begun, begin};
use super::config::TrainConfig;
use super::data::problems;
use super::error::TrainError;
use super::progress::{Display, EpochEnd, next_command, tell_size, update_line};
use super::state::checkpoint;
use super::validate::validate;
use crate::policy::checkpoint::BEST;
use reagent_core::cut::Cut;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

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
    let Some(begun) = begin(config, resume)? else {
        return Ok(());
    };
    let Begun {
        training,
        validation,
        mut trainer,
        mut progress,
        mut directory,
        total,
        locked: _locked,
    } = begun;

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
