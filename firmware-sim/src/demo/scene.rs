//! What the robots of the demo see, and what their second policy is trained on.

use super::{DemoArgs, ROBOTS};
use anyhow::bail;
use host_train::augment::{misalign, noisy_pair, noisy_sample};
use host_train::dataset::camera::Camera;
use host_train::dataset::pairs::{PairSet, Sample};
use host_train::dataset::procedural::{self, Shape};
use host_train::dataset::{Model, modelnet};
use host_train::measure::eval::EvalError;
use host_train::policy::WeightFile;
use host_train::publish::Comparison;
use host_train::random::resample;
use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use std::sync::Arc;

/// Points of each cloud that a robot registers.
const POINTS: usize = 1024;
/// Depth images of one shape, from all sides.
const VIEWS: usize = 6;

/// Pairs on which the second policy must not be worse than the first.
const COMPARED: u64 = 200;

/// Draws training sample number `i` from its own stream.
pub(super) type Sampler = Arc<dyn Fn(&mut Rng, u64) -> Sample + Send + Sync>;

/// Pairs with their true poses, and what to train on: shapes that no robot sees.
pub(super) struct Scene {
    /// What the robots see, in a sentence.
    pub(super) description: String,
    /// As many pairs as the robots share evenly.
    pub(super) pairs: PairSet,
    /// What is trained on, in a few words.
    pub(super) training_description: String,
    /// Draws what is trained on.
    pub(super) training: Sampler,
    seed: u64,
}

impl Scene {
    /// The scene that the arguments ask for.
    pub(super) fn of(args: &DemoArgs) -> anyhow::Result<Scene> {
        let wanted = args.per_robot as usize * ROBOTS.len();
        let seed = args.seed;
        let mut scene = if let Some(path) = &args.pairs {
            Scene {
                description: format!("robots see the pairs of {}", path.display()),
                pairs: PairSet::load(path)?,
                training_description: "built-in shapes under sensor noise".into(),
                seed,
                training: Arc::new(move |rng, i| {
                    noisy_sample(rng, &procedural::model(seed, i).points, POINTS)
                }),
            }
        } else if let Some(directory) = &args.data {
            let clouds = modelnet::load(directory, modelnet::Split::Train)?;
            let held_out = modelnet::load(directory, modelnet::Split::Test)?;
            let apart = (held_out.len() / wanted).max(1);
            let spread = held_out.into_iter().step_by(apart).take(wanted);
            Scene {
                description: format!("robots see test clouds of {}", directory.display()),
                pairs: pairs_of(spread, seed, |rng, cloud| {
                    let sample = noisy_pair(rng, &cloud.points, POINTS);
                    (sample, cloud)
                }),
                training_description: format!("training clouds of {}", directory.display()),
                seed,
                training: Arc::new(move |rng, _| {
                    let cloud = &clouds[rng.random_range(0..clouds.len())];
                    noisy_sample(rng, &cloud.points, POINTS)
                }),
            }
        } else {
            // The complement of the training seed: another, disjoint stream of shapes.
            let held_out = (0..wanted as u64).map(|i| procedural::shape(!seed, i));
            Scene {
                description: format!(
                    "robots see built-in shapes held out of all training, in {VIEWS} depth images each"
                ),
                pairs: pairs_of(held_out, seed, |rng, shape| {
                    (seen_by_camera(rng, &shape), shape.model)
                }),
                training_description: "other built-in shapes, seen by the same camera".into(),
                seed,
                training: Arc::new(move |rng, i| seen_by_camera(rng, &procedural::shape(seed, i))),
            }
        };
        let found = scene.pairs.source.len().min(wanted);
        let shared = found - found % ROBOTS.len();
        if shared == 0 {
            let robots = ROBOTS.len();
            bail!("{robots} robots need at least as many pairs; there are {found}");
        }
        scene.pairs.source.truncate(shared);
        Ok(scene)
    }

    /// Both policies on pairs of the kind that is trained on, drawn apart from training.
    pub(super) fn compare(
        &self,
        first: &WeightFile,
        second: &WeightFile,
    ) -> Result<Comparison, EvalError> {
        let mut set = PairSet::default();
        for index in u64::MAX - COMPARED..u64::MAX {
            let mut rng = stream(self.seed, Purpose::Split, index);
            let sample = (self.training)(&mut rng, index);
            let raw = sample.target.clone();
            set.push(sample, raw, 0);
        }
        Comparison::of(first, second, &set)
    }
}

/// The shape as depth cameras see it, moved at random; to be registered to points of its surface.
fn seen_by_camera(rng: &mut Rng, shape: &Shape) -> Sample {
    let source = Camera::default().observe(&shape.mesh, VIEWS, POINTS, rng);
    let target = resample(rng, &shape.model.points, POINTS);
    misalign(rng, source, target)
}

/// One pair of each item, each drawn from a stream of its own.
fn pairs_of<T>(
    items: impl Iterator<Item = T>,
    seed: u64,
    draw: impl Fn(&mut Rng, T) -> (Sample, Model),
) -> PairSet {
    let mut pairs = PairSet::default();
    for (index, item) in items.enumerate() {
        let (sample, model) = draw(&mut stream(seed, Purpose::Pairs, index as u64), item);
        pairs.push(sample, model.points, model.label);
    }
    pairs
}
