//! Tracks an object in a stream of clouds, in their own coordinates.

use crate::policy::{COMPACT, VIEWS_COMPACT};
use crate::pose64::{Pose64, Position};
use crate::register::prepared::Prepared;
use crate::register::request::{Done, Request};
use crate::register::seen::lies_among;
use crate::register::{Memory, Registered, recorder};
use reagent_core::pipeline::Mode;
use reagent_core::track::{TrackState, Tracker};
use reagent_core::{Error, Frame, Policy, Registrar};
use std::time::Instant;

/// Default number of points of each cloud: as many as one core can process at a camera's rate.
pub const POINTS: usize = 1024;

/// The bundled policy for clouds that are views from one point, or that are not. The compact policies are faster,
/// and verification makes up for what they lack.
pub fn bundled_policy(of_views: bool) -> &'static str {
    if of_views { VIEWS_COMPACT } else { COMPACT }
}

/// What the clouds so far have shown of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tracking {
    tracker: Tracker,
    /// Origin of the last cloud.
    source_origin: Position,
}

/// A registered cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracked {
    /// Whether the object is seen in it.
    pub state: TrackState,
    /// Mode of the last registration.
    pub mode: Mode,
    /// Result of the last registration; its pose is not reliable if the object is lost.
    pub done: Done,
}

impl Tracking {
    /// Tracking of an object that no cloud has shown yet.
    pub const fn new() -> Tracking {
        Tracking {
            tracker: Tracker::new(),
            source_origin: [0.0; 3],
        }
    }

    /// Counts a cloud with nothing to register, such as an empty one.
    pub fn miss(&mut self) {
        self.tracker.miss();
    }

    /// Registers the next cloud ([`Tracker::follow`]). The request's mode applies where refinement is not enough,
    /// its start until a cloud has shown the object. Poses are refined on no more points than the policy sees.
    ///
    /// # Errors
    /// As [`Request::register`].
    pub fn follow(
        &mut self,
        request: &Request,
        policy: Policy<'_>,
        memory: &mut Memory,
        [source, target]: [&Prepared<'_>; 2],
    ) -> Result<Tracked, Error> {
        let begun = Instant::now();
        let before = std::mem::replace(&mut self.source_origin, source.origin);
        if let Some(last) = &mut self.tracker.last
            && before != source.origin
        {
            *last = Pose64::of(*last, before, target.origin).near(source.origin, target.origin);
        }
        let task = request.task(&request.start, [source, target]);
        let initial = self.tracker.last.unwrap_or(task.start.pose());
        let mut trace = Vec::new();
        let sighting = self.tracker.follow(
            &mut Registrar::new(policy, &mut memory.scratch),
            &mut memory.workspace,
            [source.points(), target.points()],
            &task,
            recorder(&mut trace, Frame::of(target.points())?),
        )?;
        let answer = sighting.answer;
        Ok(Tracked {
            state: sighting.state,
            mode: sighting.mode,
            done: Done {
                pose: Pose64::of(answer.target_from_source, source.origin, target.origin),
                found: Registered { answer, trace },
                dense: None,
                is_dense_dropped: false,
                initial,
                start: None,
                other_size: None,
                is_seen_from_among: task
                    .view_point
                    .is_some_and(|eye| lies_among(eye, source.points())),
                others: Vec::new(),
                ms: begun.elapsed().as_secs_f64() * 1e3,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::policy::WeightFile;
    use crate::random::{Purpose, stream};
    use crate::register::Start;
    use glam::Vec3;
    use reagent_core::Pose;
    use reagent_core::pose::rotation_from_euler;
    use std::path::Path;

    /// Clouds on a map are each registered relative to another origin.
    #[test]
    fn the_last_pose_follows_the_clouds_origins() {
        let mesh = procedural::shape(1, 1).mesh;
        let cloud = |i| mesh.sample(500, &mut stream(3, Purpose::Surface, i));
        let name = Path::new("cloud");
        let model = cloud(0);
        let model = Prepared::of_points(&model, name, None).expect("a cloud");
        let offset = [5e5, 5.4e6, 0.0];
        let truth = |step: u64| {
            let t = step as f32;
            Pose {
                rotation: rotation_from_euler(Vec3::new(0.3, 0.05 * t, -0.04 * t)),
                translation: Vec3::new(0.1 * t, 0.0, 0.0),
            }
        };
        let on_map = |point: Vec3| [0, 1, 2].map(|k| f64::from(point[k]) + offset[k]);
        let request = Request {
            start: Start::Pose(Pose64::of(truth(0), offset, [0.0; 3])),
            ..Request::default()
        };
        let file = WeightFile::pretrained();
        let (mut tracking, mut memory) = (Tracking::new(), Box::new(Memory::new()));
        let mut last = Pose64::of(truth(0), offset, [0.0; 3]);
        for step in 0..4 {
            let back = truth(step).inverse();
            let seen = cloud(step + 1).into_iter();
            let seen = seen.map(|p| on_map(back.apply(p.into())));
            let source = Prepared::of_positions(seen.collect(), name, None).expect("a cloud");
            let clouds = [&source, &model];
            let found = tracking.follow(&request, file.policy(), &mut memory, clouds);
            let Tracked { state, mode, done } = found.expect("two clouds");
            let expected = match step {
                0 => (TrackState::Found, Mode::Verify),
                _ => (TrackState::Tracked, Mode::Refine),
            };
            assert_eq!((state, mode), expected, "{step}");
            let begun = Pose64::of(done.initial, source.origin, model.origin);
            let ends = [0, 1].map(|i| [begun, last][i].apply(source.origin));
            let apart = [0, 1, 2].map(|k| (ends[0][k] - ends[1][k]).abs());
            assert!(apart.iter().all(|x| *x < 1e-3), "{step}: {apart:?}");
            last = done.pose;
            let centre = done.pose.apply(on_map(back.translation));
            assert!(centre.iter().all(|x| x.abs() < 0.02), "{step}: {centre:?}");
        }
    }
}
