//! Test pairs of a data set in BOP layout, and the conversion of refined poses back to the camera's frame.

use super::normalise::Normalisation;
use super::recall::PoseErrors;
use super::sample::test_sample;
use super::table::Estimated;
use crate::dataset::bop::{
    BopError, Estimate, Instance, MaskKind, Models, Scenes, read_results, targets,
};
use crate::dataset::depth::DepthImage;
use crate::dataset::pairs::{PairSet, Sample, Seen};
use crate::random::{Purpose, stream};
use glam::Vec3;
use rayon::prelude::*;
use reagent_core::Pose;
use std::collections::BTreeMap;
use std::path::Path;

/// Points of source and target (the paper's).
const POINTS: usize = 1024;
/// Points of the background across an object's width: several for every cell in which free space is checked.
const ACROSS: usize = 32;

/// An annotated object, and its estimate if it has one.
type Matched = (Instance, Option<Estimate>);
/// A sample; `None` if the object has no depth inside its mask.
type Drawn = Result<Option<(Sample, Normalisation, Seen)>, BopError>;

/// Annotated objects with the estimates that are to be refined. A pair's clouds take 24 kB, what is seen around the
/// object up to 100 kB.
#[derive(Clone, Debug)]
pub struct Refinements {
    /// The pairs to register, in normalised units: the observed source, placed by the estimate, and the model. The
    /// label is the object's id.
    pub set: PairSet,
    refined: Vec<(Instance, Estimate, Normalisation)>,
    /// Objects that cannot be refined: no depth inside the mask, or no estimate at all.
    rest: Vec<Matched>,
    scenes: Scenes,
    /// The data set's models.
    pub models: Models,
}

impl Refinements {
    /// Reads the folder `test` of a data set and the estimates for it, and draws each pair's source inside the estimated
    /// mask (`mask_estimate`; `mask_visib` if a scene has none). A pair depends only on the seed and on its index.
    ///
    /// The objects that `test_targets.json` lists are evaluated, and those without an estimate count as failures.
    /// Without such a list it is the objects that have an estimate. Several estimates of one object in one image are
    /// assigned, best score first, to the nearest annotation that is free. `count` takes only that many objects, spread
    /// evenly over all.
    ///
    /// # Errors
    /// A file that is missing or malformed; no estimate that belongs to an annotated object.
    pub fn open(
        root: &Path,
        estimates: &Path,
        count: Option<usize>,
        seed: u64,
    ) -> Result<Refinements, BopError> {
        let models = Models::open(root, seed)?;
        let scenes = Scenes::open(&root.join("test"), &models)?;
        let listed = targets(root)?;
        let mut matched = matched(&scenes.instances, read_results(estimates)?);
        matched.retain(|(i, estimate)| match &listed {
            Some(listed) => listed.contains(&(i.scene, i.image, i.object)),
            None => estimate.is_some(),
        });
        if let Some(count) = count.filter(|&count| count < matched.len()) {
            let all = matched.len();
            matched = (0..count).map(|k| matched[k * all / count]).collect();
        }
        if matched.iter().all(|(_, estimate)| estimate.is_none()) {
            return Err(BopError::Empty {
                path: estimates.into(),
                what: "no estimate belongs to an annotated object of the folder test",
            });
        }

        let draw = |(place, (instance, estimate)): (usize, &Matched)| -> Drawn {
            let (Some(estimate), Some(model)) = (estimate, models.get(instance.object)) else {
                return Ok(None);
            };
            let image = scenes.observe(instance, MaskKind::Estimated)?;
            let drawn = test_sample(
                &mut stream(seed, Purpose::Pairs, place as u64),
                &image,
                &estimate.camera_from_model,
                &instance.camera_from_model,
                &model.surface,
                POINTS,
            );
            Ok(drawn.map(|(sample, frame)| {
                let seen = seen(&image, &estimate.camera_from_model, &frame);
                (sample, frame, seen)
            }))
        };
        let drawn: Vec<Drawn> = matched.par_iter().enumerate().map(draw).collect();

        let mut set = PairSet::default();
        let (mut refined, mut rest) = (Vec::new(), Vec::new());
        for ((instance, estimate), drawn) in matched.into_iter().zip(drawn) {
            match (estimate, drawn?) {
                (Some(estimate), Some((sample, frame, seen))) => {
                    set.seen.push(Some(seen));
                    set.source.push(sample.source);
                    set.target.push(sample.target);
                    set.target_from_source.push(sample.target_from_source);
                    set.label.push(instance.object as i32);
                    refined.push((instance, estimate, frame));
                }
                (estimate, _) => rest.push((instance, estimate)),
            }
        }
        if refined.is_empty() {
            return Err(BopError::Empty {
                path: scenes.dir.clone(),
                what: "no object with an estimate has a depth inside its mask",
            });
        }
        Ok(Refinements {
            set,
            refined,
            rest,
            scenes,
            models,
        })
    }

    /// Number of objects to evaluate that cannot be refined, and how many of these have no estimate.
    pub fn unrefined(&self) -> (usize, usize) {
        let missing = self.rest.iter().filter(|(_, e)| e.is_none()).count();
        (self.rest.len(), missing)
    }

    /// The refined poses in the camera's frame, millimetres, with the estimates' scores; an object that cannot be
    /// refined keeps its estimate. `target_from_source` has one registration for each pair of the set.
    pub fn results(&self, target_from_source: &[Pose]) -> Vec<Estimate> {
        let refined = self.refined.iter().zip(target_from_source);
        let refined = refined.map(|((_, estimate, frame), pose)| Estimate {
            camera_from_model: frame.refined(&estimate.camera_from_model, pose),
            time_s: -1.0,
            ..*estimate
        });
        let mut results: Vec<Estimate> = refined.collect();
        results.extend(self.rest.iter().filter_map(|(_, estimate)| *estimate));
        results.sort_by_key(|e| (e.scene, e.image, e.object));
        results
    }

    /// All poses that are evaluated, with their errors, for registrations as in [`Self::results`]. Reads the images again.
    ///
    /// # Errors
    /// An image that cannot be read any more.
    pub fn estimated(&self, target_from_source: &[Pose]) -> Result<Vec<Estimated>, BopError> {
        let refined = self.refined.iter().zip(target_from_source);
        let refined = refined.map(|((instance, estimate, frame), pose)| {
            let pose = frame.refined(&estimate.camera_from_model, pose);
            (instance, Some(pose))
        });
        let rest = self.rest.iter().map(|(instance, estimate)| {
            let pose = estimate.map(|e| e.camera_from_model);
            (instance, pose)
        });
        let all: Vec<(&Instance, Option<Pose>)> = refined.chain(rest).collect();
        let measured = all.into_par_iter().map(|(instance, estimate)| {
            let truth = instance.camera_from_model;
            let errors = match (estimate, self.models.get(instance.object)) {
                (Some(estimate), Some(model)) => {
                    let seen = self.scenes.observe(instance, MaskKind::Estimated)?;
                    PoseErrors::of(model, &seen, &truth, &estimate)
                }
                _ => PoseErrors::MISSING,
            };
            Ok(Estimated {
                object: instance.object,
                truth,
                estimate,
                errors,
            })
        });
        measured.collect()
    }
}

/// The view point and background of an object that the estimate places in the model's frame, in normalised units.
fn seen(image: &DepthImage, estimate: &Pose, frame: &Normalisation) -> Seen {
    let model_from_camera = estimate.inverse();
    let placed = |point: Vec3| frame.point(model_from_camera.apply(point));
    let background = image.background_across(ACROSS).into_iter();
    Seen {
        view_point: placed(Vec3::ZERO),
        background: background
            .map(|point| placed(Vec3::from_array(point)))
            .collect(),
    }
}

/// Each annotated object, with its estimate if it has one.
fn matched(instances: &[Instance], mut estimates: Vec<Estimate>) -> Vec<Matched> {
    let mut places: BTreeMap<(u32, u32, u32), Vec<usize>> = BTreeMap::new();
    for (place, i) in instances.iter().enumerate() {
        let key = (i.scene, i.image, i.object);
        places.entry(key).or_default().push(place);
    }
    let mut matched: Vec<_> = instances.iter().map(|&i| (i, None)).collect();
    estimates.sort_by(|a, b| b.score.total_cmp(&a.score));
    for estimate in estimates {
        let key = (estimate.scene, estimate.image, estimate.object);
        let distance = |&place: &usize| {
            let truth = &instances[place].camera_from_model;
            truth
                .translation
                .distance(estimate.camera_from_model.translation)
        };
        let free = places.get(&key).into_iter().flatten().copied();
        let nearest = free
            .filter(|&place| matched[place].1.is_none())
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(place) = nearest {
            matched[place].1 = Some(estimate);
        }
    }
    matched
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32) -> Pose {
        Pose {
            translation: Vec3::new(x, 0.0, 900.0),
            ..Pose::IDENTITY
        }
    }

    #[test]
    fn estimates_go_to_the_nearest_free_annotation_best_score_first() {
        let instance = |image, index, x| Instance {
            scene: 1,
            image,
            index,
            object: 4,
            camera_from_model: at(x),
            visible: 1.0,
        };
        let estimate = |image, score, x| Estimate {
            scene: 1,
            image,
            object: 4,
            score,
            camera_from_model: at(x),
            time_s: -1.0,
        };
        let instances = [
            instance(0, 0, 0.0),
            instance(0, 1, 100.0),
            instance(5, 0, 0.0),
        ];
        let estimates = vec![
            estimate(0, 0.2, 30.0),
            estimate(0, 0.9, 10.0),
            estimate(0, 0.1, 100.0),
            estimate(3, 1.0, 0.0),
        ];
        let scores: Vec<Option<f32>> = matched(&instances, estimates)
            .into_iter()
            .map(|(_, e)| e.map(|e| e.score))
            .collect();
        assert_eq!(scores, [Some(0.9), Some(0.2), None]);
    }
}
