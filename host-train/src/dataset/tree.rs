//! Directories of loose meshes and clouds, one model a file.
//!
//! ```text
//! DIR/chair/train/chair_0001.off      the original ModelNet40: CATEGORY/SPLIT/FILE
//! DIR/test/chair/scan.pcd             or SPLIT/CATEGORY/FILE
//! DIR/02691156/1a04e3ea/models/m.obj  ShapeNet: CATEGORY/…/FILE
//! DIR/part.stl                        no categories at all
//! ```
//!
//! The category is the first folder that is not a split. Labels number the categories of both splits in
//! alphabetical order, so that they do not depend on the split that is read. Folders `train` (and `val`) and `test`
//! divide the files; without any of them every file is in both splits, and a warning says so.
//!
//! Each file gives 2048 points: drawn evenly from the surface of a mesh, at random from a larger cloud, or with
//! repetitions from a smaller one. They are normalised like ModelNet40's: mean at the origin, farthest point at 1.

use super::cloud_file::{CloudError, EXTENSIONS, MESH_POINTS, extension, read_surface};
use super::mesh::normalise;
use super::{DatasetError, MAX_BYTES, Model, Point, Split};
use crate::random::resample;
use crate::random::{Purpose, stream};
use crate::words::count;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use walkdir::{DirEntry, WalkDir};

/// Extensions that may be other text, such as lists of names.
const NO_MODELS: [&str; 2] = ["txt", "csv"];

/// A model's file and what its path says.
struct Entry {
    path: PathBuf,
    /// Folders below the one that all files share, without splits.
    folders: Vec<String>,
    split: Option<Split>,
}

/// A model's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Where it is.
    pub path: PathBuf,
    /// Its index among all files of the directory.
    pub index: u64,
    /// Its category.
    pub label: u32,
}

/// Loads all models of a split, in the order of their paths. The points of file `i` of the directory depend only on
/// the seed and `i`.
///
/// # Errors
/// A directory without models, with none of the split, or with too many; the first file that is unreadable or degenerate.
pub fn load(dir: &Path, split: Split, seed: u64) -> Result<Vec<Model>, DatasetError> {
    let files = files(dir, split)?;
    if (files.len() * MESH_POINTS * size_of::<Point>()) as u64 > MAX_BYTES {
        return Err(DatasetError::BeyondMemory { path: dir.into() });
    }
    let models = files.into_par_iter().map(|file| {
        Ok(Model {
            points: read(&file.path, seed, file.index)?,
            label: file.label,
        })
    });
    // The first error in the order of the files, whichever thread is faster.
    let models: Vec<Result<Model, CloudError>> = models.collect();
    Ok(models.into_iter().collect::<Result<_, _>>()?)
}

/// The files of a split, in the order of their paths.
///
/// # Errors
/// A directory without models, or without any of the split.
pub fn files(dir: &Path, split: Split) -> Result<Vec<File>, DatasetError> {
    let entries = list(dir)?;
    let categories: BTreeSet<&str> = entries.iter().map(Entry::category).collect();
    let categories: Vec<&str> = categories.into_iter().collect();
    let divided = entries.iter().any(|entry| entry.split.is_some());
    if !divided {
        tracing::warn!(
            "{}: no folders train and test divide it: training and evaluation read the same {}",
            dir.display(),
            count(entries.len(), "file", "files")
        );
    }
    // Next to a folder of test files, all other files are for training.
    let taken = |entry: &Entry| !divided || entry.split.unwrap_or(Split::Train) == split;
    let chosen: Vec<File> = (0..)
        .zip(&entries)
        .filter(|(_, entry)| taken(entry))
        .map(|(index, entry)| File {
            path: entry.path.clone(),
            index,
            label: categories
                .binary_search(&entry.category())
                .unwrap_or_default() as u32,
        })
        .collect();
    if chosen.is_empty() {
        return Err(DatasetError::EmptySplit {
            dir: dir.into(),
            split,
            files: entries.len(),
        });
    }
    Ok(chosen)
}

fn read(path: &Path, seed: u64, index: u64) -> Result<Vec<Point>, CloudError> {
    let rng = &mut stream(seed, Purpose::Surface, index);
    let surface = read_surface(path, rng)?;
    let mut points = surface.relative_to(surface.origin());
    if points.len() != MESH_POINTS {
        points = resample(rng, &points, MESH_POINTS);
    }
    normalise(&mut points).ok_or(CloudError::NoExtent { path: path.into() })?;
    Ok(points)
}

impl Entry {
    fn category(&self) -> &str {
        self.folders.first().map_or("", String::as_str)
    }
}

/// Everything below a directory in the order of the paths, without hidden entries.
pub(crate) fn walk(dir: &Path) -> impl Iterator<Item = walkdir::Result<DirEntry>> {
    let hidden = |entry: &DirEntry| {
        let name = entry.file_name().to_string_lossy();
        entry.depth() > 0 && (name.starts_with('.') || name == "__MACOSX")
    };
    let walk = WalkDir::new(dir).follow_links(true).sort_by_file_name();
    walk.into_iter().filter_entry(move |entry| !hidden(entry))
}

fn list(dir: &Path) -> Result<Vec<Entry>, DatasetError> {
    let mut entries = Vec::new();
    for item in walk(dir) {
        let item = item.map_err(|e| DatasetError::Io {
            path: e.path().unwrap_or(dir).into(),
            source: e.into(),
        })?;
        let extension = extension(item.path());
        let is_model = EXTENSIONS.contains(&&*extension) && !NO_MODELS.contains(&&*extension);
        if item.file_type().is_file() && is_model {
            entries.push(entry(dir, item.into_path()));
        }
    }
    if entries.is_empty() {
        return Err(DatasetError::NoModels { dir: dir.into() });
    }
    // A folder around everything, as archives have, is not a category.
    while let Some(first) = entries[0].folders.first().cloned() {
        if entries
            .iter()
            .any(|entry| entry.folders.first() != Some(&first))
        {
            break;
        }
        for entry in &mut entries {
            entry.folders.remove(0);
        }
    }
    Ok(entries)
}

fn entry(dir: &Path, path: PathBuf) -> Entry {
    let below = path.strip_prefix(dir).unwrap_or(&path).parent();
    let mut split = None;
    let mut folders = Vec::new();
    for folder in below.into_iter().flat_map(Path::iter) {
        let name = folder.to_string_lossy().into_owned();
        match name.to_ascii_lowercase().as_str() {
            "train" | "val" if split.is_none() => split = Some(Split::Train),
            "test" if split.is_none() => split = Some(Split::Test),
            _ => folders.push(name),
        }
    }
    Entry {
        path,
        folders,
        split,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFF: &str = "OFF\n4 2 0\n0 0 0\n3 0 0\n0 4 0\n0 0 9\n3 0 1 2\n3 0 1 3\n";

    /// A directory with these files, each holding the same mesh or, as `.xyz`, three points.
    fn directory(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("temporary directory");
        for file in files {
            let path = dir.path().join(file);
            std::fs::create_dir_all(path.parent().expect("below")).expect("folder");
            let text = if file.ends_with("xyz") {
                "5 5 5\n6 5 5\n5 5 7\n"
            } else {
                OFF
            };
            std::fs::write(path, text).expect("written");
        }
        dir
    }

    fn labels(dir: &Path, split: Split) -> Vec<u32> {
        let models = load(dir, split, 1).expect("models");
        models.iter().map(|model| model.label).collect()
    }

    #[test]
    fn the_trees_of_the_archives_are_understood() {
        let modelnet = directory(&[
            "ModelNet40/README.txt",
            "ModelNet40/airplane/train/a1.off",
            "ModelNet40/airplane/train/a2.off",
            "ModelNet40/airplane/test/a3.off",
            "ModelNet40/chair/test/c1.off",
            "ModelNet40/.cache/x.off",
            "__MACOSX/ModelNet40/chair/test/c1.off",
        ]);
        for root in [modelnet.path(), &modelnet.path().join("ModelNet40")] {
            assert_eq!(labels(root, Split::Train), [0, 0]);
            assert_eq!(
                labels(root, Split::Test),
                [0, 1],
                "labels do not depend on the split"
            );
        }
        let split_first = directory(&["train/a/1.off", "TEST/b/1.xyz", "val/b/2.off"]);
        assert_eq!(labels(split_first.path(), Split::Train), [0, 1]);
        assert_eq!(labels(split_first.path(), Split::Test), [1]);
        let shapenet = directory(&[
            "02691156/1a/models/m.off",
            "02691156/1b/models/m.off",
            "03001627/1c/models/m.off",
        ]);
        assert_eq!(labels(shapenet.path(), Split::Test), [0, 0, 1]);
        let flat = directory(&["b.off", "a.xyz", "notes.md"]);
        assert_eq!(labels(flat.path(), Split::Train), [0, 0]);
    }

    #[test]
    fn every_model_is_normalised_and_has_2048_points_of_its_own() {
        let dir = directory(&["a.off", "b.off", "c.xyz"]);
        let models = load(dir.path(), Split::Train, 1).expect("models");
        for model in &models {
            assert_eq!(model.points.len(), MESH_POINTS);
            let norms = model
                .points
                .iter()
                .map(|p| p.iter().map(|x| x * x).sum::<f32>().sqrt());
            assert!((norms.fold(0.0, f32::max) - 1.0).abs() < 1e-5);
        }
        assert_ne!(models[0], models[1], "the same mesh, another draw");
        assert_eq!(models, load(dir.path(), Split::Test, 1).expect("models"));
        assert_ne!(models, load(dir.path(), Split::Train, 2).expect("models"));
        let one = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .expect("a thread");
        assert_eq!(
            models,
            one.install(|| load(dir.path(), Split::Train, 1))
                .expect("models")
        );
    }

    #[test]
    fn what_is_missing_or_broken_is_named() {
        let said = |dir: &Path, split| {
            load(dir, split, 1)
                .expect_err("must be refused")
                .to_string()
        };
        let empty = directory(&["notes.md"]);
        assert!(said(empty.path(), Split::Train).contains("train_files.txt"));
        let divided = directory(&["train/a.off"]);
        assert!(said(divided.path(), Split::Test).contains("put some under test/"));
        let broken = directory(&["a.off", "c/b.off", "c/d.off"]);
        for name in ["c/b.off", "c/d.off"] {
            std::fs::write(broken.path().join(name), "OFF\n3 1 0\n").expect("written");
        }
        assert!(said(broken.path(), Split::Train).contains("c/b.off: it ends after 0 of 3"));
        std::fs::write(broken.path().join("a.off"), "OFF\n1 0 0\n1 1 1\n").expect("written");
        assert!(said(broken.path(), Split::Train).contains("a.off: all points coincide"));
    }
}
