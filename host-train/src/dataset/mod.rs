//! Sources of clouds.
//!
//! [`load`] reads whatever a directory holds. A data set is kept in memory: a model's 2048 points take 24 KiB,
//! ModelNet40 300 MiB, ShapeNet's 51,000 models 1.2 GiB. Data sets above [`MAX_BYTES`] are refused.

pub mod bop;
pub mod cloud_file;
pub mod depth;
mod error;
pub mod h5;
pub mod mesh;
pub mod modelnet;
pub mod outside;
pub mod pairs;
pub mod pixels;
pub mod procedural;
pub mod raster;
#[cfg(not(target_family = "wasm"))]
pub mod ros;
pub mod solids;
pub mod tree;
pub mod triangulate;
pub mod winding;

pub use error::{DatasetError, MODELNET40_URL};

use std::fmt;
use std::path::{Path, PathBuf};

/// Most memory that the clouds of a data set may take.
pub const MAX_BYTES: u64 = 8 << 30;

/// A point in a cloud's own units.
pub type Point = [f32; 3];

/// One model's cloud as a data set holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Points, `[N, 3]`, normalised units (mean at the origin, farthest point at 1).
    pub points: Vec<Point>,
    /// Category index.
    pub label: u32,
}

/// A part of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Models to train on, and to choose a checkpoint by.
    Train,
    /// Models that training never sees.
    Test,
}

impl Split {
    /// The list of its files in the layout of ModelNet40.
    fn list(self) -> &'static str {
        match self {
            Split::Train => "train_files.txt",
            Split::Test => "test_files.txt",
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Split::Train => "train",
            Split::Test => "test",
        })
    }
}

/// Loads the models of a split of the data set at `path`, whose layout is told by what lies there:
///
/// | `path` | layout |
/// |---|---|
/// | a directory with `train_files.txt` or `test_files.txt` | modelnet40_ply_hdf5_2048 ([`modelnet::load`]) |
/// | a directory with `training_objectdataset.h5` or `test_objectdataset.h5`, itself or in `main_split_nobg` | ScanObjectNN |
/// | an `.h5` file | clouds and labels of that file, whichever the split |
/// | another directory | loose meshes and clouds ([`tree::load`]) |
///
/// The seed draws the points of meshes.
pub fn load(path: &Path, split: Split, seed: u64) -> Result<Vec<Model>, DatasetError> {
    if path.is_file() {
        return modelnet::load_file(path);
    }
    if !path.is_dir() {
        return Err(DatasetError::NoDirectory { dir: path.into() });
    }
    if [Split::Train, Split::Test]
        .iter()
        .any(|split| path.join(split.list()).is_file())
    {
        return modelnet::load(path, split);
    }
    match scans(path, split) {
        Some(file) => modelnet::load_file(&file),
        None => tree::load(path, split, seed),
    }
}

/// The file of a ScanObjectNN split, if `dir` has that layout.
fn scans(dir: &Path, split: Split) -> Option<PathBuf> {
    let [train, test] = ["training_objectdataset.h5", "test_objectdataset.h5"];
    let folders = [
        dir.to_path_buf(),
        dir.join("main_split_nobg"),
        dir.join("h5_files/main_split_nobg"),
    ];
    let mut folders = folders.into_iter();
    let folder =
        folders.find(|folder| folder.join(train).is_file() || folder.join(test).is_file())?;
    Some(folder.join(match split {
        Split::Train => train,
        Split::Test => test,
    }))
}
