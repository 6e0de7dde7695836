//! What a run trains on, and what it is validated on.

use super::config::{Categories, DataSource, Stage, TrainConfig};
use super::run::TrainError;
use crate::augment::{clean_pair, clean_sample, noisy_pair, noisy_sample, resample};
use crate::dataset::pairs::{PairSet, Sample};
use crate::dataset::{self, Model, Point, Split, modelnet, procedural};
use crate::env::Problem;
use crate::protocol::{self, Protocol};
use crate::random::{Purpose, Rng, stream};
use rand::seq::SliceRandom;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

/// Training clouds, and noisy pairs of the meshes held back for validation.
pub(super) fn clouds(config: &TrainConfig) -> Result<(Vec<Vec<Point>>, PairSet), TrainError> {
    let mut training: Vec<Model> = Vec::new();
    let mut held_back: Vec<Model> = Vec::new();
    for source in &config.data {
        let models = match source {
            DataSource::Directory(path) => {
                let models = dataset::load(path, Split::Train, config.seed)?;
                match config.categories {
                    Categories::First => modelnet::categories(models, modelnet::FIRST_HALF),
                    Categories::All => models,
                }
            }
            DataSource::Procedural(count) => procedural::models(config.seed, *count),
        };
        let (train, validation) =
            modelnet::validation_split(models, config.seed, config.validation);
        training.extend(train);
        held_back.extend(validation);
    }
    if training.len() < 2 || held_back.is_empty() {
        return Err(TrainError::TooFewClouds(training.len() + held_back.len()));
    }
    let count = held_back.len().min(config.validation_pairs);
    let pairs = protocol::draw(&held_back, Protocol::M40Models, count, config.seed);
    Ok((training.into_iter().map(|m| m.points).collect(), pairs))
}

/// The problems of an update: the next clouds in an endless sequence of shuffled epochs, each with an
/// augmentation of its own.
pub(super) fn problems(config: &TrainConfig, clouds: &[Vec<Point>], update: u64) -> Vec<Problem> {
    let n = clouds.len() as u64;
    let batch = config.roll_out.problems as u64;
    let positions: Vec<u64> = (update * batch..(update + 1) * batch).collect();
    let order = |epoch: u64| {
        let mut order: Vec<usize> = (0..clouds.len()).collect();
        order.shuffle(&mut stream(config.seed, Purpose::Order, epoch));
        order
    };
    let mut current = (positions[0] / n, order(positions[0] / n));
    let picks: Vec<(u64, usize)> = positions
        .into_iter()
        .map(|position| {
            if position / n != current.0 {
                current = (position / n, order(position / n));
            }
            (position, current.1[(position % n) as usize])
        })
        .collect();
    picks
        .into_par_iter()
        .map(|(position, cloud)| {
            let mut rng = stream(config.seed, Purpose::Augment, position);
            let cloud = &clouds[cloud];
            Problem::from(sample(config, &mut rng, cloud))
        })
        .collect()
}

/// A training pair of one cloud, as the stage wants it.
fn sample(config: &TrainConfig, rng: &mut Rng, cloud: &[Point]) -> Sample {
    match (config.stage, config.augmentation) {
        (Stage::Pretrain, true) => clean_sample(rng, cloud, config.points),
        (Stage::Pretrain, false) => {
            let points = resample(rng, cloud, config.points);
            clean_pair(rng, points)
        }
        (Stage::Il | Stage::Ilrl, true) => noisy_sample(rng, cloud, config.points),
        (Stage::Il | Stage::Ilrl, false) => noisy_pair(rng, cloud, config.points),
    }
}

/// SHA-256 of all training clouds in their order, in hexadecimal: what a run was trained on.
pub(super) fn fingerprint(clouds: &[Vec<Point>]) -> String {
    let mut hash = Sha256::new();
    for cloud in clouds {
        hash.update((cloud.len() as u64).to_le_bytes());
        hash.update(bytemuck::cast_slice::<f32, u8>(cloud.as_flattened()));
    }
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}
