//! The agent at work: runs the network on batches of states and accumulates the poses that its decisions lead to.

use crate::learn::agent::{Features, Seen, embed};
use crate::learn::env::{Accumulation, Problem};
use crate::learn::heads::Activations;
use crate::learn::loss::{axes, log_sum_exp};
use crate::learn::nn::{PackedEmbedding, Parameters, Search};
use crate::learn::ppo::ALL_AXES;
use rayon::prelude::*;
use reagent_core::dims::STEP_SIZES;
use reagent_core::view::View;
use reagent_core::{Action, Decision, Pose};
use std::borrow::Cow;

/// Pairs that are registered in one batch.
const BATCH: usize = 128;

/// The network, and the memory in which it works on batches of states.
#[derive(Debug)]
pub struct Agent {
    /// The network.
    pub parameters: Parameters,
    pub(crate) packed: PackedEmbedding,
    pub(crate) sources: Features,
    targets: Features,
    pub(crate) activations: Activations,
}

impl Agent {
    /// An agent with these parameters that finds critical points in the given way.
    pub fn new(parameters: Parameters, search: Search) -> Self {
        Agent {
            packed: PackedEmbedding::with_search(&parameters, search),
            parameters,
            sources: Features::default(),
            targets: Features::default(),
            activations: Activations::default(),
        }
    }

    /// Embeds the targets that [`Agent::act`] refers to.
    pub(crate) fn embed_targets(&mut self, problems: &[Problem]) {
        let width = self.parameters.shape.features();
        let seen: Vec<Seen<'_>> = problems.iter().map(target).collect();
        embed(&self.packed, width, &seen, &mut self.targets);
    }

    /// Chooses the targets' points anew if the policy does so after `steps` steps
    /// ([`Sight::refocuses`](reagent_core::sight::Sight::refocuses)). Each run then gets a problem of its own,
    /// appended to `problems`.
    pub(crate) fn refocus(
        &mut self,
        problems: &mut Vec<Problem>,
        accumulation: Accumulation,
        (runs, poses): (&mut [usize], &[Pose]),
        steps: usize,
    ) {
        if steps == 0 || problems.first().is_none_or(|p| !p.sight.refocuses(steps)) {
            return;
        }
        let of_runs = runs.par_iter().zip(poses);
        let anew: Vec<Problem> = of_runs
            .map(|(&run, pose)| problems[run].refocused(accumulation, pose))
            .collect();
        for (i, run) in runs.iter_mut().enumerate() {
            *run = problems.len() + i;
        }
        let width = self.parameters.shape.features();
        let seen: Vec<Seen<'_>> = anew.iter().map(target).collect();
        let mut features = Features::default();
        embed(&self.packed, width, &seen, &mut features);
        self.targets.extend(&features);
        problems.extend(anew);
    }

    /// Evaluates both policy heads for the source of problem `runs[i]` under `poses[i]`.
    pub(crate) fn act(
        &mut self,
        problems: &[Problem],
        accumulation: Accumulation,
        runs: &[usize],
        poses: &[Pose],
    ) {
        let width = self.parameters.shape.features();
        let seen: Vec<Seen<'_>> = runs
            .iter()
            .zip(poses)
            .map(|(&problem, pose)| source(&problems[problem], accumulation, pose))
            .collect();
        embed(&self.packed, width, &seen, &mut self.sources);
        let rows: Vec<usize> = (0..runs.len()).collect();
        self.activations.forward(
            &self.parameters,
            (&self.sources, &rows),
            (&self.targets, runs),
        );
    }

    /// The action that follows from the logits in state `row` of the batch.
    pub(crate) fn decide(&self, row: usize, decision: Decision) -> Action {
        self.choose(row, |logits| usize::from(decision.step(&logits)))
    }

    /// Chooses a step on every axis from its logits.
    pub(crate) fn choose(
        &self,
        row: usize,
        mut pick: impl FnMut([f32; STEP_SIZES]) -> usize,
    ) -> Action {
        let [translation, rotation] = [0, 1]
            .map(|head| std::array::from_fn(|axis| pick(self.axis_logits(head, axis, row)) as u8));
        Action {
            translation,
            rotation,
        }
    }

    fn axis_logits(&self, head: usize, axis: usize, row: usize) -> [f32; STEP_SIZES] {
        let logits = &self.activations.heads[head].logits;
        let batch = self.activations.batch;
        std::array::from_fn(|i| logits[(axis * STEP_SIZES + i) * batch + row])
    }

    /// Log-probability of an action in state `row`, for each axis.
    pub(crate) fn log_probability(&self, row: usize, action: &Action) -> [f32; ALL_AXES] {
        let ids = axes(action);
        std::array::from_fn(|all| {
            let logits = self.axis_logits(all / 3, all % 3, row);
            logits[ids[all]] - log_sum_exp(logits).0
        })
    }
}

/// The source of a problem as it appears under a pose.
pub(crate) fn source<'a>(
    problem: &'a Problem,
    accumulation: Accumulation,
    pose: &Pose,
) -> Seen<'a> {
    let view = accumulation.view(problem.centroid, pose);
    Seen {
        points: problem.looked_at(&view),
        view,
    }
}

/// The target of a problem.
pub(crate) fn target(problem: &Problem) -> Seen<'_> {
    Seen {
        points: Cow::Borrowed(&problem.chosen),
        view: View::IDENTITY,
    }
}

/// Registers problems in batches, by any network under any accumulation and decision. Returns the plain poses of
/// each problem after 0 to `steps` steps.
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
