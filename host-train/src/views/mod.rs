//! Training views: what a depth camera sees of a mesh among other things. They are rendered as samples are drawn,
//! without files in between.
//!
//! | part | model |
//! |---|---|
//! | shape | a mesh, deformed as clouds are in training, 60 to 400 mm across |
//! | scene | a plane below it, a wall behind it, up to two other things beside or before it: `scene` |
//! | depth | the noise, rounding, missing and flying pixels of a sensor: [`crate::bop::synth::sensor`] |
//! | mask | the visible part of it, in most cases as an estimator would segment it |
//! | start | the errors of pose estimators, largest along the viewing axis: [`start`] |
//!
//! A sample depends only on its mesh and its random stream.

mod scene;
pub mod start;

use crate::augment::{affine, random_affine, random_rotation};
use crate::bop::normalise::Normalisation;
use crate::bop::sample::placed;
use crate::bop::synth::sensor::{Sensor, estimated_mask};
use crate::dataset::cloud_file::{CloudError, npy, read_file};
use crate::dataset::mesh::{Mesh, normalise};
use crate::dataset::pairs::{PairSet, Sample};
use crate::dataset::raster::Pinhole;
use crate::dataset::{DatasetError, Model, Point, Split, procedural, tree};
use crate::random::resample;
use crate::random::{Purpose, Rng, stream};
use glam::{Affine3A, Mat3, Vec2, Vec3};
use rand::RngExt;
use rand::seq::{SliceRandom, index};
use rayon::prelude::*;
use reagent_core::Pose;
use scene::Scene;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Points of a mesh's surface from which targets are drawn.
const SURFACE_POINTS: usize = 4096;
/// Points of a dense cloud of a mesh's surface.
const DENSE: usize = 8192;
/// Range of an object's radius before it is deformed, millimetres; its logarithm is uniform.
const RADIUS_MM: [f32; 2] = [30.0, 200.0];
/// Range of the distance from the camera to the object's centre less two radii, millimetres.
const CLEARANCE_MM: std::ops::Range<f32> = 450.0..1200.0;
/// Range of the columns and rows of an image, a crop about the object.
const SIDE: std::ops::RangeInclusive<usize> = 56..=112;
/// Share of the image's side that an object fills before it is deformed.
const FILLED: f32 = 0.75;
/// Share of the masks that are an estimator's; the others are exact.
const ESTIMATED: f64 = 0.7;
/// Most scenes tried until an object is seen.
const ATTEMPTS: usize = 4;

/// A mesh to render: its bounding box is centred on the origin, its farthest vertex at distance 1.
#[derive(Clone, Debug)]
pub struct Object {
    mesh: Mesh,
    /// Points of what of it can be seen, once they are asked for: finding them takes longer than reading the mesh.
    surface: OnceLock<Vec<Point>>,
    /// Draws these points.
    rng: Rng,
    /// Category index.
    pub label: u32,
}

impl Object {
    /// Centres and scales a mesh; `None` where it has no surface.
    pub fn new(mut mesh: Mesh, label: u32, rng: &Rng) -> Option<Object> {
        let bounds = |f: fn(Vec3, Vec3) -> Vec3| mesh.vertices.iter().copied().reduce(f);
        let centre = (bounds(Vec3::min)? + bounds(Vec3::max)?) / 2.0;
        let distances = mesh.vertices.iter().map(|v| v.distance(centre));
        let radius = distances.fold(0.0, f32::max);
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        for vertex in &mut mesh.vertices {
            *vertex = (*vertex - centre) / radius;
        }
        let area = mesh.area();
        (area > 0.0 && area.is_finite()).then(|| Object {
            mesh,
            surface: OnceLock::new(),
            rng: rng.clone(),
            label,
        })
    }

    /// Points of its surface.
    pub fn surface(&self) -> &[Point] {
        self.surface.get_or_init(|| {
            let rng = &mut self.rng.clone();
            self.mesh.sample_outside(SURFACE_POINTS, rng)
        })
    }

    /// Adds a view of the undeformed mesh to a set. `None` in the rare case that nothing of it is seen. The noise-free
    /// target is dense, because distances to the closest point of a sparse one would measure its spacing.
    pub fn draw(&self, rng: &mut Rng, points: usize, set: &mut PairSet) -> Option<()> {
        let View {
            sample,
            view_point,
            model_from_mesh,
            frame,
        } = self.view(rng, points, false)?;
        let placed = |p: &Point| frame.point(model_from_mesh.transform_point3((*p).into()));
        let surface = self.surface().iter().map(placed).collect();
        set.push_view(sample, surface, view_point, self.label);
        Some(())
    }

    /// Draws a view of the mesh, and an initial estimate of its pose.
    fn view(&self, rng: &mut Rng, points: usize, deform: bool) -> Option<View> {
        let [least, most] = RADIUS_MM.map(f32::ln);
        let radius = rng.random_range(least..most).exp();
        let shape = if deform {
            Affine3A::from(random_affine(rng, Vec3::ZERO))
        } else {
            Affine3A::IDENTITY
        };
        let model_from_mesh = Affine3A::from_scale(Vec3::splat(radius)) * shape;
        for _ in 0..ATTEMPTS {
            let truth = Pose {
                rotation: Mat3::from_quat(random_rotation(rng)),
                translation: Vec3::Z * (rng.random_range(CLEARANCE_MM) + 2.0 * radius),
            };
            let Some(source) = self.segment(rng, points, radius, &truth, &model_from_mesh) else {
                continue;
            };
            let estimate = start::estimate(&truth, radius, rng);
            let mut target = resample(rng, self.surface(), points);
            affine(&mut target, &model_from_mesh.into());
            let (sample, frame) = placed(source, target, &estimate, &truth)?;
            return Some(View {
                sample,
                view_point: frame.point(estimate.inverse().translation),
                model_from_mesh,
                frame,
            });
        }
        None
    }

    /// Points of one segmented depth image, in millimetres and the camera's frame; `None` if too few pixels are left.
    fn segment(
        &self,
        rng: &mut Rng,
        points: usize,
        radius: f32,
        camera_from_model: &Pose,
        model_from_mesh: &Affine3A,
    ) -> Option<Vec<Point>> {
        let side = rng.random_range(SIDE);
        let distance = camera_from_model.translation.z;
        let camera = Pinhole {
            size: [side; 2],
            focal: Vec2::splat(FILLED * side as f32 * distance / (2.0 * radius)),
            centre: Vec2::splat((side as f32 - 1.0) / 2.0),
        };
        let place = Affine3A::from_mat3_translation(
            camera_from_model.rotation,
            camera_from_model.translation,
        ) * *model_from_mesh;
        let scene = Scene::around(&self.mesh, &place, radius, distance, &camera, rng);
        let mask = if rng.random_bool(ESTIMATED) {
            estimated_mask(&scene.visible, camera.size, rng)
        } else {
            scene.visible.clone()
        };
        let inside: Vec<usize> = (0..mask.len()).filter(|&pixel| mask[pixel]).collect();
        let sensor = Sensor::draw(rng);
        let depths = |column: usize, row: usize| scene.depths[row * side + column];
        let drawn = index::sample(rng, inside.len(), inside.len().min(points + points / 8));
        let mut seen = Vec::with_capacity(points);
        for pixel in drawn.into_iter().map(|i| inside[i]) {
            let (column, row) = (pixel % side, pixel / side);
            let depth = sensor.read(&depths, camera.size, [column, row], rng);
            if depth > 0.0 && seen.len() < points {
                seen.push((camera.ray(column, row) * depth).to_array());
            }
        }
        (seen.len() >= points.min(LEAST_PIXELS)).then(|| resample(rng, &seen, points))
    }
}

/// A view of an object.
struct View {
    sample: Sample,
    /// Where the camera stood in the source's frame.
    view_point: Point,
    model_from_mesh: Affine3A,
    frame: Normalisation,
}

/// Fewest pixels of a view.
const LEAST_PIXELS: usize = 64;

/// Which meshes are rendered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Meshes {
    /// A directory of loose meshes ([`crate::dataset::tree`]).
    Directory(PathBuf),
    /// The built-in parametric shapes, this many.
    Procedural(usize),
}

/// Meshes of which views are drawn.
#[derive(Clone, Debug)]
pub struct Views {
    objects: Vec<Object>,
}

impl Views {
    /// Loads the meshes to train on.
    ///
    /// # Errors
    /// As [`Views::open`].
    pub fn load(meshes: &Meshes, seed: u64) -> Result<Views, DatasetError> {
        match meshes {
            Meshes::Directory(dir) => Views::open(dir, Split::Train, seed),
            Meshes::Procedural(count) => Ok(Views::procedural(seed, 0..*count as u64)),
        }
    }

    /// Reads the meshes of a split of a directory ([`tree`]), in the order of their paths.
    ///
    /// # Errors
    /// As [`tree::load`]; a file without faces.
    pub fn open(dir: &Path, split: Split, seed: u64) -> Result<Views, DatasetError> {
        let files = tree::files(dir, split)?;
        let objects = files.into_par_iter().map(|file| {
            let mesh = read_file(&file.path)?.mesh();
            let rng = &mut stream(seed, Purpose::Surface, file.index);
            Object::new(mesh, file.label, rng).ok_or(CloudError::NoArea { path: file.path })
        });
        let objects: Vec<Result<Object, CloudError>> = objects.collect();
        Ok(Views {
            objects: objects.into_iter().collect::<Result<_, _>>()?,
        })
    }

    /// The built-in shapes with these numbers.
    pub fn procedural(seed: u64, numbers: Range<u64>) -> Views {
        let objects = numbers.into_par_iter().map(|index| {
            let shape = procedural::shape(seed, index);
            let rng = &mut stream(seed, Purpose::Surface, index);
            Object::new(shape.mesh, shape.model.label, rng).expect("every family has an extent")
        });
        Views {
            objects: objects.collect(),
        }
    }

    /// The meshes.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// Clouds of the meshes' surfaces, so dense that two samples of one hardly share points.
    pub fn models(&self, seed: u64) -> Vec<Model> {
        let drawn = self.objects.par_iter().enumerate();
        let drawn = drawn.map(|(i, object)| {
            let rng = &mut stream(seed, Purpose::Surface, i as u64);
            let mut points = object.mesh.sample(DENSE, rng);
            normalise(&mut points);
            Model {
                points,
                label: object.label,
            }
        });
        drawn.collect()
    }

    /// Splits the meshes into two parts.
    pub fn split(self, split: impl FnOnce(Vec<Object>) -> [Vec<Object>; 2]) -> [Views; 2] {
        split(self.objects).map(|objects| Views { objects })
    }

    /// Draws a view of mesh number `index`, or of the next mesh that is seen at all. `None` if no mesh is.
    pub fn sample(
        &self,
        index: usize,
        rng: &mut Rng,
        points: usize,
        deform: bool,
    ) -> Option<Sample> {
        let view = |object: &Object| object.view(rng, points, deform);
        let View { sample, .. } = self.starting_at(index).find_map(view)?;
        Some(sample)
    }

    /// The meshes, from number `index` on.
    fn starting_at(&self, index: usize) -> impl Iterator<Item = &Object> {
        let count = self.objects.len();
        self.objects.iter().cycle().skip(index).take(count)
    }

    /// `count` training views, drawn as by [`Views::sample`] of the meshes in shuffled order, as an array in
    /// NumPy's format: `[count, 2 points + 4, 3]`, source, target, and the columns of the pose `[R | t]` that maps
    /// the one onto the other. `None` if nothing is seen of any mesh.
    pub fn npy(&self, count: usize, points: usize, deform: bool, seed: u64) -> Option<Vec<u8>> {
        let mut bytes = npy::header("<f4", &[count, 2 * points + 4, 3]);
        let head = bytes.len();
        let size = (2 * points + 4) * size_of::<Point>();
        bytes.resize(head + count * size, 0);
        let mut order: Vec<usize> = (0..self.objects.len()).collect();
        order.shuffle(&mut stream(seed, Purpose::Order, 0));
        let places = bytes[head..].par_chunks_exact_mut(size);
        places.enumerate().try_for_each(|(k, place)| {
            let rng = &mut stream(seed, Purpose::Augment, k as u64);
            let index = order[k % order.len().max(1)];
            let sample = self.sample(index, rng, points, deform)?;
            let pose = sample.target_from_source;
            let columns = pose.rotation.to_cols_array_2d();
            let numbers = sample.source.iter().chain(&sample.target).chain(&columns);
            let numbers = numbers
                .flatten()
                .copied()
                .chain(pose.translation.to_array());
            for (to, number) in place.chunks_exact_mut(4).zip(numbers) {
                to.copy_from_slice(&number.to_le_bytes());
            }
            Some(())
        })?;
        Some(bytes)
    }

    /// Adds `count` pairs with their view points to a set: views of the undeformed meshes in turn.
    pub fn draw(&self, count: usize, points: usize, seed: u64, set: &mut PairSet) {
        for k in 0..count {
            let rng = &mut stream(seed, Purpose::Pairs, k as u64);
            let index = k % self.objects.len().max(1);
            self.starting_at(index)
                .find_map(|object| object.draw(rng, points, set));
        }
    }
}

#[cfg(test)]
mod tests;
