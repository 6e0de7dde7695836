//! What a run trains on, and what it is validated on.

use super::config::{Categories, DataSource, Stage, TrainConfig};
use super::error::TrainError;
use crate::augment::{clean_pair, clean_sample, noisy_pair, noisy_sample};
use crate::bop::sample::{BopSampling, BopTraining};
use crate::dataset::pairs::{PairSet, Sample};
use crate::dataset::{self, Model, Point, Split, modelnet, procedural};
use crate::learn::env::Problem;
use crate::protocol::{self, Protocol};
use crate::random::resample;
use crate::random::{Purpose, Rng, stream};
use crate::views::{Meshes, Object, Views};
use rand::seq::SliceRandom;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

/// What samples are drawn from.
#[derive(Debug)]
pub(super) struct TrainingData {
    /// Clouds of models, deformed and moved afresh for each sample.
    clouds: Vec<Vec<Point>>,
    /// Annotated objects in depth images, which are read as samples are drawn.
    objects: Vec<BopTraining>,
    /// Meshes of which views are rendered.
    views: Vec<Views>,
    /// Clouds, annotated objects and meshes that validation draws from.
    pub(super) held_back: usize,
    /// Categories that [`Categories::First`] leaves out.
    pub(super) categories_left_out: usize,
}

impl TrainingData {
    /// Clouds, annotated objects and meshes of views: the samples of an epoch.
    pub(super) fn len(&self) -> usize {
        self.clouds.len()
            + self
                .objects
                .iter()
                .map(|o| o.instances().len())
                .sum::<usize>()
            + self.views.iter().map(|v| v.objects().len()).sum::<usize>()
    }
}

/// Loads what a run trains on, and draws the pairs for validation from the meshes and images held back.
pub(super) fn load(config: &TrainConfig) -> Result<(TrainingData, PairSet), TrainError> {
    let mut objects = Vec::new();
    let mut views = Vec::new();
    let mut poses = PairSet::default();
    let mut training: Vec<Model> = Vec::new();
    let mut held_back: Vec<Model> = Vec::new();
    let (mut held_back_otherwise, mut categories_left_out) = (0, 0);
    let mut of_first_half = |labels: Vec<u32>| {
        categories_left_out += modelnet::left_out(labels, &modelnet::FIRST_HALF)[0];
    };
    for source in &config.data {
        let models = match source {
            DataSource::Directory(path) => {
                let models = dataset::load(path, Split::Train, config.seed)?;
                match config.categories {
                    Categories::First => {
                        of_first_half(models.iter().map(|model| model.label).collect());
                        modelnet::categories(models, modelnet::FIRST_HALF)
                    }
                    Categories::All => models,
                }
            }
            DataSource::Procedural(count) => procedural::models(config.seed, *count),
            DataSource::Bop(path) => {
                let sampling = BopSampling {
                    points: config.points,
                    ..BopSampling::default()
                };
                let all = BopTraining::open(path, config.seed, sampling)?;
                let (training, validation) = all.split(config.seed, config.validation);
                held_back_otherwise += validation.instances().len();
                validation.draw(config.validation_pairs, config.seed, &mut poses)?;
                objects.push(training);
                continue;
            }
            DataSource::Views(meshes) => {
                let all = Views::load(meshes, config.seed)?;
                let [training, validation] = all.split(|mut objects| {
                    if config.categories == Categories::First
                        && matches!(meshes, Meshes::Directory(_))
                    {
                        of_first_half(objects.iter().map(|o| o.label).collect());
                        objects.retain(|o| modelnet::FIRST_HALF.contains(&o.label));
                    }
                    modelnet::validation_split(objects, config.seed, config.validation).into()
                });
                held_back_otherwise += validation.objects().len();
                validation.draw(
                    config.validation_pairs,
                    config.points,
                    config.seed,
                    &mut poses,
                );
                views.push(training);
                continue;
            }
        };
        let (train, validation) =
            modelnet::validation_split(models, config.seed, config.validation);
        training.extend(train);
        held_back.extend(validation);
    }
    let count = config.validation_pairs;
    let mut pairs = protocol::draw(&held_back, Protocol::M40Models, count, config.seed);
    pairs.extend(poses);
    let data = TrainingData {
        clouds: training.into_iter().map(|m| m.points).collect(),
        objects,
        views,
        held_back: held_back.len() + held_back_otherwise,
        categories_left_out,
    };
    if data.len() < 2 || pairs.source.is_empty() {
        return Err(TrainError::TooFewClouds(data.len() + data.held_back));
    }
    Ok((data, pairs))
}

/// The problems of an update: the next samples in an endless sequence of shuffled epochs, each with an augmentation
/// of its own.
///
/// # Errors
/// A depth image or a mask that cannot be read, or a mesh of which no view shows anything.
pub(super) fn problems(
    config: &TrainConfig,
    data: &TrainingData,
    update: u64,
) -> Result<Vec<Problem>, TrainError> {
    let n = data.len() as u64;
    let batch = config.roll_out.problems as u64;
    let positions: Vec<u64> = (update * batch..(update + 1) * batch).collect();
    let order = |epoch: u64| {
        let mut order: Vec<usize> = (0..data.len()).collect();
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
        .map(|(position, pick)| {
            let mut rng = stream(config.seed, Purpose::Augment, position);
            let sample = draw(config, data, pick, &mut rng)?;
            Ok(Problem::seen(config.sight, sample))
        })
        .collect()
}

/// A training pair of sample number `pick`: clouds come first, then annotated objects, then meshes of views.
fn draw(
    config: &TrainConfig,
    data: &TrainingData,
    pick: usize,
    rng: &mut Rng,
) -> Result<Sample, TrainError> {
    if let Some(cloud) = data.clouds.get(pick) {
        return Ok(sample(config, rng, cloud));
    }
    let mut index = pick - data.clouds.len();
    for objects in &data.objects {
        let count = objects.instances().len();
        if index < count {
            return Ok(objects.sample(index, rng)?);
        }
        index -= count;
    }
    for views in &data.views {
        let count = views.objects().len();
        if index < count {
            let sample = views.sample(index, rng, config.points, config.augmentation);
            return sample.ok_or(TrainError::NothingSeen);
        }
        index -= count;
    }
    unreachable!("picks are below the number of clouds and objects")
}

/// A training pair of one cloud under the stage's conditions: clean in pre-training, noisy after it.
fn sample(config: &TrainConfig, rng: &mut Rng, cloud: &[Point]) -> Sample {
    let mut sample = match (config.stage, config.augmentation) {
        (Stage::Pretrain, true) => clean_sample(rng, cloud, config.points),
        (Stage::Pretrain, false) => {
            let points = resample(rng, cloud, config.points);
            clean_pair(rng, points)
        }
        (Stage::Il | Stage::Ilrl, true) => noisy_sample(rng, cloud, config.points),
        (Stage::Il | Stage::Ilrl, false) => noisy_pair(rng, cloud, config.points),
    };
    config.disturbance.apply(rng, &mut sample);
    sample
}

/// SHA-256 over everything a run was trained on, in hexadecimal: all training clouds in their order, and the
/// annotations and models of objects. Images are not read for it.
pub(super) fn fingerprint(data: &TrainingData) -> String {
    let mut hash = Sha256::new();
    let models = data.objects.iter().flat_map(BopTraining::surfaces);
    let views = data.views.iter().flat_map(Views::objects);
    let surfaces = models.chain(views.map(Object::surface));
    for cloud in data.clouds.iter().map(Vec::as_slice).chain(surfaces) {
        hash.update((cloud.len() as u64).to_le_bytes());
        hash.update(bytemuck::cast_slice::<f32, u8>(cloud.as_flattened()));
    }
    for i in data.objects.iter().flat_map(BopTraining::instances) {
        hash.update(
            [i.scene, i.image, i.index, i.object]
                .map(u32::to_le_bytes)
                .as_flattened(),
        );
        let pose = i.camera_from_model.to_rows();
        hash.update(bytemuck::cast_slice::<f32, u8>(pose.as_flattened()));
    }
    const_hex::encode(hash.finalize())
}
