//! One update of the method: gather a replay buffer, then learn from it (paper, Algorithm 1).

use super::method::{Method, RollOut};
use super::roll_out::gather;
use super::stats::UpdateStats;
use crate::learn::acting::{Agent, source, target};
use crate::learn::agent::{Seen, embed, embedding_backward};
use crate::learn::buffer::{Buffer, Observation};
use crate::learn::env::Problem;
use crate::learn::loss::{Losses, combined_loss};
use crate::learn::nn::Parameters;
use crate::learn::optim::Adam;
use crate::random::{Purpose, stream};
use rand::seq::SliceRandom;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// The agent, its optimiser, and an update's working memory.
#[derive(Debug)]
pub struct Trainer {
    /// The network.
    pub agent: Agent,
    /// The optimiser.
    pub adam: Adam,
    /// Exponential average of the parameters, where the method keeps one.
    pub averaged: Option<Vec<f32>>,
    /// Updates done. Together with the seed it determines the state of every random stream.
    pub updates: u64,
    /// Where the time went.
    pub spent: Spent,
    seed: u64,
    roll_out: RollOut,
    method: Method,
    gradient: Parameters,
    logit_gradients: [Vec<f32>; 2],
    value_gradient: Vec<f32>,
    state_gradient: Vec<f32>,
    feature_gradients: Vec<f32>,
}

/// Time spent in the parts of updates.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Roll-outs.
    pub roll_out: Duration,
    /// Rewards, returns and advantages.
    pub reward: Duration,
    /// Mini-batches: forward, backward, optimiser.
    pub learn: Duration,
}

/// A mini-batch whose loss or gradient is not a number. Agent and optimiser are as they were before it.
pub struct Diverged {
    /// Which mini-batch of the update, from 0.
    pub mini_batch: usize,
    /// Its losses.
    pub losses: Losses,
    /// Norm of its gradient.
    pub gradient_norm: f64,
    /// Its observations.
    pub observations: Vec<Observation>,
    /// The problems that they refer to.
    pub problems: Vec<Problem>,
}

impl std::fmt::Debug for Diverged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // The clouds are megabytes, and left out.
        f.debug_struct("Diverged")
            .field("mini_batch", &self.mini_batch)
            .field("losses", &self.losses)
            .field("gradient_norm", &self.gradient_norm)
            .finish_non_exhaustive()
    }
}

impl Trainer {
    /// A trainer for given parameters and optimiser state; the average, if any, starts at the parameters.
    pub fn new(
        parameters: Parameters,
        adam: Adam,
        updates: u64,
        seed: u64,
        roll_out: RollOut,
        method: Method,
    ) -> Self {
        Trainer {
            averaged: method.average.map(|_| parameters.values.clone()),
            gradient: Parameters::zeros(parameters.shape),
            agent: Agent::new(parameters, method.search),
            adam,
            updates,
            spent: Spent::default(),
            seed,
            roll_out,
            method,
            logit_gradients: Default::default(),
            value_gradient: Vec::new(),
            state_gradient: Vec::new(),
            feature_gradients: Vec::new(),
        }
    }

    /// One update on new problems.
    ///
    /// # Errors
    /// [`Diverged`]; the offending mini-batch changes nothing.
    pub fn update(
        &mut self,
        problems: Vec<Problem>,
        learning_rate: f32,
    ) -> Result<UpdateStats, Box<Diverged>> {
        let buffer = self.gather(problems);
        let stats = self.learn(buffer, learning_rate)?;
        self.updates += 1;
        Ok(stats)
    }

    /// Rolls out trajectories from each problem and, where there is a reinforcement term, rewards them.
    pub fn gather(&mut self, problems: Vec<Problem>) -> Buffer {
        let started = Instant::now();
        let mut rng = stream(self.seed, Purpose::Action, self.updates);
        let gathered = gather(
            &mut self.agent,
            problems,
            &self.roll_out,
            &self.method,
            &mut rng,
        );
        let rolled_out = Instant::now();
        let buffer = if self.method.ppo.on() {
            gathered.reward(&self.method)
        } else {
            gathered.buffer
        };
        self.spent.roll_out += rolled_out - started;
        self.spent.reward += rolled_out.elapsed();
        buffer
    }

    /// One pass over the shuffled buffer in mini-batches.
    fn learn(&mut self, buffer: Buffer, learning_rate: f32) -> Result<UpdateStats, Box<Diverged>> {
        let started = Instant::now();
        let mut order: Vec<usize> = (0..buffer.observations.len()).collect();
        order.shuffle(&mut stream(self.seed, Purpose::Shuffle, self.updates));
        let (mut mean, mut mean_norm) = (Losses::default(), 0.0);
        let mut batch = Vec::with_capacity(self.roll_out.mini_batch);
        for (mini_batch, rows) in order.chunks(self.roll_out.mini_batch).enumerate() {
            batch.clear();
            batch.extend(rows.iter().map(|&i| buffer.observations[i]));
            let losses = self.gradient(&buffer.problems, &batch);
            let norm = norm(&self.gradient.values);
            if !(losses.total.is_finite() && norm.is_finite()) {
                return Err(Box::new(Diverged {
                    mini_batch,
                    losses,
                    gradient_norm: norm,
                    observations: batch,
                    problems: buffer.problems,
                }));
            }
            self.step(norm, learning_rate);
            let share = batch.len() as f64 / order.len() as f64;
            mean.add(share, &losses);
            mean_norm += share * norm;
        }
        self.spent.learn += started.elapsed();
        Ok(UpdateStats::new(&mean, mean_norm, &buffer, &self.method))
    }

    /// Updates the parameters with the last gradient.
    fn step(&mut self, norm: f64, learning_rate: f32) {
        if let Some(longest) = self.method.clip_gradient
            && norm > f64::from(longest)
        {
            let scale = (f64::from(longest) / norm) as f32;
            self.gradient
                .values
                .par_chunks_mut(BLOCK)
                .for_each(|block| block.iter_mut().for_each(|g| *g *= scale));
        }
        let values = &mut self.agent.parameters.values;
        self.adam.step(values, &self.gradient.values, learning_rate);
        if let (Some(averaged), Some(decay)) = (&mut self.averaged, self.method.average) {
            average(averaged, values, decay, self.adam.steps);
        }
        self.agent.packed.pack(&self.agent.parameters);
    }

    /// Loss of a mini-batch and its gradient, which [`Trainer::last_gradient`] returns. A target that several
    /// observations share is embedded once.
    pub fn gradient(&mut self, problems: &[Problem], batch: &[Observation]) -> Losses {
        let agent = &mut self.agent;
        let parameters = &agent.parameters;
        let width = parameters.shape.features();
        let mut clouds: Vec<Seen<'_>> = batch
            .iter()
            .map(|o| source(&problems[o.problem], self.method.accumulation, &o.pose))
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
        embed(&agent.packed, width, &clouds, &mut agent.sources);
        agent.activations.forward(
            parameters,
            (&agent.sources, &source_rows),
            (&agent.sources, &target_rows),
        );
        let on = self.method.ppo.on();
        if on {
            agent.activations.estimate(parameters);
        }

        let [t, r] = &agent.activations.heads;
        let [gradient_t, gradient_r] = &mut self.logit_gradients;
        gradient_t.resize(t.logits.len(), 0.0);
        gradient_r.resize(r.logits.len(), 0.0);
        self.value_gradient.resize(batch.len(), 0.0);
        let losses = combined_loss(
            [&t.logits, &r.logits],
            &agent.activations.values,
            batch,
            &self.method.ppo,
            [gradient_t, gradient_r],
            &mut self.value_gradient,
        );

        agent.activations.backward(
            parameters,
            [&self.logit_gradients[0], &self.logit_gradients[1]],
            on.then_some(&self.value_gradient),
            &mut self.gradient,
            &mut self.state_gradient,
        );
        let feature_gradients = &mut self.feature_gradients;
        feature_gradients.clear();
        feature_gradients.resize(clouds.len() * width, 0.0);
        for (half, rows) in [&source_rows, &target_rows].into_iter().enumerate() {
            for (b, &row) in rows.iter().enumerate() {
                let sums = &mut feature_gradients[row * width..(row + 1) * width];
                for (c, sum) in sums.iter_mut().enumerate() {
                    *sum += self.state_gradient[(half * width + c) * batch.len() + b];
                }
            }
        }
        embedding_backward(
            &agent.packed,
            parameters,
            &clouds,
            &agent.sources,
            feature_gradients,
            &mut self.gradient,
        );
        losses
    }

    /// The gradient that [`Trainer::gradient`] computed last, in the layout of the parameters.
    pub fn last_gradient(&self) -> &Parameters {
        &self.gradient
    }

    /// The parameters that are validated and exported: the average if there is one.
    pub fn result(&self) -> Parameters {
        let mut parameters = self.agent.parameters.clone();
        if let Some(averaged) = &self.averaged {
            parameters.values.clone_from(averaged);
        }
        parameters
    }
}

/// Numbers per task in parallel passes over all parameters.
const BLOCK: usize = 1 << 14;

/// Euclidean norm of a vector, summed over fixed blocks in a fixed order.
fn norm(values: &[f32]) -> f64 {
    let blocks: Vec<f64> = values
        .par_chunks(BLOCK)
        .map(|block| {
            let mut lanes = [0.0f32; 16];
            let (rows, rest) = block.as_chunks::<16>();
            for row in rows {
                for (lane, x) in lanes.iter_mut().zip(row) {
                    *lane += x * x;
                }
            }
            let rest: f32 = rest.iter().map(|x| x * x).sum();
            lanes.iter().map(|&x| f64::from(x)).sum::<f64>() + f64::from(rest)
        })
        .collect();
    blocks.iter().sum::<f64>().sqrt()
}

/// `averaged += (1 - decay) (values - averaged)`, with less decay over the first steps, so that the starting point
/// is soon forgotten.
fn average(averaged: &mut [f32], values: &[f32], decay: f32, steps: u64) {
    let early = (1.0 + steps as f32) / (10.0 + steps as f32);
    let keep = decay.min(early);
    averaged
        .par_chunks_mut(BLOCK)
        .zip(values.par_chunks(BLOCK))
        .for_each(|(averaged, values)| {
            for (a, v) in averaged.iter_mut().zip(values) {
                *a += (1.0 - keep) * (v - *a);
            }
        });
}
