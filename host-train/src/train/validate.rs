//! Validation: the policy's errors on pairs of held-back meshes, with decisions made as exported policies make them.

use super::config::TrainConfig;
use super::error::TrainError;
use crate::dataset::pairs::PairSet;
use crate::learn::acting::poses_of;
use crate::learn::env::Problem;
use crate::learn::nn::Parameters;
use crate::measure::eval::{EvalError, EvalSettings, evaluate};
use crate::measure::method::{Contestant, Finish, Start};
use crate::measure::metrics::{GroundTruth, PairMetrics, Summary};
use crate::policy::WeightFile;
use rayon::prelude::*;
use reagent_core::{Decision, Pose};

/// Errors after the given number of steps, computed by the robot's code if it can run the policy, else by the
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

/// Errors of one pose for each pair.
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
