//! The annotated images of one split, read on demand.

use super::json::{
    self, Annotation, AnnotationInfo, CameraEntry, Numbered, SCENE_CAMERA, SCENE_GT,
};
use super::{BopError, Models};
use crate::dataset::depth::{DepthError, DepthImage, Intrinsics, checked_scale, image};
use reagent_core::Pose;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One annotated object in one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Scene.
    pub scene: u32,
    /// Image of the scene.
    pub image: u32,
    /// Index among the image's annotations.
    pub index: u32,
    /// Object.
    pub object: u32,
    /// True pose, millimetres.
    pub camera_from_model: Pose,
    /// Visible share of the silhouette; 1 if the data set does not say.
    pub visible: f32,
}

/// The segmentation that is used for an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskKind {
    /// `mask_visib`: the true visible part.
    Visible,
    /// `mask_estimate`, our addition to the layout: as an estimator would give it. `mask_visib` if a scene has no
    /// such folder.
    Estimated,
}

#[derive(Clone, Copy, Debug)]
struct View {
    camera: Intrinsics,
    depth_scale_mm: f32,
}

/// The annotations of one split; images stay on disk.
#[derive(Clone, Debug)]
pub struct Scenes {
    /// Folder of the split.
    pub dir: PathBuf,
    /// All annotated objects, ordered by scene, image and index.
    pub instances: Vec<Instance>,
    views: BTreeMap<(u32, u32), View>,
}

impl Scenes {
    /// Reads the annotations of a split's folder, such as `test` or `train_pbr`, and checks that each object has a
    /// model.
    ///
    /// # Errors
    /// A file that is missing or malformed, an object without a model, no annotations at all.
    pub fn open(dir: &Path, models: &Models) -> Result<Scenes, BopError> {
        let mut scenes = Scenes {
            dir: dir.into(),
            instances: Vec::new(),
            views: BTreeMap::new(),
        };
        for (scene, path) in scene_folders(dir)? {
            scenes.read_scene(scene, &path, models)?;
        }
        if scenes.instances.is_empty() {
            return Err(BopError::Empty {
                path: dir.into(),
                what: "no annotated objects",
            });
        }
        Ok(scenes)
    }

    fn read_scene(&mut self, scene: u32, folder: &Path, models: &Models) -> Result<(), BopError> {
        let cameras_path = folder.join("scene_camera.json");
        let cameras: Numbered<CameraEntry> = json::read(&cameras_path, SCENE_CAMERA)?;
        for (&image, camera) in &cameras {
            let view = view(camera).map_err(|reason| BopError::Malformed {
                path: cameras_path.clone(),
                reason: format!("image {image}: {reason}"),
                expected: SCENE_CAMERA,
            })?;
            self.views.insert((scene, image), view);
        }
        let truth_path = folder.join("scene_gt.json");
        let malformed = |reason: String| BopError::Malformed {
            path: truth_path.clone(),
            reason,
            expected: SCENE_GT,
        };
        let truth: Numbered<Vec<Annotation>> = json::read(&truth_path, SCENE_GT)?;
        let info_path = folder.join("scene_gt_info.json");
        let info: Numbered<Vec<AnnotationInfo>> = if info_path.exists() {
            json::read(&info_path, json::SCENE_GT_INFO)?
        } else {
            Numbered::new()
        };
        for (&image, annotations) in &truth {
            if !cameras.contains_key(&image) {
                return Err(malformed(format!(
                    "image {image} is not in scene_camera.json"
                )));
            }
            for (index, annotation) in annotations.iter().enumerate() {
                let object = annotation.obj_id;
                if models.get(object).is_none() {
                    return Err(BopError::NoModel {
                        origin: truth_path.clone(),
                        object,
                        models: models.dir.clone(),
                    });
                }
                let pose = json::pose(&annotation.rotation, &annotation.translation);
                let visible = info.get(&image).and_then(|list| list.get(index));
                self.instances.push(Instance {
                    scene,
                    image,
                    index: index as u32,
                    object,
                    camera_from_model: pose.ok_or_else(|| {
                        malformed(format!(
                            "image {image}, entry {index} is not a finite rigid transform"
                        ))
                    })?,
                    visible: visible.map_or(1.0, |v| v.visib_fract),
                });
            }
        }
        Ok(())
    }

    /// Reads an instance's depth image and mask, millimetres.
    ///
    /// # Errors
    /// An image that is missing, of another kind, truncated or too large; two images of different sizes.
    pub fn observe(&self, instance: &Instance, kind: MaskKind) -> Result<DepthImage, BopError> {
        let folder = self.dir.join(format!("{:06}", instance.scene));
        let depth_path = folder.join(format!("depth/{:06}.png", instance.image));
        let masks = match kind {
            MaskKind::Estimated if folder.join(ESTIMATED_MASKS).is_dir() => ESTIMATED_MASKS,
            _ => VISIBLE_MASKS,
        };
        let name = format!("{:06}_{:06}.png", instance.image, instance.index);
        let mask_path = folder.join(masks).join(name);
        let depth = image::read_depth(&depth_path)
            .map_err(|error| of_layout(error, "a greyscale PNG of 16 bits"))?;
        let mask =
            image::read_mask(&mask_path).map_err(|error| of_layout(error, "a greyscale PNG"))?;
        let size = depth.size;
        if mask.size != size {
            return Err(BopError::Depth(DepthError::Size {
                path: mask_path,
                found: mask.size,
                depth: depth_path,
                expected: size,
            }));
        }
        let view = self.views.get(&(instance.scene, instance.image));
        let view = view.ok_or(BopError::Missing {
            path: folder.join("scene_camera.json"),
            expected: "the image's camera",
        })?;
        let millimetres = |units: u16| match units {
            image::NOT_MEASURED => 0.0,
            _ => f32::from(units) * view.depth_scale_mm,
        };
        let depths = depth.values.into_iter().map(millimetres).collect();
        let mask = mask.values.into_iter().map(|value| value > 0).collect();
        Ok(DepthImage::new(view.camera.pinhole(size), depths, mask))
    }
}

/// Reports a missing image as a missing part of the layout.
fn of_layout(error: DepthError, expected: &'static str) -> BopError {
    match error {
        DepthError::Io { path, source } if source.kind() == std::io::ErrorKind::NotFound => {
            BopError::Missing { path, expected }
        }
        other => BopError::Depth(other),
    }
}

/// Folder of the true masks of visible parts.
pub(crate) const VISIBLE_MASKS: &str = "mask_visib";
/// Folder of masks as an estimator gives them.
pub(crate) const ESTIMATED_MASKS: &str = "mask_estimate";

/// The numbered folders of a split, in order.
fn scene_folders(dir: &Path) -> Result<BTreeMap<u32, PathBuf>, BopError> {
    let expected = "folders NNNNNN of scenes";
    let entries = std::fs::read_dir(dir).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => BopError::Missing {
            path: dir.into(),
            expected,
        },
        _ => BopError::Io {
            path: dir.into(),
            source,
        },
    })?;
    let mut scenes = BTreeMap::new();
    for entry in entries {
        let entry = entry.map_err(|source| BopError::Io {
            path: dir.into(),
            source,
        })?;
        let number = entry.file_name().to_str().and_then(|name| {
            let whole = name.len() == 6 && name.bytes().all(|b| b.is_ascii_digit());
            whole.then(|| name.parse().ok()).flatten()
        });
        if let Some(number) = number {
            scenes.insert(number, entry.path());
        }
    }
    if scenes.is_empty() {
        return Err(BopError::Empty {
            path: dir.into(),
            what: "no folders NNNNNN of scenes",
        });
    }
    Ok(scenes)
}

fn view(camera: &CameraEntry) -> Result<View, String> {
    // As f32, which it is computed with: a skew that vanishes there is accepted.
    let single = |x: f64| f64::from(x as f32);
    Ok(View {
        camera: Intrinsics::of_matrix(camera.intrinsics.map(single))?,
        depth_scale_mm: checked_scale(single(camera.depth_scale))? as f32,
    })
}
