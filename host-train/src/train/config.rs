//! Every hyper-parameter of a run, with the source of its default.

use crate::expert::Expert;
use crate::optim::Schedule;
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
    /// The built-in parametric shapes, this many.
    Procedural(usize),
}

impl FromStr for DataSource {
    type Err = String;

    /// `procedural`, `procedural:COUNT`, or a directory.
    fn from_str(s: &str) -> Result<Self, String> {
        match s.strip_prefix("procedural") {
            Some("") => Ok(DataSource::Procedural(1024)),
            Some(count) if count.starts_with(':') => match count[1..].parse() {
                Ok(n) if n > 0 => Ok(DataSource::Procedural(n)),
                _ => Err(format!(
                    "\"{s}\": write procedural:COUNT with a count above 0"
                )),
            },
            _ => Ok(DataSource::Directory(s.into())),
        }
    }
}

impl fmt::Display for DataSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DataSource::Directory(path) => path.display().fmt(f),
            DataSource::Procedural(count) => write!(f, "procedural:{count}"),
        }
    }
}

/// Which part of the method runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Imitation on clean clouds, learning rate from 1e-3.
    Pretrain,
    /// Imitation on noisy clouds, learning rate from 1e-4.
    Il,
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
    /// Passes over the clouds (paper: 50 a stage).
    pub epochs: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Worker threads; 0 takes all cores. Results do not depend on it.
    pub threads: usize,
    /// Start from this run, checkpoint or policy; `None` starts from random weights.
    pub init: Option<PathBuf>,
    /// Points a cloud (paper: 1024 of 2048).
    pub points: usize,
    /// Learning rate and its halvings (paper: 1e-3 in pretrain, 1e-4 after; halved every 10 epochs).
    pub schedule: Schedule,
    /// Who labels the observations (paper: steady).
    pub expert: Expert,
    /// Steps, trajectories and batch sizes.
    pub roll_out: RollOut,
    /// Share of the training meshes held back to choose the best checkpoint (ours; the authors' code
    /// chooses on the test split).
    pub validation: f64,
    /// Most pairs that one validation registers.
    pub validation_pairs: usize,
}

/// How observations are gathered and used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RollOut {
    /// Problems rolled out together (authors' code: 32).
    pub problems: usize,
    /// Trajectories from each problem, N (paper: 4).
    pub trajectories: usize,
    /// Steps of a trajectory, n (paper: 10).
    pub steps: usize,
    /// Observations of one optimiser step (paper: 32).
    pub mini_batch: usize,
}

impl Default for RollOut {
    fn default() -> Self {
        RollOut {
            problems: 32,
            trajectories: 4,
            steps: 10,
            mini_batch: 32,
        }
    }
}

impl RollOut {
    /// Observations in one replay buffer (paper: 1280).
    pub fn observations(&self) -> usize {
        self.problems * self.trajectories * self.steps
    }
}

impl TrainConfig {
    /// The paper's configuration of a stage.
    pub fn new(stage: Stage, data: Vec<DataSource>, out: PathBuf) -> Self {
        TrainConfig {
            data,
            categories: Categories::First,
            stage,
            out,
            epochs: 50,
            seed: 42,
            threads: 0,
            init: None,
            points: 1024,
            schedule: Schedule {
                initial: match stage {
                    Stage::Pretrain => 1e-3,
                    Stage::Il => 1e-4,
                },
                halve_every: 10,
            },
            expert: Expert::Steady,
            roll_out: RollOut::default(),
            validation: 0.04,
            validation_pairs: 100,
        }
    }
}
