//! Data sets in the layout of the [BOP benchmark](https://bop.felk.cvut.cz/datasets), such as LINEMOD.
//!
//! | path | what |
//! |---|---|
//! | `models_eval/obj_NNNNNN.ply` | meshes, millimetres (`models/` where that is absent) |
//! | `models_eval/models_info.json` | `diameter`, `symmetries_discrete`, `symmetries_continuous`; `name` is our addition |
//! | `SPLIT/NNNNNN/scene_camera.json` | `cam_K`, `depth_scale` (millimetres a unit) of each image |
//! | `SPLIT/NNNNNN/scene_gt.json` | `obj_id`, `cam_R_m2c`, `cam_t_m2c` (millimetres) of each object in each image |
//! | `SPLIT/NNNNNN/scene_gt_info.json` | `visib_fract`; may be absent |
//! | `SPLIT/NNNNNN/depth/IIIIII.png` | depth, greyscale of 16 bits, 0 where there is none |
//! | `SPLIT/NNNNNN/mask_visib/IIIIII_GGGGGG.png` | visible part of annotation `G` in image `I` |
//! | `SPLIT/NNNNNN/mask_estimate/IIIIII_GGGGGG.png` | our addition: the same mask as an estimator gives it; may be absent |
//! | `test_targets.json` | images of `test` to be evaluated; may be absent |
//!
//! Annotations are read at once, images one at a time on demand.

mod error;
pub(crate) mod json;
mod models;
mod results;
pub(crate) mod scene;

pub use error::{BOP_URL, BopError};
pub use models::{BopModel, CONTINUOUS_STEPS, Models, SURFACE_POINTS};
pub use results::{Estimate, read_results, write_results};
pub use scene::{Instance, MaskKind, Scenes};

use json::TargetEntry;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// List of the images to evaluate, in the format of BOP's own `test_targets_bop19.json`. LINEMOD's usual split
/// needs it: the images of `test` that it does not list are trained on.
pub const TARGETS_FILE: &str = "test_targets.json";
/// Folders of training images; the first that exists is taken.
const TRAINING_FOLDERS: [&str; 4] = ["train_real", "train_pbr", "train", "train_primesense"];

/// Whether a folder has models in BOP layout.
pub fn is_bop(root: &Path) -> bool {
    ["models_eval", "models"]
        .iter()
        .any(|models| root.join(models).join("models_info.json").is_file())
}

/// Scene, image and object of an instance to evaluate.
pub type Target = (u32, u32, u32);

/// The instances to evaluate; `None` where the data set does not list them.
///
/// # Errors
/// A list that cannot be read or is malformed.
pub fn targets(root: &Path) -> Result<Option<BTreeSet<Target>>, BopError> {
    let path = root.join(TARGETS_FILE);
    if !path.exists() {
        return Ok(None);
    }
    let list: Vec<TargetEntry> = json::read(&path, json::TARGETS)?;
    let listed = list.iter().filter(|t| t.inst_count > 0);
    Ok(Some(
        listed.map(|t| (t.scene_id, t.im_id, t.obj_id)).collect(),
    ))
}

/// The annotated objects to train on: with a [`TARGETS_FILE`], the objects that it lists, in the images of `test` that
/// it does not list; otherwise those of the first of `train_real`, `train_pbr`, `train` and `train_primesense`.
///
/// # Errors
/// As [`Scenes::open`]; neither a list nor a folder; a list that leaves nothing to train on.
pub fn training_scenes(root: &Path, models: &Models) -> Result<Scenes, BopError> {
    if let Some(targets) = targets(root)? {
        let images: BTreeSet<(u32, u32)> = targets.iter().map(|&(s, i, _)| (s, i)).collect();
        let objects: BTreeSet<u32> = targets.iter().map(|&(_, _, object)| object).collect();
        let mut scenes = Scenes::open(&root.join("test"), models)?;
        scenes
            .instances
            .retain(|i| objects.contains(&i.object) && !images.contains(&(i.scene, i.image)));
        if scenes.instances.is_empty() {
            return Err(BopError::Empty {
                path: root.join(TARGETS_FILE),
                what: "lists all images of the folder test, which leaves none to train on",
            });
        }
        return Ok(scenes);
    }
    let folder: Option<PathBuf> = TRAINING_FOLDERS
        .iter()
        .map(|name| root.join(name))
        .find(|path| path.is_dir());
    let folder = folder.ok_or_else(|| BopError::Missing {
        path: root.join("train_real"),
        expected: "training images, there or in train_pbr or train, or a list test_targets.json of the images of test that are not for training",
    })?;
    Scenes::open(&folder, models)
}
