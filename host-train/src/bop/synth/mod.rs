//! A generator of scenes in BOP layout: several objects on a plane, seen by a noisy depth camera.
//!
//! | part | model |
//! |---|---|
//! | camera | LINEMOD's intrinsics, scaled to the size of the image |
//! | noise | Kinect: [`sensor`] |
//! | masks | true ones, and displaced, eroded or dilated ones like an estimator's: [`sensor`] |
//! | initial estimates | with errors like PoseCNN's on LINEMOD: [`guess`] |
//!
//! Everything depends on the seed, and each image also on its number.

pub mod guess;
pub mod objects;
pub mod scene;
pub mod sensor;

use crate::dataset::bop::json::{self, Annotation, AnnotationInfo, CameraEntry, Numbered};
use crate::dataset::bop::scene::{ESTIMATED_MASKS, VISIBLE_MASKS};
use crate::dataset::bop::{BopError, Estimate, write_results};
use crate::dataset::depth::image::{Image, NOT_MEASURED, write_depth, write_mask};
use crate::random::{Purpose, Rng, SEED, stream};
use objects::{Object, write_models};
use scene::{Scene, linemod_camera};
use std::path::{Path, PathBuf};

/// File of the initial estimates for the test split.
pub const ESTIMATES_FILE: &str = "estimates.csv";
/// Millimetres of one unit of the depth images.
const DEPTH_SCALE_MM: f64 = 0.1;
/// Objects less visible than this have no estimate (BOP's own limit for test targets).
const LEAST_VISIBLE: f64 = 0.1;

/// What to generate.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthSettings {
    /// Scenes of the split `test`.
    pub test_scenes: usize,
    /// Scenes of the split `train`.
    pub train_scenes: usize,
    /// Views of each scene.
    pub images: usize,
    /// Objects in each scene, drawn from all with replacement.
    pub per_scene: usize,
    /// Columns and rows of an image.
    pub size: [usize; 2],
    /// Factor on the sensor's noise; 0 gives exact depths.
    pub noise: f32,
    /// Seed of everything.
    pub seed: u64,
}

impl Default for SynthSettings {
    /// Ten scenes a split, four views of five objects each, 320 by 240.
    fn default() -> SynthSettings {
        SynthSettings {
            test_scenes: 10,
            train_scenes: 10,
            images: 4,
            per_scene: 5,
            size: [320, 240],
            noise: 1.0,
            seed: SEED,
        }
    }
}

/// Writes models, both splits and the initial estimates for `test` into an empty or absent folder. `progress` is called
/// once per image.
///
/// # Errors
/// A folder that is not empty; the system's errors.
pub fn generate(
    objects: &[Object],
    settings: &SynthSettings,
    out: &Path,
    progress: &dyn Fn(),
) -> Result<(), BopError> {
    create(out)?;
    if std::fs::read_dir(out).map_err(io(out))?.next().is_some() {
        return Err(BopError::Malformed {
            path: out.into(),
            reason: "the folder is not empty".into(),
            expected: "an empty or absent folder to write to",
        });
    }
    write_models(&out.join("models_eval"), objects)?;
    let mut estimates = Vec::new();
    let splits = [
        ("test", settings.test_scenes, 0u64),
        ("train", settings.train_scenes, 1),
    ];
    for (split, scenes, number) in splits {
        for k in 0..scenes {
            // One stream places a scene's objects; each of its images has another one.
            let first = (number << 48) | ((k as u64) << 24);
            let rng = &mut stream(settings.seed, Purpose::Scene, first);
            let scene = Scene::arrange(objects, settings.per_scene, rng);
            let mut writer = SceneWriter::create(out.join(split).join(format!("{k:06}")))?;
            for image in 0..settings.images {
                let rng = &mut stream(settings.seed, Purpose::Scene, first + 1 + image as u64);
                let guesses = writer.image(image as u32, &scene, settings, rng)?;
                if split == "test" {
                    estimates.extend(guesses.into_iter().map(|mut e| {
                        e.scene = k as u32;
                        e
                    }));
                }
                progress();
            }
            writer.finish()?;
        }
    }
    write_results(&out.join(ESTIMATES_FILE), &estimates)
}

/// One scene's folder being written.
struct SceneWriter {
    folder: PathBuf,
    cameras: Numbered<CameraEntry>,
    truth: Numbered<Vec<Annotation>>,
    info: Numbered<Vec<AnnotationInfo>>,
}

impl SceneWriter {
    fn create(folder: PathBuf) -> Result<SceneWriter, BopError> {
        for part in ["depth", "mask", VISIBLE_MASKS, ESTIMATED_MASKS] {
            create(&folder.join(part))?;
        }
        Ok(SceneWriter {
            folder,
            cameras: Numbered::new(),
            truth: Numbered::new(),
            info: Numbered::new(),
        })
    }

    /// Renders and writes one image. Returns initial estimates of the objects that are visible, with scene 0.
    fn image(
        &mut self,
        image: u32,
        scene: &Scene<'_>,
        settings: &SynthSettings,
        rng: &mut Rng,
    ) -> Result<Vec<Estimate>, BopError> {
        let camera = linemod_camera(settings.size);
        let camera_from_world = scene.view(rng);
        let rendered = scene.render(&camera, &camera_from_world);
        let depths = sensor::observe(&rendered, settings.noise, rng);
        let quantise = |depth: &f32| {
            let units = (f64::from(*depth) / DEPTH_SCALE_MM).round();
            if units < f64::from(NOT_MEASURED) {
                units as u16
            } else {
                0
            }
        };
        let depth = Image {
            size: settings.size,
            values: depths.iter().map(quantise).collect(),
        };
        write_depth(&self.folder.join(format!("depth/{image:06}.png")), &depth)?;

        let [fx, fy, cx, cy] = [
            camera.focal.x,
            camera.focal.y,
            camera.centre.x,
            camera.centre.y,
        ]
        .map(f64::from);
        let entry = CameraEntry {
            intrinsics: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            depth_scale: DEPTH_SCALE_MM,
        };
        self.cameras.insert(image, entry);

        let (mut truth, mut infos, mut estimates) = (Vec::new(), Vec::new(), Vec::new());
        for (index, (object, camera_from_model)) in scene.poses(&camera_from_world).enumerate() {
            let (rotation, translation) = json::rows(&camera_from_model);
            truth.push(Annotation {
                obj_id: object.id,
                rotation,
                translation,
            });
            let [whole, visible] = [rendered.silhouette(index), rendered.visible(index)];
            let name = format!("{image:06}_{index:06}.png");
            let estimated = sensor::estimated_mask(&visible, settings.size, rng);
            for (folder, mask) in [
                ("mask", &whole),
                (VISIBLE_MASKS, &visible),
                (ESTIMATED_MASKS, &estimated),
            ] {
                write_mask(&self.folder.join(folder).join(&name), settings.size, mask)?;
            }
            let info = describe(&whole, &visible, &depth);
            let guess = guess::estimate(&camera_from_model, &camera, rng);
            if f64::from(info.visib_fract) >= LEAST_VISIBLE {
                estimates.push(Estimate {
                    scene: 0,
                    image,
                    object: object.id,
                    score: info.visib_fract,
                    camera_from_model: guess,
                    time_s: -1.0,
                });
            }
            infos.push(info);
        }
        self.truth.insert(image, truth);
        self.info.insert(image, infos);
        Ok(estimates)
    }

    fn finish(self) -> Result<(), BopError> {
        json::write(&self.folder.join("scene_camera.json"), &self.cameras)?;
        json::write(&self.folder.join("scene_gt.json"), &self.truth)?;
        json::write(&self.folder.join("scene_gt_info.json"), &self.info)
    }
}

/// The entry of `scene_gt_info.json`.
fn describe(whole: &[bool], visible: &[bool], depth: &Image<u16>) -> AnnotationInfo {
    let count = |mask: &[bool]| mask.iter().filter(|&&inside| inside).count() as u64;
    let (all, seen) = (count(whole), count(visible));
    let valid = whole.iter().zip(&depth.values);
    AnnotationInfo {
        bbox_obj: sensor::bounding_box(whole, depth.size),
        bbox_visib: sensor::bounding_box(visible, depth.size),
        px_count_all: all,
        px_count_valid: valid
            .filter(|(inside, depth)| **inside && **depth > 0)
            .count() as u64,
        px_count_visib: seen,
        visib_fract: if all == 0 {
            0.0
        } else {
            seen as f32 / all as f32
        },
    }
}

fn create(folder: &Path) -> Result<(), BopError> {
    std::fs::create_dir_all(folder).map_err(io(folder))
}

fn io(path: &Path) -> impl Fn(std::io::Error) -> BopError {
    move |source| BopError::Io {
        path: path.into(),
        source,
    }
}
