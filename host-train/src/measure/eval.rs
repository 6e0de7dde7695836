//! Policies and baselines side by side on the same pairs: the paper's tables.
//!
//! As in the paper's experiments, clouds are not normalised. A policy decides as its file says, on core's kernels,
//! in the pipeline that `register` and robots run.

use super::method::{Contestant, Trajectory};
use super::metrics::{Errors, GroundTruth, PairMetrics, Summary, quantile};
use crate::dataset::pairs::PairSet;
use crate::register::{Memory, batch};
use reagent_core::{Error, Pose};
use serde::Serialize;

/// How to evaluate.
#[derive(Clone, Copy, Debug)]
pub struct EvalSettings {
    /// Refinement steps of a policy.
    pub steps: usize,
    /// Threads over pairs. Errors do not depend on it. Times are those of one registration on one thread,
    /// undisturbed only if this is 1.
    pub threads: usize,
    /// Whether to measure policies after every step.
    pub per_step: bool,
}

/// One row of a table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Errors over all pairs.
    #[serde(flatten)]
    pub summary: Summary,
    /// Median time of one registration, milliseconds; in a per-step row, from its start to that step.
    pub ms_median: f64,
    /// 95th percentile of the same.
    pub ms_p95: f64,
}

/// The row after a number of steps; step 0 is the initial pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StepRow {
    /// Steps taken.
    pub step: usize,
    /// Errors and times.
    #[serde(flatten)]
    pub row: Row,
}

/// The results of one contestant.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Its name.
    pub name: String,
    /// Its final poses, plain target_from_source, one a pair.
    pub target_from_source: Vec<Pose>,
    /// Its final errors and times.
    pub row: Row,
    /// Its final errors, pair by pair.
    pub errors: Errors,
    /// Probability that its final pose is right, pair by pair; empty for a method that gives none.
    pub probability: Vec<f32>,
    /// Its rows step by step, for a policy and if asked for.
    pub per_step: Vec<StepRow>,
}

/// Why an evaluation was refused.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// There is nothing to evaluate on.
    #[error("the set holds no pairs")]
    NoPairs,
    /// Two contestants would be reported under one name.
    #[error("two methods are called \"{0}\": rename one of the weight files")]
    SameName(String),
    /// A pair cannot be registered or measured.
    #[error("pair {index}")]
    Pair {
        /// Index of the pair in the set.
        index: usize,
        /// What is wrong with it.
        source: Error,
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

/// Registers every pair by every contestant and measures the results. `progress` is called once per registration.
///
/// # Errors
/// An empty set, two equal names, a pair with a cloud that the core or the metrics refuse.
pub fn evaluate(
    set: &PairSet,
    contestants: &[Contestant<'_>],
    settings: &EvalSettings,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<Outcome>, EvalError> {
    let pairs = set.source.len();
    if pairs == 0 {
        return Err(EvalError::NoPairs);
    }
    for (i, a) in contestants.iter().enumerate() {
        if contestants[..i].iter().any(|b| b.name == a.name) {
            return Err(EvalError::SameName(a.name.clone()));
        }
    }
    let pool = pool(settings.threads)?;

    let extent = (settings.steps, settings.per_step);
    let trajectories: Vec<Vec<Trajectory>> = contestants
        .iter()
        .map(|contestant| {
            for_each_pair(&pool, pairs, |memory, i| {
                let pair = [set.source[i].as_slice(), &set.target[i]];
                let method = &contestant.method;
                let found = method.register(pair, set.seen(i), i as u64, extent, memory);
                progress();
                found
            })
        })
        .collect::<Result<_, _>>()?;

    // One kd-tree and one diameter per pair serve all poses of all contestants.
    let measured: Vec<Vec<Vec<PairMetrics>>> = for_each_pair(&pool, pairs, |_, i| {
        let raw = set.raw.as_ref().map(|raw| raw[i].as_slice());
        let truth = GroundTruth::new(
            &set.source[i],
            &set.target[i],
            raw,
            set.target_from_source[i],
        )?;
        let truth = match &set.symmetries {
            Some(symmetries) => truth.with_symmetry(&symmetries[i])?,
            None => truth,
        };
        let measure = |t: &Trajectory| t.poses.iter().map(|&pose| truth.measure(pose)).collect();
        Ok(trajectories
            .iter()
            .map(|of_pairs| measure(&of_pairs[i]))
            .collect())
    })?;

    let outcome = |(c, contestant): (usize, &Contestant<'_>)| {
        let metrics_at = |step: usize| -> Vec<PairMetrics> {
            measured.iter().map(|pair| pair[c][step]).collect()
        };
        let row = |step: usize| {
            let ms: Vec<f64> = trajectories[c].iter().map(|t| t.ms[step]).collect();
            Row {
                summary: Summary::of(&metrics_at(step)),
                ms_median: quantile(ms.clone(), 0.5),
                ms_p95: quantile(ms, 0.95),
            }
        };
        // Every pair has the same number of poses: either one for each step, or the last alone.
        let last = trajectories[c][0].poses.len() - 1;
        let steps = if last > 0 { 0..last + 1 } else { 0..0 };
        Outcome {
            name: contestant.name.clone(),
            target_from_source: trajectories[c].iter().map(|t| t.poses[last]).collect(),
            row: row(last),
            errors: Errors::of(&metrics_at(last)),
            probability: trajectories[c]
                .iter()
                .filter_map(|t| t.probability)
                .collect(),
            per_step: steps
                .map(|step| StepRow {
                    step,
                    row: row(step),
                })
                .collect(),
        }
    };
    Ok(contestants.iter().enumerate().map(outcome).collect())
}

pub(super) fn pool(threads: usize) -> Result<rayon::ThreadPool, EvalError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|source| EvalError::Threads { threads, source })
}

/// Runs `f` for every pair on the pool, each thread with its own working memory. If several pairs fail, the one
/// with the lowest index is reported.
pub(super) fn for_each_pair<T: Send>(
    pool: &rayon::ThreadPool,
    pairs: usize,
    f: impl Fn(&mut Memory, usize) -> Result<T, Error> + Sync + Send,
) -> Result<Vec<T>, EvalError> {
    pool.install(|| batch::for_each(pairs, Memory::new, &f))
        .into_iter()
        .enumerate()
        .map(|(index, result)| result.map_err(|source| EvalError::Pair { index, source }))
        .collect()
}
