//! What users ask for: registrations in the clouds' own coordinates, in f64.

use crate::pose64::{Pose64, Position};
use crate::register::all_points::decided_by_all_points;
use crate::register::best::{Best, Other, best_and_others};
use crate::register::dense::{Dense, DenseRefinement, refine_densely};
use crate::register::deviations::Deviations;
use crate::register::prepared::Prepared;
use crate::register::scale::other_size;
use crate::register::seen::lies_among;
use crate::register::{Memory, Registered, Start, register_in};
use glam::Vec3;
use reagent_core::dims::STEPS;
use reagent_core::pipeline::{Mode, Task};
use reagent_core::verdict::Verdict;
use reagent_core::{Error, Frame, Policy, Pose, start};
use std::time::Instant;

/// Least share of the points near the target for a source that shows the target and nothing else, whatever its
/// noise. Views of depth cameras have .95 and more.
const LEAST_WITHIN: f32 = 0.9;

/// What to do with two clouds, in their own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Where the registration starts.
    pub start: Start,
    /// How far from the truth the start may be; the core's default if not given. Nothing for a start from anywhere.
    pub deviations: Option<Deviations>,
    /// Which of the policy's steps, refinement and verification are done.
    pub mode: Mode,
    /// Most steps of the policy; 0 leaves the policy out.
    pub steps: usize,
    /// Where the sensor stood in the source's coordinates, if the source is a view from one point.
    pub view_point: Option<Position>,
    /// Whether the pose is finally refined on many points; never in [`Mode::Fast`].
    pub dense: Dense,
}

impl Default for Request {
    fn default() -> Request {
        Request {
            start: Start::Identity,
            deviations: None,
            mode: Mode::Verify,
            steps: STEPS,
            view_point: None,
            dense: Dense::Auto,
        }
    }
}

/// A registered pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Done {
    /// Answer and steps, between coordinates relative to the clouds' origins.
    pub found: Registered,
    /// The last refinement, if it improved the pose.
    pub dense: Option<DenseRefinement>,
    /// Whether the last refinement was dropped because it did not improve the pose.
    pub is_dense_dropped: bool,
    /// target_from_source between the clouds' own coordinates.
    pub pose: Pose64,
    /// The pose before the first step, relative to the clouds' origins.
    pub initial: Pose,
    /// Number of the start that it came from, if there were several.
    pub start: Option<usize>,
    /// Size of the source relative to the target, if the two seem to differ ([`other_size`]).
    pub other_size: Option<f32>,
    /// Whether the view point lies among the source's points, so that nothing follows from it.
    pub is_seen_from_among: bool,
    /// The next best poses, as many as were asked for at most.
    pub others: Vec<Other>,
    /// Time, milliseconds.
    pub ms: f64,
}

impl Done {
    /// The final pose, relative to the clouds' origins.
    pub fn near(&self) -> Pose {
        let reached = self.found.answer.target_from_source;
        self.dense.map_or(reached, |dense| dense.target_from_source)
    }

    /// Share of the target where the sensor saw something behind it, if that is too large for a right pose.
    pub fn seen_through(&self) -> Option<f32> {
        let found = self.found.answer.refinement.as_ref()?;
        let is_too_much = found.evidence.is_seen_through();
        is_too_much.then_some(found.refined.seen_through)
    }

    /// Share of the source's points off the target, if it is too large for noise although the pose is called right.
    pub fn off_target(&self) -> Option<f32> {
        let answer = &self.found.answer;
        let found = answer.refinement.as_ref()?;
        let within = found.refined.within;
        // A difference in size explains it.
        let is_told_right = answer.verdict == Verdict::Converged && self.other_size.is_none();
        (is_told_right && within < LEAST_WITHIN).then_some(1.0 - within)
    }
}

impl Request {
    /// Registers `source` to `target`.
    ///
    /// # Errors
    /// Clouds, a start or a view point that the core refuses.
    pub fn register(
        &self,
        policy: Policy<'_>,
        memory: &mut Memory,
        source: &Prepared<'_>,
        target: &Prepared<'_>,
    ) -> Result<Done, Error> {
        let go_on = || Ok::<_, Error>(());
        self.register_from(&[self.start], 1, policy, memory, [source, target], go_on)
    }

    /// The same from several starts, in place of the request's own ([`best_and_others`]). The result is the most
    /// probable pose, by its fit and its start, with the next `best - 1` ones beside it. [`Mode::Fast`] does not
    /// look at fits and takes the first start's. `go_on` is asked between two starts.
    ///
    /// # Errors
    /// As [`Request::register`], and whatever `go_on` returns.
    pub fn register_from<E: From<Error>>(
        &self,
        starts: &[Start],
        best: usize,
        policy: Policy<'_>,
        memory: &mut Memory,
        clouds: [&Prepared<'_>; 2],
        go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Done, E> {
        let before = Instant::now();
        let mut done = self.untimed(starts, best, policy, memory, clouds, go_on)?;
        done.ms = before.elapsed().as_secs_f64() * 1e3;
        Ok(done)
    }

    /// The same without a clock, which a browser does not have: the time is 0.
    ///
    /// # Errors
    /// As [`Request::register_from`].
    pub fn untimed<E: From<Error>>(
        &self,
        starts: &[Start],
        best: usize,
        policy: Policy<'_>,
        memory: &mut Memory,
        [source, target]: [&Prepared<'_>; 2],
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Done, E> {
        let clouds = [source.points(), target.points()];
        let view_point = self.seen_from(source);
        let task = |start| self.task(start, [source, target]);
        let wanted = match self.dense {
            Dense::Never => false,
            Dense::Always => true,
            Dense::Auto => source.is_thinned() || target.is_thinned(),
        };
        let is_refined = wanted && self.mode != Mode::Fast;
        let tasks: Vec<Task<'_>> = starts.iter().map(task).collect();
        let mut found = Vec::with_capacity(tasks.len());
        for (i, task) in tasks.iter().enumerate() {
            if i > 0 {
                go_on()?;
            }
            let once = register_in(memory, policy, clouds[0], clouds[1], task)?;
            found.push(if is_refined {
                decided_by_all_points(memory, [source, target], task, once)?
            } else {
                once
            });
        }
        let next_best = best.saturating_sub(1);
        let Best {
            start,
            found,
            others,
        } = best_and_others(memory, clouds, &tasks, found, next_best)?;
        let reached = found.answer.target_from_source;
        let dense = if is_refined {
            let eye = view_point.map(|view_point| reached.apply(view_point));
            refine_densely(&source.all, &target.all_seen_from(eye)?, reached)?
        } else {
            None
        };
        let other_size = match &found.answer.refinement {
            Some(refinement) => other_size(&mut memory.workspace, clouds, &refinement.refined)?,
            None => None,
        };
        let near = dense.map_or(reached, |d| d.target_from_source);
        Ok(Done {
            pose: Pose64::of(near, source.origin, target.origin),
            initial: starts[start].near(source.origin, target.origin),
            start: (starts.len() > 1).then_some(start),
            other_size,
            is_seen_from_among: view_point.is_some_and(|eye| lies_among(eye, clouds[0])),
            others,
            ms: 0.0,
            found,
            is_dense_dropped: is_refined && dense.is_none(),
            dense,
        })
    }

    /// Does once what the first registration to a target would do otherwise: a view of a mesh needs to know which way its faces look,
    /// which takes longer than a camera's next image.
    pub fn get_ready(&self, target: &Prepared<'_>) {
        if self.view_point.is_some() {
            target.outward();
        }
    }

    /// The core's task from one start, in coordinates relative to the clouds' origins.
    pub(super) fn task<'s>(
        &self,
        start: &Start,
        [source, target]: [&'s Prepared<'_>; 2],
    ) -> Task<'s> {
        let view_point = self.seen_from(source);
        Task {
            mode: self.mode,
            steps: self.steps,
            view_point,
            background: &source.background,
            outward: view_point.map_or(&[], |_| target.outward()),
            ..Task::new(self.uncertain(start.start(source.origin, target.origin), target))
        }
    }

    /// The start with the uncertainty that was asked for.
    fn uncertain(&self, start: start::Start, target: &Prepared<'_>) -> start::Start {
        match (start, self.deviations) {
            (start::Start::Pose(pose, _), Some(deviations)) => {
                // A target that has no size is refused later.
                let radius = Frame::of(target.points()).map_or(1.0, |frame| frame.scale);
                start::Start::Pose(pose, deviations.in_radii(radius))
            }
            _ => start,
        }
    }

    /// The view point relative to the source's origin.
    fn seen_from(&self, source: &Prepared<'_>) -> Option<Vec3> {
        let relative = |at: Position| [0, 1, 2].map(|k| (at[k] - source.origin[k]) as f32).into();
        self.view_point.map(relative)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::cloud_file::CloudFile;
    use crate::dataset::mesh::Mesh;
    use crate::dataset::winding::tests::block;
    use crate::dataset::{Point, procedural};
    use crate::policy::WeightFile;
    use crate::random::{Purpose, stream};
    use reagent_core::polish::Refined;
    use reagent_core::pose::rotation_from_euler;
    use std::path::Path;

    #[test]
    fn without_steps_the_start_is_verified() {
        let mesh = procedural::shape(1, 1).mesh;
        let clouds = [1, 2].map(|i| mesh.sample(400, &mut stream(3, Purpose::Surface, i)));
        let [source, target] = clouds
            .each_ref()
            .map(|cloud| Prepared::of_points(cloud, Path::new("cloud"), None).expect("a cloud"));
        let file = WeightFile::pretrained();
        let memory = &mut Box::new(Memory::new());
        let mut register = |request: Request| {
            let done = request.register(file.policy(), memory, &source, &target);
            done.expect("two clouds").found
        };
        let verified = register(Request {
            steps: 0,
            ..Request::default()
        });
        assert!(verified.trace.is_empty() && verified.answer.policy.is_none());
        let refinement = verified.answer.refinement.expect("a refinement");
        assert!(refinement.hypotheses.is_some());
        // The refined pose is where verification begins.
        let refined = register(Request {
            mode: Mode::Refine,
            ..Request::default()
        });
        let alone = refined.answer.refinement.expect("a refinement");
        assert_eq!(alone.polished, refinement.polished);
        let stepped = register(Request::default());
        assert!(stepped.answer.policy.is_some_and(|policy| policy.steps > 0));
    }

    /// The upper side of a plate as a sensor above it sees it, starting nearer to the lower side.
    #[test]
    fn a_solid_is_registered_by_the_side_that_was_seen() {
        let plate = block(Vec3::ZERO, Vec3::new(1.6, 1.0, 0.06));
        let side = |p: &Point| p[2] > 0.0299 && p[0].abs() < 0.79 && p[1].abs() < 0.49;
        let seen = plate.sample(1500, &mut stream(3, Purpose::Surface, 0));
        let seen: Vec<Point> = seen.into_iter().filter(side).collect();
        let name = Path::new("cloud");
        let source = Prepared::of_points(&seen, name, None).expect("a cloud");
        let nearer_the_lower = Pose {
            translation: Vec3::new(0.0, 0.0, -0.05),
            ..Pose::IDENTITY
        };
        let request = Request {
            start: Start::Pose(Pose64::of(nearer_the_lower, [0.0; 3], [0.0; 3])),
            mode: Mode::Refine,
            view_point: Some([0.0, 0.0, 4.0]),
            ..Request::default()
        };
        let policy = WeightFile::pretrained();
        let memory = &mut Box::new(Memory::new());
        let mut height = |mesh: &Mesh, dense| {
            let file = CloudFile {
                faces: Some(mesh.faces.clone()),
                ..CloudFile::of(
                    &mesh
                        .vertices
                        .iter()
                        .map(|v| v.to_array())
                        .collect::<Vec<_>>(),
                )
            };
            let target = Prepared::of_file(&file, name, None, 1).expect("a mesh");
            let request = Request { dense, ..request };
            let done = request.register(policy.policy(), memory, &source, &target);
            done.expect("two clouds").near().translation.z
        };
        let mut inside_out = plate.clone();
        inside_out.faces.iter_mut().for_each(|face| face.swap(0, 1));
        // Without one of its narrow sides it encloses nothing.
        let mut open = plate.clone();
        open.faces.remove(0);
        for solid in [&plate, &inside_out, &open] {
            for dense in [Dense::Never, Dense::Always] {
                assert!(height(solid, dense).abs() < 0.006);
            }
        }
    }

    /// Two starts that lead astray, and one near the truth.
    #[test]
    fn the_best_of_several_starts_wins_and_others_follow() {
        let mesh = procedural::shape(1, 1).mesh;
        let clouds = [1, 2].map(|i| mesh.sample(400, &mut stream(3, Purpose::Surface, i)));
        let [source, target] = clouds
            .each_ref()
            .map(|cloud| Prepared::of_points(cloud, Path::new("cloud"), None).expect("a cloud"));
        let turned = |angles: [f32; 3]| {
            let pose = Pose {
                rotation: rotation_from_euler(Vec3::from(angles)),
                translation: Vec3::ZERO,
            };
            Start::Pose(Pose64::of(pose, [0.0; 3], [0.0; 3]))
        };
        let starts = [
            turned([2.5, 0.3, 0.0]),
            turned([0.1, 0.1, 0.0]),
            turned([0.0, 2.0, 1.0]),
        ];
        let file = WeightFile::pretrained();
        let memory = &mut Box::new(Memory::new());
        let mut register = |mode, starts: &[Start], best| {
            let request = Request {
                mode,
                ..Request::default()
            };
            let clouds = [&source, &target];
            let go_on = || Ok::<_, Error>(());
            let done = request.register_from(starts, best, file.policy(), memory, clouds, go_on);
            done.expect("two clouds")
        };
        for mode in [Mode::Refine, Mode::Verify] {
            let done = register(mode, &starts, 4);
            assert_eq!(done.start, Some(1), "{mode}");
            let near = done.near();
            assert!(near.rotation.x_axis.x > 0.999 && near.rotation.y_axis.y > 0.999);
            // Each is another pose, and fits less well.
            let fit = done.found.answer.refinement.expect("a refinement").refined;
            assert!(!done.others.is_empty() && done.others.len() <= 3, "{mode}");
            for (i, other) in done.others.iter().enumerate() {
                let Refined {
                    target_from_source,
                    residual,
                    ..
                } = other.refined;
                assert!(residual.mean() > fit.residual.mean());
                let rest = done.others[..i].iter();
                let mut named = rest.map(|o| o.refined.target_from_source).chain([near]);
                assert!(named.all(|named| named != target_from_source));
            }
        }
        let alone = register(Mode::Verify, &starts[1..2], 1);
        assert_eq!((alone.start, alone.others.len()), (None, 0));
        // Refined further, a pose may become a better one, which is then given out.
        let probability = |done: &Done| done.found.answer.probability.expect("a refinement");
        let mut found_further = 0;
        for turn in 1..24 {
            let start = [turned([0.25 * turn as f32, 0.4, 0.2])];
            let once = register(Mode::Refine, &start, 1);
            let best = register(Mode::Refine, &start, 3);
            found_further += usize::from(probability(&best) > probability(&once));
            for (best, least) in [
                (&best, probability(&once)),
                (&register(Mode::Verify, &start, 3), 0.0),
            ] {
                assert!(probability(best) >= least, "{turn}");
                let others = best.others.iter().map(|other| other.probability);
                let falling: Vec<f32> = [probability(best)].into_iter().chain(others).collect();
                assert!(falling.is_sorted_by(|a, b| a >= b), "{turn}: {falling:?}");
            }
        }
        assert!(found_further > 0);
    }
}
