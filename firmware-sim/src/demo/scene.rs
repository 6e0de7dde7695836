//! What the robots of the demo see, which policy they begin with, and what the second policy is trained on.

use super::{DemoArgs, ROBOTS};
use anyhow::{Context, bail, ensure};
use host_train::augment::{noisy_pair, noisy_sample};
use host_train::dataset::pairs::{PairSet, Sample};
use host_train::dataset::{MODELNET40_URL, Split, modelnet, procedural};
use host_train::measure::eval::EvalError;
use host_train::policy::{VIEWS, WeightFile};
use host_train::publish::Comparison;
use host_train::random::{Purpose, Rng, stream};
use host_train::views::Views;
use rand::RngExt;
use std::path::Path;
use std::sync::Arc;

/// Points of each cloud that a robot registers.
const POINTS: usize = 1024;
/// Parts at the robots' site.
const PARTS: usize = ROBOTS.len();
/// Pairs on which the second policy must not be worse than the first.
const COMPARED: u64 = 300;
/// Pairs to which the integers of the second policy are fitted.
const CALIBRATION: u64 = 96;

/// Draws training sample number `i` from its own stream.
pub(super) type Sampler = Arc<dyn Fn(&mut Rng, u64) -> Sample + Send + Sync>;

/// Pairs with their true poses, and what to train on.
pub(super) struct Scene {
    /// What the robots see, in a sentence.
    pub(super) description: String,
    /// The pairs to refine; every robot gets the same number.
    pub(super) pairs: PairSet,
    /// The policy that is published first.
    pub(super) first: WeightFile,
    /// The same in f32, to train on.
    pub(super) start: WeightFile,
    /// What is trained on, in a few words.
    pub(super) training_description: String,
    /// Draws training samples.
    pub(super) training: Sampler,
    seed: u64,
}

impl Scene {
    /// The scene that the arguments ask for.
    pub(super) fn of(args: &DemoArgs) -> anyhow::Result<Scene> {
        let wanted = args.per_robot as usize * ROBOTS.len();
        let mut scene = match (&args.pairs, &args.data) {
            (Some(path), _) => Scene::of_pairs(args, path)?,
            (None, Some(directory)) => Scene::of_clouds(args, directory, wanted)?,
            (None, None) => Scene::of_parts(args, wanted)?,
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

    fn of_pairs(args: &DemoArgs, path: &Path) -> anyhow::Result<Scene> {
        let first = WeightFile::load_or_pretrained(args.weights.as_deref())?;
        let seed = args.seed;
        Ok(Scene {
            description: format!("robots see the pairs of {}", path.display()),
            pairs: PairSet::load(path)?,
            start: first.clone(),
            first,
            training_description: "built-in shapes under sensor noise".into(),
            training: Arc::new(move |rng, i| {
                noisy_sample(rng, &procedural::model(seed, i).points, POINTS)
            }),
            seed,
        })
    }

    fn of_clouds(args: &DemoArgs, directory: &Path, wanted: usize) -> anyhow::Result<Scene> {
        ensure!(
            directory.is_dir(),
            "--data: no directory {}; unpack {MODELNET40_URL} there, or leave the option out for built-in parts",
            directory.display()
        );
        let first = WeightFile::load_or_pretrained(args.weights.as_deref())?;
        let clouds = modelnet::load(directory, Split::Train)?;
        let held_out = modelnet::load(directory, Split::Test)?;
        let apart = (held_out.len() / wanted).max(1);
        let spread = held_out.into_iter().step_by(apart).take(wanted);
        let mut pairs = PairSet::default();
        for (index, cloud) in spread.enumerate() {
            let rng = &mut stream(args.seed, Purpose::Pairs, index as u64);
            let sample = noisy_pair(rng, &cloud.points, POINTS);
            pairs.push(sample, cloud.points, cloud.label);
        }
        Ok(Scene {
            description: format!("robots see test clouds of {}", directory.display()),
            pairs,
            start: first.clone(),
            first,
            training_description: format!("training clouds of {}", directory.display()),
            training: Arc::new(move |rng, _| {
                let cloud = &clouds[rng.random_range(0..clouds.len())];
                noisy_sample(rng, &cloud.points, POINTS)
            }),
            seed: args.seed,
        })
    }

    /// Parts that no policy has seen, in depth views.
    fn of_parts(args: &DemoArgs, wanted: usize) -> anyhow::Result<Scene> {
        let [first, start] = match &args.weights {
            Some(path) => {
                let first = WeightFile::load(path)?;
                [first.clone(), first]
            }
            None => [WeightFile::load(Path::new(VIEWS))?, views_to_train_on()?],
        };
        let parts = Views::procedural(!args.seed, 0..PARTS as u64);
        let mut pairs = PairSet::default();
        for index in 0..wanted {
            let rng = &mut stream(args.seed, Purpose::Pairs, index as u64);
            let part = &parts.objects()[index % PARTS];
            let seen = part.draw(rng, POINTS, &mut pairs);
            seen.context("a part is not seen")?;
        }
        Ok(Scene {
            description: format!(
                "robots see {PARTS} parts, built-in shapes that no policy was trained on, in single depth views"
            ),
            pairs,
            first,
            start,
            training_description: "other views of these parts".into(),
            training: Arc::new(move |rng, i| {
                let part = i as usize % PARTS;
                let sample = parts.sample(part, rng, POINTS, false);
                sample.expect("views of the parts were drawn before")
            }),
            seed: args.seed,
        })
    }

    /// Compares both policies on pairs like the training samples, but drawn separately.
    pub(super) fn compare(
        &self,
        first: &WeightFile,
        second: &WeightFile,
    ) -> Result<Comparison, EvalError> {
        Comparison::of(first, second, &self.draw(COMPARED, 0))
    }

    /// The trained policy in the first policy's number format.
    pub(super) fn finished(&self, trained: WeightFile) -> anyhow::Result<WeightFile> {
        if self.first.policy().f32().is_some() {
            return Ok(trained);
        }
        let (policy, parameters) = (trained.policy(), trained.parameters(self.seed)?);
        let pairs = self.draw(CALIBRATION, COMPARED);
        let integers = WeightFile::from_parameters_int8_within(policy.sight, &parameters, &pairs)?;
        Ok(integers.run_like(&policy))
    }

    /// Draws pairs like the training samples, but separately, after `skipped` others.
    fn draw(&self, count: u64, skipped: u64) -> PairSet {
        let mut set = PairSet::default();
        for index in skipped..skipped + count {
            let mut rng = stream(self.seed, Purpose::Split, index);
            let sample = (self.training)(&mut rng, u64::MAX - index);
            let raw = sample.target.clone();
            set.push(sample, raw, 0);
        }
        set
    }
}

/// The f32 policy for views from the repository; it is not linked in.
fn views_to_train_on() -> anyhow::Result<WeightFile> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../core/weights/views.rgw");
    WeightFile::load(Path::new(path))
        .context("the second policy is trained from views.rgw of the repository; or give --weights")
}
