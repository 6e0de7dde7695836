//! What the robots of the demo see, and what their second policy is trained on.

use super::{DemoArgs, ROBOTS};
use anyhow::bail;
use host_train::augment::noisy_pair;
use host_train::dataset::pairs::PairSet;
use host_train::dataset::{Model, modelnet, procedural};
use host_train::random::{Purpose, stream};

/// Points of each cloud that a robot registers.
const POINTS: usize = 1024;
/// Built-in shapes to train on.
const TRAINING_SHAPES: usize = 512;

/// Pairs with their true poses, and clouds to train on, none of which is seen by a robot.
pub(super) struct Scene {
    /// What the robots see, in a sentence.
    pub(super) description: String,
    /// As many pairs as the robots share evenly.
    pub(super) pairs: PairSet,
    /// What is trained on, in a few words.
    pub(super) training_description: String,
    /// Clouds to train on.
    pub(super) training: Vec<Model>,
}

impl Scene {
    /// The scene that the arguments ask for.
    pub(super) fn of(args: &DemoArgs) -> anyhow::Result<Scene> {
        let wanted = args.per_robot as usize * ROBOTS.len();
        let mut scene = if let Some(path) = &args.pairs {
            Scene {
                description: format!("robots see the pairs of {}", path.display()),
                pairs: PairSet::load(path)?,
                training_description: "built-in shapes".into(),
                training: procedural::models(args.seed, TRAINING_SHAPES),
            }
        } else if let Some(directory) = &args.data {
            let models = modelnet::load(directory, modelnet::Split::Test)?;
            Scene {
                description: format!("robots see test clouds of {}", directory.display()),
                pairs: noisy_pairs(spread(&models, wanted), args.seed),
                training_description: format!("training clouds of {}", directory.display()),
                training: modelnet::load(directory, modelnet::Split::Train)?,
            }
        } else {
            let held_out = procedural::models(!args.seed, wanted);
            Scene {
                description: "robots see held-out built-in shapes".into(),
                pairs: noisy_pairs(held_out.iter(), args.seed),
                training_description: "built-in shapes".into(),
                training: procedural::models(args.seed, TRAINING_SHAPES),
            }
        };
        let found = scene.pairs.source.len().min(wanted);
        let shared = found - found % ROBOTS.len();
        if shared == 0 {
            bail!(
                "{} robots need at least as many pairs; there are {found}",
                ROBOTS.len()
            );
        }
        scene.pairs.source.truncate(shared);
        Ok(scene)
    }
}

/// `count` models, evenly spread over the data set.
fn spread(models: &[Model], count: usize) -> impl Iterator<Item = &Model> {
    models
        .iter()
        .step_by((models.len() / count).max(1))
        .take(count)
}

/// One pair of a model each, by the paper's noisy protocol.
fn noisy_pairs<'m>(models: impl Iterator<Item = &'m Model>, seed: u64) -> PairSet {
    let mut pairs = PairSet::default();
    for (index, model) in models.enumerate() {
        let mut rng = stream(seed, Purpose::Pairs, index as u64);
        let sample = noisy_pair(&mut rng, &model.points, POINTS);
        pairs.source.push(sample.source);
        pairs.target.push(sample.target);
        pairs.target_from_source.push(sample.target_from_source);
        pairs.label.push(model.label as i32);
        pairs.raw.get_or_insert_default().push(model.points.clone());
    }
    pairs
}
