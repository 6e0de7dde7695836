//! What a run reports: a line of JSON for each update and epoch, and a bar or a line on the terminal.

use super::config::TrainConfig;
use super::data::TrainingData;
use super::stats::UpdateStats;
use crate::dataset::modelnet::FIRST_HALF;
use crate::dataset::pairs::PairSet;
use crate::measure::metrics::Summary;
use crate::policy::checkpoint::{EpochSums, Progress};
use crate::words::count;
use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Updates below which a policy hardly learns.
const FEW_UPDATES: u64 = 200;

/// The line for an update.
pub(super) fn update_line(update: u64, epoch: u32, rate: f32, stats: &UpdateStats) -> Value {
    let mut line = json!({"update": update, "epoch": epoch, "lr": rate});
    merge(&mut line, json!(stats));
    line
}

/// An epoch at its end.
pub(super) struct EpochEnd<'a> {
    /// Number of the epoch, from 0.
    pub(super) epoch: u32,
    /// Updates done since the start of the run.
    pub(super) updates: u64,
    /// The learning rate.
    pub(super) rate: f32,
    /// Sums over the epoch's updates.
    pub(super) sums: EpochSums,
    /// Speed, observations per second.
    pub(super) samples_per_s: f64,
    /// Errors on the validation pairs.
    pub(super) errors: &'a Summary,
    /// Whether they are the lowest so far.
    pub(super) improved: bool,
}

impl EpochEnd<'_> {
    /// The line for the epoch.
    pub(super) fn line(&self) -> Value {
        let n = f64::from(self.sums.updates);
        let mut line = json!({
            "epoch": self.epoch, "updates": self.updates, "lr": self.rate, "loss": self.sums.loss / n,
            "agreement": self.sums.agreement / n, "samples_per_s": self.samples_per_s,
            "validation": self.errors, "best": self.improved,
        });
        if let Some(reward) = self.sums.reward {
            merge(&mut line, json!({"reward": reward / n}));
        }
        line
    }

    /// The epoch's line for people, with the time that the observations left will take.
    fn text(&self, observations_left: f64) -> String {
        let n = f64::from(self.sums.updates);
        let reward = self.sums.reward.map(|r| format!("  reward {:.3}", r / n));
        let (rate, pace, errors) = (self.rate, self.samples_per_s, self.errors);
        let left = Duration::from_secs_f64((observations_left / pace).max(0.0));
        format!(
            "epoch {:3}  lr {rate:.1e}  loss {:.3}  agreement {:.1} %{}  {pace:.0} samples/s, {} left  validation: ISO R {:.2} deg, median {:.2}, ISO t {:.4}, recall {:.0} %, modified CD {:.2e}{}",
            self.epoch,
            self.sums.loss / n,
            100.0 * self.sums.agreement / n,
            reward.unwrap_or_default(),
            HumanDuration(left),
            errors.r_iso_deg,
            errors.r_iso_median_deg,
            errors.t_iso,
            100.0 * errors.recall_r5_t005,
            errors.chamfer_mod,
            if self.improved { "  (best)" } else { "" },
        )
    }
}

/// Adds the fields of one object to another.
fn merge(line: &mut Value, more: Value) {
    if let (Some(line), Value::Object(more)) = (line.as_object_mut(), more) {
        line.extend(more);
    }
}

/// A bar on a terminal, else a line at the end of each epoch.
pub(super) struct Display {
    bar: ProgressBar,
    observations: usize,
    total: u64,
    /// When the epoch, or this process, began, and how many updates had been done then.
    since: (Instant, u64),
}

impl Display {
    /// Starts the display of `total` updates, of which `done` are done.
    pub(super) fn start(config: &TrainConfig, total: u64, done: u64) -> Self {
        let bar = if std::io::stderr().is_terminal() {
            let template = "{bar:30} {pos}/{len} updates  {msg}  eta {eta}";
            let style = ProgressStyle::with_template(template)
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(total).with_style(style)
        } else {
            ProgressBar::hidden()
        };
        let bar = bar.with_position(done);
        bar.reset_eta();
        Display {
            bar,
            observations: config.roll_out.observations(),
            total,
            since: (Instant::now(), done),
        }
    }

    /// Observations per second since the epoch began.
    pub(super) fn samples_per_s(&self, updates: u64) -> f64 {
        let (began, before) = self.since;
        (updates - before) as f64 * self.observations as f64 / began.elapsed().as_secs_f64()
    }

    /// Shows an update.
    pub(super) fn update(&self, updates: u64, stats: &UpdateStats) {
        let pace = self.samples_per_s(updates);
        self.bar.inc(1);
        self.bar
            .set_message(format!("loss {:.3}  {pace:.0} samples/s", stats.loss));
    }

    /// Reports the end of an epoch.
    pub(super) fn epoch(&self, end: &EpochEnd<'_>) {
        let left = (self.total - end.updates) as f64 * self.observations as f64;
        if self.bar.is_hidden() {
            eprintln!("{}", end.text(left));
        } else {
            self.bar.println(end.text(left));
        }
    }

    /// Starts the clock of the next epoch, after so many updates.
    pub(super) fn next_epoch(&mut self, updates: u64) {
        self.since = (Instant::now(), updates);
    }

    /// Removes the bar.
    pub(super) fn end(self) {
        self.bar.finish_and_clear();
    }
}

/// Says what a run consists of, and what is unusual about it.
pub(super) fn tell_size(
    config: &TrainConfig,
    training: &TrainingData,
    validation: &PairSet,
    total: u64,
) {
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
pub(super) fn next_command(config: &TrainConfig, progress: &Progress) -> String {
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
