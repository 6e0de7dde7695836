//! Samples of the `bop` protocol, for training and for tests.

use super::normalise::Normalisation;
use super::segment::{inside, patch};
use crate::augment::{random_direction, random_rotation, transform};
use crate::dataset::Point;
use crate::dataset::bop::{BopError, Instance, MaskKind, Models, Scenes, training_scenes};
use crate::dataset::depth::DepthImage;
use crate::dataset::pairs::{PairSet, Sample};
use crate::random::resample;
use crate::random::{Purpose, Rng, stream};
use glam::Mat3;
use rand::RngExt;
use rand::seq::SliceRandom;
use reagent_core::Pose;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::Path;

/// Distribution of the random translation's length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Magnitude {
    /// U[0, 1] times the maximum, as in the paper.
    #[default]
    Uniform,
    /// The product of two uniform draws times the maximum, as in the authors' code: the mean is a quarter.
    Product,
}

/// How training and validation samples are drawn; the defaults are the paper's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BopSampling {
    /// Points of source and target.
    pub points: usize,
    /// Least share of the source's points that lie on the object; the share is uniform between this and 1.
    pub least_foreground: f64,
    /// Largest rotation of the initial error, degrees. The angle is uniform from 0, the axis that of a uniformly random
    /// rotation.
    pub rotation_deg: f32,
    /// Largest translation of the initial error, normalised units; the direction is uniform.
    pub translation: f32,
    /// Distribution of the translation's length.
    pub magnitude: Magnitude,
}

impl Default for BopSampling {
    fn default() -> BopSampling {
        BopSampling {
            points: 1024,
            least_foreground: 0.5,
            rotation_deg: 90.0,
            translation: 1.0,
            magnitude: Magnitude::Uniform,
        }
    }
}

impl BopSampling {
    /// One training sample. A segment of the image is taken to the model's frame by the true pose, normalised with the
    /// target, which is drawn from the model's `surface`, and then moved by a random error. `None` if no pixel of the
    /// object has a depth, or the surface has no extent.
    pub fn training(
        &self,
        rng: &mut Rng,
        seen: &DepthImage,
        camera_from_model: &Pose,
        surface: &[Point],
    ) -> Option<Sample> {
        let foreground = rng.random_range(self.least_foreground..=1.0);
        let mut source = patch(rng, seen, self.points, foreground)?;
        transform(&mut source, &camera_from_model.inverse());
        let mut target = resample(rng, surface, self.points);
        Normalisation::of(&mut source, &mut target)?;
        let error = self.error(rng);
        transform(&mut source, &error);
        Some(Sample {
            source,
            target,
            target_from_source: error.inverse(),
        })
    }

    /// A random initial error, normalised units, about the origin.
    pub fn error(&self, rng: &mut Rng) -> Pose {
        let (axis, _) = random_rotation(rng).to_axis_angle();
        let angle = rng.random::<f32>() * self.rotation_deg.to_radians();
        let direction = random_direction(rng);
        let mut length = rng.random::<f32>() * self.translation;
        if self.magnitude == Magnitude::Product {
            length *= rng.random::<f32>();
        }
        Pose {
            rotation: Mat3::from_axis_angle(axis, angle),
            translation: length * direction,
        }
    }
}

/// One test sample: `points` random points inside the mask, taken to the model's frame by the estimate and normalised
/// with the target, which is drawn from the model's `surface`. `None` as in [`BopSampling::training`].
pub fn test_sample(
    rng: &mut Rng,
    seen: &DepthImage,
    estimate: &Pose,
    truth: &Pose,
    surface: &[Point],
    points: usize,
) -> Option<(Sample, Normalisation)> {
    let source = inside(rng, seen, points)?;
    let target = resample(rng, surface, points);
    placed(source, target, estimate, truth)
}

/// Takes a source in the camera's frame to the model's frame by the estimate, and normalises it with the target. `None`
/// if the target has no extent.
pub fn placed(
    mut source: Vec<Point>,
    mut target: Vec<Point>,
    estimate: &Pose,
    truth: &Pose,
) -> Option<(Sample, Normalisation)> {
    transform(&mut source, &estimate.inverse());
    let frame = Normalisation::of(&mut source, &mut target)?;
    let sample = Sample {
        source,
        target,
        target_from_source: frame.normalised(&placed_from(estimate, truth)),
    };
    Some((sample, frame))
}

/// The transform that takes a point placed in the model's frame by `estimate` to its true place on the model.
pub fn placed_from(estimate: &Pose, truth: &Pose) -> Pose {
    truth.inverse().after(*estimate)
}

/// Annotated objects to train on. Images are read as samples are drawn.
#[derive(Clone, Debug)]
pub struct BopTraining {
    models: Models,
    scenes: Scenes,
    sampling: BopSampling,
}

/// Objects less visible than this are not trained on (BOP's own limit for test targets).
const LEAST_VISIBLE: f32 = 0.1;

impl BopTraining {
    /// Opens the training images of a data set in BOP layout; [`training_scenes`] says which these are.
    ///
    /// # Errors
    /// A file that is missing or malformed; no object that is visible enough.
    pub fn open(root: &Path, seed: u64, sampling: BopSampling) -> Result<BopTraining, BopError> {
        let models = Models::open(root, seed)?;
        let mut scenes = training_scenes(root, &models)?;
        scenes.instances.retain(|i| i.visible >= LEAST_VISIBLE);
        if scenes.instances.is_empty() {
            return Err(BopError::Empty {
                path: scenes.dir,
                what: "no object is visible by a tenth or more",
            });
        }
        Ok(BopTraining {
            models,
            scenes,
            sampling,
        })
    }

    /// The points of the models from which targets are drawn.
    pub fn surfaces(&self) -> impl Iterator<Item = &[Point]> {
        self.models.iter().map(|model| model.surface.as_slice())
    }

    /// The annotated objects; a sample's index refers to this list.
    pub fn instances(&self) -> &[Instance] {
        &self.scenes.instances
    }

    /// Splits by image: (for training, for validation). About `share` of the images are held back, at least one and not
    /// all if there are two or more. The choice depends only on the seed.
    pub fn split(self, seed: u64, share: f64) -> (BopTraining, BopTraining) {
        let mut images: Vec<(u32, u32)> = self
            .instances()
            .iter()
            .map(|i| (i.scene, i.image))
            .collect();
        images.dedup();
        images.shuffle(&mut stream(seed, Purpose::Split, 0));
        let most = images.len().saturating_sub(1);
        let count = ((images.len() as f64 * share).round() as usize).clamp(1.min(most), most);
        let held: BTreeSet<(u32, u32)> = images.into_iter().take(count).collect();
        let (mut training, mut validation) = (self.clone(), self);
        let of = |i: &Instance| held.contains(&(i.scene, i.image));
        training.scenes.instances.retain(|i| !of(i));
        validation.scenes.instances.retain(of);
        (training, validation)
    }

    /// Adds up to `count` validation pairs to a set, drawn like training samples and spread evenly over the annotated
    /// objects.
    ///
    /// # Errors
    /// As [`BopTraining::sample`].
    pub fn draw(&self, count: usize, seed: u64, set: &mut PairSet) -> Result<(), BopError> {
        let all = self.instances().len();
        let count = count.min(all);
        for k in 0..count {
            let index = k * all / count;
            let sample = self.sample(index, &mut stream(seed, Purpose::Pairs, k as u64))?;
            let clean = sample.target.clone();
            set.push(sample, clean, self.instances()[index].object);
        }
        Ok(())
    }

    /// Draws a sample of annotated object number `index` (modulo their number). It depends only on the object and on
    /// the stream. An object without any depth in its mask is replaced by the next one.
    ///
    /// # Errors
    /// An image that is missing or unreadable; no object with any depth.
    pub fn sample(&self, index: usize, rng: &mut Rng) -> Result<Sample, BopError> {
        let instances = self.instances();
        for step in 0..instances.len() {
            let instance = &instances[(index + step) % instances.len()];
            let seen = self.scenes.observe(instance, MaskKind::Visible)?;
            let surface = self
                .models
                .get(instance.object)
                .map_or(&[][..], |m| &m.surface);
            let pose = &instance.camera_from_model;
            if let Some(sample) = self.sampling.training(rng, &seen, pose, surface) {
                return Ok(sample);
            }
        }
        Err(BopError::Empty {
            path: self.scenes.dir.clone(),
            what: "no object has a depth inside its mask",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn angle_deg(r: &Mat3) -> f32 {
        let trace = r.x_axis.x + r.y_axis.y + r.z_axis.z;
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Measured on the authors' code over 4000 draws: angle 45.0, length .263 (median .202).
    #[test]
    fn errors_have_the_papers_and_the_codes_distribution() {
        let draw = |magnitude| {
            let sampling = BopSampling {
                magnitude,
                ..BopSampling::default()
            };
            let rng = &mut stream(4, Purpose::Augment, 0);
            let errors: Vec<Pose> = (0..4000).map(|_| sampling.error(rng)).collect();
            let mean = |f: &dyn Fn(&Pose) -> f32| errors.iter().map(f).sum::<f32>() / 4000.0;
            let shift = errors.iter().map(|p| p.translation).sum::<Vec3>() / 4000.0;
            let axis = errors.iter().map(|p| p.rotation.z_axis.x).sum::<f32>() / 4000.0;
            assert!(
                shift.length() < 0.03 && axis.abs() < 0.03,
                "no direction is preferred"
            );
            assert!(errors.iter().all(|p| angle_deg(&p.rotation) < 90.1));
            (
                mean(&|p| angle_deg(&p.rotation)),
                mean(&|p| p.translation.length()),
            )
        };
        let (angle, length) = draw(Magnitude::Uniform);
        assert!(
            (angle - 45.0).abs() < 1.5 && (length - 0.5).abs() < 0.02,
            "{angle} {length}"
        );
        let (angle, length) = draw(Magnitude::Product);
        assert!(
            (angle - 45.0).abs() < 1.5 && (length - 0.25).abs() < 0.02,
            "{angle} {length}"
        );
    }
}
