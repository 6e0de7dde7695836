//! Validation: the errors of the policy, deciding as exported ones do, on pairs of held-back meshes.

use super::config::TrainConfig;
use super::error::TrainError;
use super::roll_out::Agent;
use crate::dataset::pairs::PairSet;
use crate::learn::env::{Accumulation, Problem};
use crate::learn::nn::{Parameters, Search};
use crate::measure::eval::{EvalError, EvalSettings, evaluate};
use crate::measure::method::{Contestant, Finish, Start};
use crate::measure::metrics::{GroundTruth, PairMetrics, Summary};
use crate::policy::WeightFile;
use rayon::prelude::*;
use reagent_core::{Decision, Pose};

/// Pairs that are registered side by side.
const BATCH: usize = 128;

/// Errors after the given number of steps: on the robot's code where it can run the policy, else on the
/// trainer's.
pub(super) fn validate(
    config: &TrainConfig,
    parameters: Parameters,
    pairs: &PairSet,
) -> Result<Summary, TrainError> {
    if !config.deployable() {
        let accumulation = config.method.accumulation;
        let steps = config.roll_out.steps;
        let seen = |sample| Problem::seen(config.sight, sample);
        let problems: Vec<Problem> = pairs.samples().map(seen).collect();
        let rules = (accumulation, Decision::default());
        let poses = poses_of(parameters, rules, &problems, steps);
        return Ok(summary(pairs, |i| poses[i][steps])?);
    }
    let file = WeightFile::from_parameters(&parameters)?
        .deciding(Decision::default())
        .seeing(config.sight);
    let contestant = Contestant {
        name: "policy".into(),
        method: Start::Policy(file.policy()).then(Finish::Nothing),
    };
    let settings = EvalSettings {
        steps: reagent_core::dims::STEPS,
        threads: rayon::current_num_threads(),
        per_step: false,
    };
    let outcomes = evaluate(pairs, &[contestant], &settings, &|| {})?;
    Ok(outcomes[0].row.summary)
}

/// Registers problems by any network under any accumulation and decision, batched: for each its plain poses after 0
/// to `steps` steps.
pub fn poses_of(
    parameters: Parameters,
    (accumulation, decision): (Accumulation, Decision),
    problems: &[Problem],
    steps: usize,
) -> Vec<Vec<Pose>> {
    let mut agent = Agent::new(parameters, Search::F32);
    let mut found = Vec::with_capacity(problems.len());
    for problems in problems.chunks(BATCH) {
        agent.embed_targets(problems);
        let mut runs: Vec<usize> = (0..problems.len()).collect();
        let mut problems = problems.to_vec();
        let mut poses = vec![Pose::IDENTITY; problems.len()];
        let mut plain = vec![vec![Pose::IDENTITY]; problems.len()];
        for step in 0..steps {
            let so_far = (runs.as_mut_slice(), poses.as_slice());
            agent.refocus(&mut problems, accumulation, so_far, step);
            agent.act(&problems, accumulation, &runs, &poses);
            for (row, pose) in poses.iter_mut().enumerate() {
                *pose = accumulation.step(pose, agent.decide(row, decision));
                plain[row].push(accumulation.target_from_source(problems[row].centroid, pose));
            }
        }
        found.extend(plain);
    }
    found
}

/// Errors of one pose a pair.
pub(super) fn summary(
    pairs: &PairSet,
    pose: impl Fn(usize) -> Pose + Sync,
) -> Result<Summary, EvalError> {
    let measured: Vec<PairMetrics> = (0..pairs.source.len())
        .into_par_iter()
        .map(|index| {
            let raw = pairs.raw.as_ref().map(|raw| raw[index].as_slice());
            let truth = GroundTruth::new(
                &pairs.source[index],
                &pairs.target[index],
                raw,
                pairs.target_from_source[index],
            );
            let truth = truth.map_err(|source| EvalError::Pair { index, source })?;
            Ok(truth.measure(pose(index)))
        })
        .collect::<Result<_, EvalError>>()?;
    Ok(Summary::of(&measured))
}
