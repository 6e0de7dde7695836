//! Import of the authors' published checkpoints (PyTorch).

mod archive;
mod pickle;

use crate::learn::nn::{Parameters, Shape};
use archive::Archive;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A dense f32 tensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Sizes of the axes; `[out, in]` for weights, `[out]` for biases.
    pub shape: Vec<usize>,
    /// Row-major values.
    pub data: Vec<f32>,
}

/// Why a checkpoint was refused.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system refused to read.
    #[error("{}: {source}", path.display())]
    Io {
        /// File concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not a ZIP archive; PyTorch before 1.6 wrote bare pickles.
    #[error(
        "{}: not a PyTorch archive (ZIP); if it is of PyTorch before 1.6, load it and torch.save it with a newer one",
        path.display()
    )]
    NotArchive {
        /// File concerned.
        path: PathBuf,
    },
    /// The archive or its pickle cannot be read.
    #[error("{}: broken PyTorch archive ({reason}); fetch it again", path.display())]
    Broken {
        /// File concerned.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The archive holds neither a state dict nor one under `model_state_dict`.
    #[error("{}: neither a state dict nor a dict with \"model_state_dict\"", path.display())]
    NoStateDict {
        /// File concerned.
        path: PathBuf,
    },
    /// A parameter of the network is missing from the state dict, or one too many is in it.
    #[error("{}: {what} parameter \"{name}\"; this is not a checkpoint of the ReAgent network", path.display())]
    Names {
        /// File concerned.
        path: PathBuf,
        /// `missing` or `unknown`.
        what: &'static str,
        /// The parameter, by the authors' name.
        name: String,
    },
    /// A parameter cannot be read.
    #[error("{}: parameter \"{name}\": {reason}", path.display())]
    BadTensor {
        /// File concerned.
        path: PathBuf,
        /// The parameter, by the authors' name.
        name: String,
        /// What is wrong.
        reason: String,
    },
}

/// Layers by the authors' name and by ours; each has a `.weight` and a `.bias`.
pub const NAMES: [(&str, &str); 11] = [
    ("state_emb.conv1", "embed.conv1"),
    ("state_emb.conv2", "embed.conv2"),
    ("state_emb.conv3", "embed.conv3"),
    ("actor_critic.emb_t.0", "head_t.fc1"),
    ("actor_critic.emb_t.2", "head_t.fc2"),
    ("actor_critic.action_t", "policy_t"),
    ("actor_critic.emb_r.0", "head_r.fc1"),
    ("actor_critic.emb_r.2", "head_r.fc2"),
    ("actor_critic.action_r", "policy_r"),
    ("actor_critic.emb_v.0", "value.fc1"),
    ("actor_critic.value", "value.fc2"),
];

/// The network in a checkpoint of the authors' code, value head included: the paper's shape, or the compact one.
pub fn pytorch(path: &Path) -> Result<Parameters, ImportError> {
    let tensors = read_pytorch(path)?;
    let features = tensors["embed.conv3.bias"].data.len();
    let is_compact = features == Shape::COMPACT.embed[2];
    let mut parameters = Parameters::zeros(if is_compact {
        Shape::COMPACT
    } else {
        Shape::PAPER
    });
    for i in 0..parameters.layers.len() {
        let layer = parameters.layers[i].clone();
        let (weight, bias) = parameters.layer_mut(i);
        for (part, values, shape) in [
            ("weight", weight, vec![layer.outputs, layer.inputs]),
            ("bias", bias, vec![layer.outputs]),
        ] {
            let name = format!("{}.{part}", layer.name);
            let tensor = &tensors[&name];
            if tensor.shape != shape {
                return Err(ImportError::BadTensor {
                    path: path.into(),
                    name,
                    reason: format!("shape {:?}, expected {shape:?}", tensor.shape),
                });
            }
            values.copy_from_slice(&tensor.data);
        }
    }
    Ok(parameters)
}

/// Reads a checkpoint of the authors' code: all 22 parameters under our names (`embed.conv1.weight` …), weights as
/// `[out, in]`, biases as `[out]`, all finite. Sizes are not checked against a network.
///
/// No code in the file is executed: its pickle is read as data.
pub fn read_pytorch(path: &Path) -> Result<BTreeMap<String, Tensor>, ImportError> {
    let mut archive = Archive::open(path)?;
    let names = |what, name: &str| ImportError::Names {
        path: path.into(),
        what,
        name: name.into(),
    };
    let entries = std::mem::take(&mut archive.entries);
    let mut tensors = BTreeMap::new();
    for (theirs, id) in &entries {
        let ours = our_name(theirs).ok_or_else(|| names("unknown", theirs))?;
        let rank = if theirs.ends_with(".weight") { 2 } else { 1 };
        let mut tensor = archive.tensor(theirs, *id)?;
        let bad = |reason| ImportError::BadTensor {
            path: path.into(),
            name: theirs.clone(),
            reason,
        };
        // The authors' layers are convolutions of width 1: [out, in, 1].
        while tensor.shape.len() > rank && tensor.shape.last() == Some(&1) {
            tensor.shape.pop();
        }
        if tensor.shape.len() != rank {
            return Err(bad(format!(
                "shape {:?}, expected {rank} axes",
                tensor.shape
            )));
        }
        if let Some(index) = tensor.data.iter().position(|x| !x.is_finite()) {
            return Err(bad(format!("element {index} is NaN or infinite")));
        }
        tensors.insert(ours, tensor);
    }
    for (theirs, ours) in NAMES {
        for part in ["weight", "bias"] {
            if !tensors.contains_key(&format!("{ours}.{part}")) {
                return Err(names("missing", &format!("{theirs}.{part}")));
            }
        }
    }
    Ok(tensors)
}

fn our_name(theirs: &str) -> Option<String> {
    let (layer, part) = theirs.rsplit_once('.')?;
    let known = NAMES
        .iter()
        .find(|(name, _)| *name == layer && matches!(part, "weight" | "bias"));
    known.map(|(_, ours)| format!("{ours}.{part}"))
}

#[cfg(test)]
mod tests;
