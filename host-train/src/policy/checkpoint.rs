//! The state of a training run on disk: parameters, optimiser and progress, as one safetensors file.

mod seal;

use crate::files;
use crate::learn::env::Accumulation;
use crate::learn::nn::{Parameters, Shape};
use crate::learn::optim::Adam;
use reagent_core::cut::Cut;
use reagent_core::sight::Sight;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Name of the newest checkpoint in a run directory.
pub const LAST: &str = "last.safetensors";
/// Name of the one before it.
pub const PREVIOUS: &str = "previous.safetensors";
/// Name of the best checkpoint by validation in a run directory.
pub const BEST: &str = "best/checkpoint.safetensors";

/// Name of the tensor that holds the average of the parameters.
const AVERAGED: &str = "averaged";
/// Field of the header that says how actions accumulate.
const ACCUMULATION: &str = "accumulation";
const CUT: &str = "cut";
const FOCUS: &str = "focus";

/// Whether a path names a run directory or a checkpoint.
pub fn is_checkpoint(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|e| e == "safetensors")
}

/// Why a checkpoint could not be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// There is none.
    #[error(
        "no checkpoint at {0}: give a run directory (with {BEST} or {LAST}) or a checkpoint file"
    )]
    Missing(PathBuf),
    /// The file could not be read.
    #[error("cannot read checkpoint {path}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("cannot write checkpoint {path}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is torn or not a checkpoint.
    #[error("checkpoint {path} is damaged or of another kind: {what}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// How far a run has come.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Updates (replay buffers) processed.
    pub updates: u64,
    /// Mini-batches processed in this stage.
    pub optimiser_steps: u64,
    /// Lowest validation error so far, and the epoch that reached it.
    pub best: Option<(f64, u32)>,
    /// Sums over the epoch in progress.
    #[serde(default)]
    pub epoch: EpochSums,
}

/// Sums over the updates of an epoch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpochSums {
    /// Updates.
    pub updates: u32,
    /// Their losses.
    pub loss: f64,
    /// Their agreements with the expert.
    pub agreement: f64,
    /// Their mean rewards, where there are any.
    pub reward: Option<f64>,
}

/// Everything that a run needs to go on.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// The network.
    pub parameters: Parameters,
    /// The optimiser.
    pub adam: Adam,
    /// Average of the parameters, where the run keeps one.
    pub averaged: Option<Vec<f32>>,
    /// How the network's actions accumulate.
    pub accumulation: Accumulation,
    /// What the network looks at of both clouds.
    pub sight: Sight,
    /// Counters. With the seed they determine the state of every random stream and the order of the data.
    /// Checkpoints are taken between updates, when the replay buffer is empty.
    pub progress: Progress,
}

impl Checkpoint {
    /// The checkpoint that a path names: the file itself, or a run directory's best, last or previous one, in this order.
    pub fn find(run_or_checkpoint: &Path) -> Result<PathBuf, CheckpointError> {
        let candidates = [
            run_or_checkpoint.join(BEST),
            run_or_checkpoint.join(LAST),
            run_or_checkpoint.join(PREVIOUS),
            run_or_checkpoint.into(),
        ];
        candidates
            .into_iter()
            .find(|path| path.is_file())
            .ok_or_else(|| CheckpointError::Missing(run_or_checkpoint.into()))
    }

    /// The start of a run from given parameters, with a fresh optimiser.
    pub fn start(parameters: Parameters, accumulation: Accumulation, sight: Sight) -> Self {
        Checkpoint {
            adam: Adam::new(parameters.values.len()),
            parameters,
            averaged: None,
            accumulation,
            sight,
            progress: Progress::default(),
        }
    }

    /// The network to validate, deploy, or start another run from: the average if there is one.
    pub fn result(mut self) -> Parameters {
        if let Some(averaged) = self.averaged {
            self.parameters.values = averaged;
        }
        self.parameters
    }

    /// The newest whole checkpoint of a run directory; `None` where there is none. If the last one is damaged, the
    /// one before it is taken, with a warning on stderr.
    pub fn load_newest(run: &Path) -> Result<Option<Self>, CheckpointError> {
        let (last, previous) = (run.join(LAST), run.join(PREVIOUS));
        match (last.is_file(), previous.is_file()) {
            (false, false) => Ok(None),
            (false, true) => Self::load(&previous).map(Some),
            (true, kept) => match Self::load(&last) {
                Err(error @ CheckpointError::Damaged { .. }) if kept => {
                    let newest = Self::load(&previous)?;
                    eprintln!("{error}; going on from {PREVIOUS}");
                    // Moved away, lest it take the place of the whole one.
                    rename(&last, &run.join("damaged.safetensors"))?;
                    Ok(Some(newest))
                }
                loaded => loaded.map(Some),
            },
        }
    }

    /// Writes the newest checkpoint of a run directory and keeps the one before it, so that there is always a whole one.
    pub fn save_newest(&self, run: &Path) -> Result<(), CheckpointError> {
        let (last, next) = (run.join(LAST), run.join("next.safetensors"));
        self.save(&next)?;
        if last.is_file() {
            rename(&last, &run.join(PREVIOUS))?;
        }
        rename(&next, &last)
    }

    /// Writes the checkpoint, whole or not at all.
    pub fn save(&self, path: &Path) -> Result<(), CheckpointError> {
        let write = |source| CheckpointError::Write {
            path: path.into(),
            source,
        };
        let mut tensors = Vec::new();
        let mut add = |name: String, shape: Vec<usize>, values: &[f32]| {
            let bytes: Vec<u8> = bytemuck::cast_slice(values).to_vec();
            tensors.push((name, shape, bytes));
        };
        for (i, layer) in self.parameters.layers.iter().enumerate() {
            let shape = vec![layer.outputs, layer.inputs];
            add(
                format!("{}.weight", layer.name),
                shape,
                self.parameters.weight(i),
            );
            add(
                format!("{}.bias", layer.name),
                vec![layer.outputs],
                self.parameters.bias(i),
            );
        }
        for (name, values) in self.moments() {
            add(name.into(), vec![values.len()], values);
        }
        if let Some(values) = &self.averaged {
            add(AVERAGED.into(), vec![values.len()], values);
        }
        let views = tensors.iter().map(|(name, shape, bytes)| {
            let view = TensorView::new(Dtype::F32, shape.clone(), bytes);
            (
                name.as_str(),
                view.expect("shape and bytes are those of the values"),
            )
        });
        let progress = serde_json::to_string(&self.progress).map_err(|e| write(e.into()))?;
        let shape = serde_json::to_string(&self.parameters.shape).map_err(|e| write(e.into()))?;
        let accumulation =
            serde_json::to_string(&self.accumulation).map_err(|e| write(e.into()))?;
        let metadata = HashMap::from([
            ("progress".into(), progress),
            ("shape".into(), shape),
            (ACCUMULATION.into(), accumulation),
            (CUT.into(), self.sight.cut.header().to_string()),
            (FOCUS.into(), self.sight.focus.to_string()),
        ]);
        let bytes = safetensors::serialize(views, Some(metadata))
            .map_err(|e| write(std::io::Error::other(e)))?;
        let sealed = seal::seal(&bytes).map_err(|e| write(std::io::Error::other(e)))?;
        files::write(path, &sealed).map_err(write)
    }

    /// Reads a checkpoint.
    pub fn load(path: &Path) -> Result<Self, CheckpointError> {
        let damaged = |what: String| CheckpointError::Damaged {
            path: path.into(),
            what,
        };
        let bytes = std::fs::read(path).map_err(|source| CheckpointError::Read {
            path: path.into(),
            source,
        })?;
        seal::check(&bytes).map_err(damaged)?;
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| damaged(e.to_string()))?;
        let field = |name: &str| {
            let found = header.metadata().as_ref().and_then(|m| m.get(name));
            found.ok_or_else(|| damaged(format!("it has no \"{name}\"")))
        };
        let shape: Shape =
            serde_json::from_str(field("shape")?).map_err(|e| damaged(e.to_string()))?;
        let progress: Progress =
            serde_json::from_str(field("progress")?).map_err(|e| damaged(e.to_string()))?;
        // Absent from checkpoints that are older than this setting.
        let accumulation = match field(ACCUMULATION) {
            Ok(text) => serde_json::from_str(text).map_err(|e| damaged(e.to_string()))?,
            Err(_) => Accumulation::Global,
        };
        let cut = match field(CUT) {
            Ok(text) => Cut::from_header(text.parse().map_err(|_| damaged(format!("cut {text}")))?),
            Err(_) => Cut::NONE,
        };
        let focus = match field(FOCUS) {
            Ok(text) => text.parse().map_err(|_| damaged(format!("focus {text}")))?,
            Err(_) => 0,
        };
        let sight = Sight { cut, focus };
        let file = SafeTensors::deserialize(&bytes).map_err(|e| damaged(e.to_string()))?;
        let read = |name: &str, into: &mut [f32]| -> Result<(), CheckpointError> {
            let tensor = file.tensor(name).map_err(|e| damaged(e.to_string()))?;
            if tensor.dtype() != Dtype::F32 || tensor.data().len() != 4 * into.len() {
                return Err(damaged(format!(
                    "{name} is {:?} {:?} where {} f32 were expected",
                    tensor.dtype(),
                    tensor.shape(),
                    into.len()
                )));
            }
            for (value, raw) in into.iter_mut().zip(tensor.data().chunks_exact(4)) {
                *value = f32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]]);
            }
            Ok(())
        };
        if !shape.is_sound() {
            return Err(damaged(format!("no network has the shape {shape:?}")));
        }
        let mut parameters = Parameters::zeros(shape);
        for i in 0..parameters.layers.len() {
            let name = parameters.layers[i].name;
            let (weight, bias) = parameters.layer_mut(i);
            read(&format!("{name}.weight"), weight)?;
            read(&format!("{name}.bias"), bias)?;
        }
        let mut adam = Adam::new(parameters.values.len());
        adam.steps = progress.optimiser_steps;
        read("adam.first", &mut adam.first)?;
        read("adam.second", &mut adam.second)?;
        read("adam.highest", &mut adam.highest)?;
        let mut averaged = None;
        if file.names().contains(&AVERAGED) {
            let values = averaged.insert(vec![0.0; parameters.values.len()]);
            read(AVERAGED, values)?;
        }
        Ok(Checkpoint {
            parameters,
            adam,
            averaged,
            accumulation,
            sight,
            progress,
        })
    }

    fn moments(&self) -> [(&'static str, &[f32]); 3] {
        [
            ("adam.first", &self.adam.first),
            ("adam.second", &self.adam.second),
            ("adam.highest", &self.adam.highest),
        ]
    }
}

fn rename(from: &Path, to: &Path) -> Result<(), CheckpointError> {
    std::fs::rename(from, to).map_err(|source| CheckpointError::Write {
        path: to.into(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_survives_the_disk_and_a_cut_is_refused() {
        let shape = Shape {
            extra: 1,
            embed: [16, 16, 32],
            head: [16, 16],
        };
        let parameters = Parameters::random(shape, 3);
        let mut adam = Adam::new(parameters.values.len());
        let parameters_len = parameters.values.len();
        adam.steps = 7;
        adam.first.fill(0.25);
        let checkpoint = Checkpoint {
            parameters,
            adam,
            averaged: Some(vec![0.5; parameters_len]),
            accumulation: Accumulation::Local,
            sight: Sight {
                cut: Cut::from_header(24),
                focus: 3,
            },
            progress: Progress {
                updates: 5,
                optimiser_steps: 7,
                best: Some((1.5, 2)),
                epoch: EpochSums::default(),
            },
        };
        let directory = tempfile::tempdir().expect("a temporary directory");
        let path = directory.path().join(LAST);
        checkpoint.save(&path).expect("written");
        assert_eq!(Checkpoint::find(directory.path()).expect("found"), path);
        assert_eq!(Checkpoint::load(&path).expect("read"), checkpoint);

        // Equal contents make equal files.
        let bytes = std::fs::read(&path).expect("read");
        let again = directory.path().join("again.safetensors");
        checkpoint.save(&again).expect("written");
        assert!(std::fs::read(&again).expect("read") == bytes);

        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("written");
            matches!(
                Checkpoint::load(&path),
                Err(CheckpointError::Damaged { .. })
            )
        };
        assert!(refused(&bytes[..bytes.len() / 2]));
        // Every bit of the header, and a sample of what follows.
        let header = 8 + u64::from_le_bytes(*bytes.first_chunk().expect("a length")) as usize;
        let sampled = (header..bytes.len()).step_by(977);
        for at in (0..header)
            .step_by(3)
            .chain(sampled)
            .chain([bytes.len() - 1])
        {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << (at % 8);
            assert!(refused(&flipped), "bit {} of byte {at}", at % 8);
        }
        assert!(!refused(&bytes));
    }
}
