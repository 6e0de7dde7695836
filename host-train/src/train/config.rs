//! Every hyper-parameter of a run, with the source of its default.

use super::error::TrainError;
use super::learning_rate::{Anneal, LearningRate};
use super::method::{Follow, Method, RollOut};
use crate::augment::Disturbance;
use crate::dataset::bop::is_bop;
use crate::learn::env::Accumulation;
use crate::learn::nn::Shape;
use crate::random::SEED;
use crate::views::Meshes;
use reagent_core::cut::Cut;
use reagent_core::sight::Sight;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Where training clouds come from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DataSource {
    /// A data set on disk, of any layout that [`crate::dataset::load`] reads.
    Directory(PathBuf),
    /// A directory in BOP layout: depth images with annotated objects.
    Bop(PathBuf),
    /// The built-in parametric shapes, this many.
    Procedural(usize),
    /// Depth views of the meshes of a directory or of built-in shapes, rendered as samples are drawn.
    Views(Meshes),
}

/// What a policy for views looks at. Of the source, points within 1.25 radii of the target's centre, since most starts
/// err by less than .25; of the target, points near some of the source, chosen anew every three steps.
const VIEWS: Sight = Sight {
    cut: Cut::from_header(20),
    focus: 3,
};

impl FromStr for DataSource {
    type Err = String;

    /// Parses `procedural`, `procedural:COUNT` or a directory, whose layout is told from its contents. A prefix
    /// `views:` asks for depth views of the same meshes.
    fn from_str(s: &str) -> Result<Self, String> {
        if let Some(meshes) = s.strip_prefix("views:") {
            return match meshes.parse()? {
                DataSource::Directory(path) => Ok(DataSource::Views(Meshes::Directory(path))),
                DataSource::Procedural(count) => Ok(DataSource::Views(Meshes::Procedural(count))),
                _ => Err(format!(
                    "\"{s}\": write views:DIR with a directory of meshes, or views:procedural[:COUNT]"
                )),
            };
        }
        match s.strip_prefix("procedural") {
            Some("") => Ok(DataSource::Procedural(1024)),
            Some(count) if count.starts_with(':') => match count[1..].parse() {
                Ok(n) if n > 0 => Ok(DataSource::Procedural(n)),
                _ => Err(format!(
                    "\"{s}\": write procedural:COUNT with a count above 0"
                )),
            },
            _ if is_bop(s.as_ref()) => Ok(DataSource::Bop(s.into())),
            _ => Ok(DataSource::Directory(s.into())),
        }
    }
}

impl fmt::Display for DataSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DataSource::Directory(path) | DataSource::Bop(path) => path.display().fmt(f),
            DataSource::Procedural(count) => write!(f, "procedural:{count}"),
            DataSource::Views(Meshes::Directory(path)) => write!(f, "views:{}", path.display()),
            DataSource::Views(Meshes::Procedural(count)) => write!(f, "views:procedural:{count}"),
        }
    }
}

/// Which stage of the method runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Imitation on clean clouds, learning rate from 1e-3.
    Pretrain,
    /// Imitation on noisy clouds, learning rate from 1e-4.
    Il,
    /// Imitation and reinforcement (alpha 2) on noisy clouds, learning rate from 1e-4.
    Ilrl,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Stage::Pretrain => "pretrain",
            Stage::Il => "il",
            Stage::Ilrl => "ilrl",
        })
    }
}

/// Which categories of a directory are trained on, by label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Categories {
    /// Labels 0 to 19: the paper's protocol; the others stay held out.
    #[default]
    First,
    /// All labels: for a policy to ship.
    All,
}

/// Widths of the network (paper, design table, column "deep" or "wide").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Network {
    /// The paper's: embedding 64-128-1024, heads 512-256
    #[default]
    Wide,
    /// For small microcontrollers: embedding 64-64-384, heads 128-64; at most 256 KiB in 8-bit integers
    Compact,
    /// Embedding 64-64-64-128-1024, heads 256-128 (our widths; the paper gives none); cannot be exported
    Deep,
}

impl Network {
    /// The widths.
    pub fn shape(self) -> Shape {
        match self {
            Network::Wide => Shape::PAPER,
            Network::Compact => Shape::COMPACT,
            Network::Deep => Shape::DEEP,
        }
    }
}

/// Configuration of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainConfig {
    /// Sources of clouds, concatenated.
    pub data: Vec<DataSource>,
    /// Categories of the directories.
    pub categories: Categories,
    /// Stage of the method.
    pub stage: Stage,
    /// Run directory.
    pub out: PathBuf,
    /// Passes over the clouds (paper: 50 a stage; 100 for data in BOP layout).
    pub epochs: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Worker threads; 0 takes all cores. Results do not depend on it.
    pub threads: usize,
    /// Start from this run, checkpoint or policy; `None` starts from random weights.
    pub init: Option<PathBuf>,
    /// Widths of the network (paper: wide).
    pub network: Network,
    /// Points of a cloud (paper: 1024 of 2048).
    pub points: usize,
    /// Whether shapes are deformed by scale, shear and mirror (paper: yes; design table, column
    /// "augm.").
    pub augmentation: bool,
    /// What the policy looks at: keys `cut`, in sixteenths of the target's radius, and `focus`; 0 looks at
    /// everything (paper).
    #[serde(flatten)]
    pub sight: Sight,
    /// Partial views and outliers in sources.
    #[serde(default)]
    pub disturbance: Disturbance,
    /// Learning rate (paper: from 1e-3 in pretrain, from 1e-4 after; halved every 10 epochs; from 1e-3 and
    /// halved every 20 for data in BOP layout).
    pub learning_rate: LearningRate,
    /// Steps, trajectories and batch sizes.
    pub roll_out: RollOut,
    /// What an update does.
    pub method: Method,
    /// Share of the training meshes held back to choose the best checkpoint (ours; the authors' code
    /// chooses on the test split).
    pub validation: f64,
    /// Pairs that one validation registers, of the meshes held back in turn.
    pub validation_pairs: usize,
    /// Minutes between checkpoints within an epoch; 0 writes one after every update.
    pub checkpoint_minutes: f64,
}

impl TrainConfig {
    /// The paper's configuration of a stage.
    pub fn new(stage: Stage, data: Vec<DataSource>, out: PathBuf) -> Self {
        let (initial, alpha) = match stage {
            Stage::Pretrain => (1e-3, 0.0),
            Stage::Il => (1e-4, 0.0),
            Stage::Ilrl => (1e-4, 2.0),
        };
        // The paper's LINEMOD experiment has no pre-training, a longer schedule and a smaller alpha.
        let views = data.iter().any(|d| matches!(d, DataSource::Views(_)));
        let poses = data.iter().any(|d| matches!(d, DataSource::Bop(_)));
        let (initial, alpha, epochs, halve_every) = if poses {
            (1e-3, f32::min(alpha, 0.1), 100, 20)
        } else {
            (initial, alpha, 50, 10)
        };
        TrainConfig {
            data,
            categories: Categories::First,
            stage,
            out,
            epochs,
            seed: SEED,
            threads: 0,
            init: None,
            network: Network::Wide,
            points: 1024,
            augmentation: true,
            sight: if views { VIEWS } else { Sight::ALL },
            disturbance: Disturbance::NONE,
            learning_rate: LearningRate {
                initial,
                halve_every,
                anneal: Anneal::Halve,
            },
            roll_out: RollOut::default(),
            method: Method::new(alpha),
            validation: 0.04,
            validation_pairs: 100,
            checkpoint_minutes: 5.0,
        }
    }

    /// Refuses options that contradict each other.
    pub(super) fn check(&self) -> Result<(), TrainError> {
        let off_policy = self.method.follow != Follow::Stochastic;
        if off_policy && self.method.ppo.on() {
            return Err(TrainError::Contradiction(
                "reinforcement learns from the agent's own random actions: train without it (stage pretrain or il, or alpha 0), or follow the stochastic policy",
            ));
        }
        Ok(())
    }

    /// Updates of the whole run over so many clouds. The last buffer may reach beyond the last epoch.
    pub fn updates(&self, clouds: usize) -> u64 {
        (u64::from(self.epochs) * clouds as u64).div_ceil(self.roll_out.problems as u64)
    }

    /// The epoch in which an update starts.
    pub fn epoch_of(&self, update: u64, clouds: usize) -> u32 {
        (update * self.roll_out.problems as u64 / clouds as u64) as u32
    }

    /// Whether the robot's code can run what is trained here.
    pub fn deployable(&self) -> bool {
        self.network.shape().deployed().is_some()
            && self.method.accumulation == Accumulation::Global
    }
}
