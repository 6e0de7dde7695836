//! One update of the method: gather a replay buffer, then learn from it (paper, Algorithm 1).

use super::config::RollOut;
use crate::agent::{Activations, Features, Seen, embed, embedding_backward};
use crate::buffer::{Buffer, Observation};
use crate::env::{self, Problem};
use crate::expert::Expert;
use crate::loss::{CloneLoss, clone_loss, log_sum_exp};
use crate::nn::{PackedEmbedding, Parameters, Search};
use crate::optim::Adam;
use crate::random::{Purpose, Rng, stream};
use rand::{RngExt, seq::SliceRandom};
use reagent_core::dims::{AXES, STEP_SIZES};
use reagent_core::net::View;
use reagent_core::{Action, Pose};

/// The agent, its optimiser, and the memory that an update works in.
#[derive(Debug)]
pub struct Trainer {
    /// The network.
    pub parameters: Parameters,
    /// The optimiser.
    pub adam: Adam,
    /// Updates done: with the seed, the state of every random stream.
    pub updates: u64,
    seed: u64,
    roll_out: RollOut,
    expert: Expert,
    packed: PackedEmbedding,
    gradient: Parameters,
    features: Features,
    targets: Features,
    activations: Activations,
}

/// What one update measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateStats {
    /// Cloning loss, mean over the mini-batches.
    pub loss: f64,
    /// Share of axes on which the most likely action is the expert's.
    pub agreement: f64,
}

impl Trainer {
    /// A trainer for given parameters and optimiser state.
    pub fn new(
        parameters: Parameters,
        adam: Adam,
        updates: u64,
        seed: u64,
        roll_out: RollOut,
        expert: Expert,
    ) -> Self {
        Trainer {
            packed: PackedEmbedding::new(&parameters),
            gradient: Parameters::zeros(parameters.shape),
            parameters,
            adam,
            updates,
            seed,
            roll_out,
            expert,
            features: Features::default(),
            targets: Features::default(),
            activations: Activations::default(),
        }
    }

    /// Searches for critical points in another way than the machine does best.
    pub fn search_in(&mut self, search: Search) {
        self.packed = PackedEmbedding::with_search(&self.parameters, search);
    }

    /// One update on new problems.
    pub fn update(&mut self, problems: Vec<Problem>, learning_rate: f32) -> UpdateStats {
        let buffer = self.gather(problems);
        let stats = self.learn(&buffer, learning_rate);
        self.updates += 1;
        stats
    }

    /// Rolls the stochastic policy out, N trajectories of n steps from each problem.
    pub fn gather(&mut self, problems: Vec<Problem>) -> Buffer {
        let mut rng = stream(self.seed, Purpose::Action, self.updates);
        let width = self.parameters.shape.features();
        let count = problems.len();
        let targets: Vec<Seen<'_>> = problems.iter().map(target).collect();
        embed(&self.packed, width, &targets, &mut self.targets);

        let runs: Vec<usize> = (0..self.roll_out.trajectories)
            .flat_map(|_| 0..count)
            .collect();
        let rows: Vec<usize> = (0..runs.len()).collect();
        let mut poses = vec![Pose::IDENTITY; runs.len()];
        let mut observations = Vec::with_capacity(runs.len() * self.roll_out.steps);
        for _ in 0..self.roll_out.steps {
            let seen: Vec<Seen<'_>> = runs
                .iter()
                .zip(&poses)
                .map(|(&problem, pose)| source(&problems[problem], pose))
                .collect();
            embed(&self.packed, width, &seen, &mut self.features);
            self.activations.forward(
                &self.parameters,
                (&self.features, &rows),
                (&self.targets, &runs),
            );
            for (row, (&problem, pose)) in runs.iter().zip(&mut poses).enumerate() {
                observations.push(Observation {
                    problem,
                    pose: *pose,
                    expert: self.expert.action(pose, &problems[problem].registering),
                });
                let action = sample(&self.activations, row, runs.len(), &mut rng);
                *pose = env::step(pose, action);
            }
        }
        Buffer {
            problems,
            observations,
        }
    }

    /// One pass over the shuffled buffer in mini-batches.
    pub fn learn(&mut self, buffer: &Buffer, learning_rate: f32) -> UpdateStats {
        let mut order: Vec<usize> = (0..buffer.observations.len()).collect();
        order.shuffle(&mut stream(self.seed, Purpose::Shuffle, self.updates));
        let mut stats = UpdateStats::default();
        for batch in order.chunks(self.roll_out.mini_batch) {
            let batch: Vec<Observation> = batch.iter().map(|&i| buffer.observations[i]).collect();
            let loss = self.gradient(&buffer.problems, &batch);
            self.adam.step(
                &mut self.parameters.values,
                &self.gradient.values,
                learning_rate,
            );
            self.packed.pack(&self.parameters);
            let share = batch.len() as f64 / order.len() as f64;
            stats.loss += share * loss.total();
            stats.agreement += share * loss.agreement;
        }
        stats
    }

    /// Cloning loss of a mini-batch and its gradient, which [`Trainer::last_gradient`] shows. A target
    /// that several observations share is embedded once.
    pub fn gradient(&mut self, problems: &[Problem], batch: &[Observation]) -> CloneLoss {
        let width = self.parameters.shape.features();
        let mut clouds: Vec<Seen<'_>> = batch
            .iter()
            .map(|o| source(&problems[o.problem], &o.pose))
            .collect();
        let mut shared: Vec<Option<usize>> = vec![None; problems.len()];
        let target_rows: Vec<usize> = batch
            .iter()
            .map(|o| {
                *shared[o.problem].get_or_insert_with(|| {
                    clouds.push(target(&problems[o.problem]));
                    clouds.len() - 1
                })
            })
            .collect();
        let source_rows: Vec<usize> = (0..batch.len()).collect();
        embed(&self.packed, width, &clouds, &mut self.features);
        self.activations.forward(
            &self.parameters,
            (&self.features, &source_rows),
            (&self.features, &target_rows),
        );

        let expert: Vec<Action> = batch.iter().map(|o| o.expert).collect();
        let [t, r] = &self.activations.heads;
        let mut gradients = [vec![0.0; t.logits.len()], vec![0.0; r.logits.len()]];
        let [gradient_t, gradient_r] = &mut gradients;
        let loss = clone_loss([&t.logits, &r.logits], &expert, [gradient_t, gradient_r]);

        let mut state_gradient = Vec::new();
        self.activations.backward(
            &self.parameters,
            [&gradients[0], &gradients[1]],
            &mut self.gradient,
            &mut state_gradient,
        );
        let mut feature_gradients = vec![0.0; clouds.len() * width];
        for (half, rows) in [&source_rows, &target_rows].into_iter().enumerate() {
            for (b, &row) in rows.iter().enumerate() {
                for c in 0..width {
                    feature_gradients[row * width + c] +=
                        state_gradient[(half * width + c) * batch.len() + b];
                }
            }
        }
        embedding_backward(
            &self.packed,
            &self.parameters,
            &clouds,
            &self.features,
            &feature_gradients,
            &mut self.gradient,
        );
        loss
    }

    /// The gradient that [`Trainer::gradient`] computed last, in the layout of the parameters.
    pub fn last_gradient(&self) -> &Parameters {
        &self.gradient
    }
}

fn source<'a>(problem: &'a Problem, pose: &Pose) -> Seen<'a> {
    Seen {
        points: &problem.source,
        view: problem.view(pose),
    }
}

fn target(problem: &Problem) -> Seen<'_> {
    Seen {
        points: &problem.target,
        view: View::IDENTITY,
    }
}

/// Draws an action from the policy's six categorical distributions.
fn sample(activations: &Activations, row: usize, batch: usize, rng: &mut Rng) -> Action {
    let [translation, rotation] = [0, 1].map(|head| {
        let logits = &activations.heads[head].logits;
        std::array::from_fn(|axis: usize| {
            debug_assert!(axis < AXES);
            let axis: [f32; STEP_SIZES] =
                std::array::from_fn(|i| logits[(axis * STEP_SIZES + i) * batch + row]);
            let (log_sum, _) = log_sum_exp(axis);
            let mut left: f32 = rng.random();
            for (i, logit) in axis.into_iter().enumerate() {
                left -= (logit - log_sum).exp();
                if left < 0.0 {
                    return i as u8;
                }
            }
            (STEP_SIZES - 1) as u8
        })
    });
    Action {
        translation,
        rotation,
    }
}
