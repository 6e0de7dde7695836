//! How far two policies act alike: the step-by-step effect of a smaller number format or of another file.

use super::eval::{EvalError, EvalSettings, for_each_pair, pool};
use super::method::{Contestant, Finish, Method, Start};
use crate::dataset::Point;
use crate::dataset::pairs::PairSet;
use crate::register::Memory;
use reagent_core::dims::AXES;
use reagent_core::net::Scratch;
use reagent_core::{Action, Error, Frame, Policy, Pose, Registrar};
use serde::Serialize;
use std::collections::BTreeMap;

/// How often a policy acts as another one does in the states that the other reaches.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// The policy whose poses both start each step from.
    pub along: String,
    /// Share of axes (six a pair) on which the actions are equal, for each step.
    pub equal: Vec<f64>,
}

/// Compares the actions of every policy after the first with those of the first. Each step starts from the pose that
/// the first has reached, so that a difference is not counted again for what it leads to. Other methods are skipped.
///
/// # Errors
/// A pair with a cloud that the core refuses.
pub fn agreement(
    set: &PairSet,
    contestants: &[Contestant<'_>],
    settings: &EvalSettings,
) -> Result<BTreeMap<String, Agreement>, EvalError> {
    let policies: Vec<(&str, Policy<'_>)> = contestants
        .iter()
        .filter_map(|c| match c.method {
            Method {
                start: Start::Policy(policy),
                finish: Finish::Nothing,
            } => Some((c.name.as_str(), policy)),
            _ => None,
        })
        .collect();
    let [(along, first), others @ ..] = policies.as_slice() else {
        return Ok(BTreeMap::new());
    };
    let pool = pool(settings.threads)?;
    let pairs = set.source.len();
    let compare = |&(name, policy): &(&str, Policy<'_>)| {
        let counts = for_each_pair(&pool, pairs, |memory, i| {
            let (source, target) = (&set.source[i], &set.target[i]);
            equal_axes([*first, policy], source, target, settings.steps, memory)
        })?;
        let share = |step: usize| {
            let equal: usize = counts.iter().map(|of_pair| of_pair[step]).sum();
            equal as f64 / (2 * AXES * pairs) as f64
        };
        let agreement = Agreement {
            along: (*along).into(),
            equal: (0..settings.steps).map(share).collect(),
        };
        Ok((name.to_owned(), agreement))
    };
    others.iter().map(compare).collect()
}

/// Number of axes on which two policies act equally, for each step from the poses that the first one reaches.
fn equal_axes(
    [first, second]: [Policy<'_>; 2],
    source: &[Point],
    target: &[Point],
    steps: usize,
    memory: &mut Memory,
) -> Result<Vec<usize>, Error> {
    let mut scratch = Box::new(Scratch::new());
    let mut leader = Registrar::new(first, &mut memory.scratch);
    let mut follower = Registrar::new(second, &mut scratch);
    let mut led = leader.start(source, target, Frame::IDENTITY, Pose::IDENTITY)?;
    let mut seen = follower.start(source, target, Frame::IDENTITY, Pose::IDENTITY)?;
    let equal = (0..steps).map(|_| {
        seen.copy_progress_from(&led);
        let axes = |action: Action| action.translation.into_iter().chain(action.rotation);
        let a = axes(leader.step(&mut led)?.action);
        let b = axes(follower.step(&mut seen)?.action);
        Ok(a.zip(b).filter(|(a, b)| a == b).count())
    });
    equal.collect()
}
