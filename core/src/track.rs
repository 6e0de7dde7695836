//! Tracking: follows an object through a stream of clouds, with a bounded amount of work for each.
//!
//! | the object is | first | if that gives no pose that is probably right |
//! |---|---|---|
//! | tracked | closest points from the last pose ([`Mode::Refine`]) | the task's mode from the last pose; if that fails, it is lost |
//! | tracked, every thirtieth cloud | the task's mode from the last pose, since closest points may stay in a neighbouring minimum | it is lost |
//! | lost | the task's mode, alternately from the last pose with far more uncertainty and from anywhere | it is still lost |
//!
//! So a cloud costs at most one refinement and one whole registration.
//!
//! A pose is probably right if its verdict is [`Verdict::Converged`]. A pose that continues no track, because the object was
//! lost or has moved far, needs a higher probability: each cloud without the object is another chance for a ghost. Of poses
//! that fit equally well, the one rotated least from the last is taken.

use crate::covariance::Covariance;
use crate::error::Error;
use crate::pipeline::{Answer, Mode, Progress, Task, register};
use crate::polish::Workspace;
use crate::pose::Pose;
use crate::register::Registrar;
use crate::start::{Start, Uncertainty};
use crate::verdict::Verdict;
use core::fmt;

/// Of this many clouds in a row, one gets a whole registration: once a second at a camera's rate.
const WHOLE_EVERY: u32 = 30;
/// Uncertainty of a lost object's last pose: it may have turned by a right angle and moved by its own size since.
const LOST: Uncertainty = Uncertainty {
    rotation_rad: 1.5,
    along: 2.0,
    across: 2.0,
};

/// Most by which an object turns (radians) and moves (target radii) from one cloud to the next. At a camera's rate that is 900
/// degrees and 18 radii a second.
const CONTINUES: [f32; 2] = [0.524, 0.6];
/// Least probability of a pose that continues no track. On 154 rendered sequences, no ghost had more than .77.
const PROBABLE: f32 = 0.8;

/// What the clouds so far tell about an object.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tracker {
    /// `target_from_source` when the object was last seen. Callers who change the frame of the clouds must change this as well.
    pub last: Option<Pose>,
    /// Clouds without the object since then, or since the start.
    missed: u32,
    /// Clouds in a row that were only refined.
    refined: u32,
}

/// What a cloud tells about the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackState {
    /// It is in this cloud, as in the one before.
    Tracked,
    /// It is in this cloud, but was lost or never seen before.
    Found,
    /// It is not in this cloud, as far as can be told.
    Lost,
}

impl fmt::Display for TrackState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            TrackState::Tracked => "tracked",
            TrackState::Found => "found",
            TrackState::Lost => "lost",
        })
    }
}

/// A registered cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// What it tells about the object.
    pub state: TrackState,
    /// Answer of the last registration. If the object is lost, its pose is unreliable.
    pub answer: Answer,
    /// Mode of the last registration.
    pub mode: Mode,
}

impl Tracker {
    /// A tracker for an object that no cloud has shown.
    pub const fn new() -> Tracker {
        Tracker {
            last: None,
            missed: 0,
            refined: 0,
        }
    }

    /// The object's pose, unless it is lost.
    fn pose(&self) -> Option<Pose> {
        self.last.filter(|_| self.missed == 0)
    }

    /// Takes in a cloud with nothing to register, such as an empty one.
    pub fn miss(&mut self) {
        self.missed = self.missed.saturating_add(1);
    }

    /// Registers the next cloud, `[source, target]`, as [`register`] does. The task's mode applies when refinement is not
    /// enough, its start while no cloud has shown the object.
    ///
    /// # Errors
    /// As [`register`]; a cloud that is refused or abandoned counts as one without the object.
    pub fn follow<'c, E: From<Error>>(
        &mut self,
        registrar: &mut Registrar<'_, '_>,
        workspace: &mut Workspace,
        clouds: [&'c [[f32; 3]]; 2],
        task: &Task<'_>,
        mut progress: impl FnMut(Progress<'_, 'c>) -> Result<(), E>,
    ) -> Result<Sighting, E> {
        let before = *self;
        self.miss();
        let mut register = |mode, start| {
            let task = Task {
                mode,
                start,
                ..*task
            };
            register(registrar, workspace, clouds, &task, &mut progress)
        };
        let refined = match before.pose() {
            Some(last) if before.refined + 1 < WHOLE_EVERY => {
                Some(register(Mode::Refine, Start::at(last))?)
            }
            _ => None,
        };
        let (answer, mode, refined) = match refined {
            Some(answer) if before.takes(&answer) => (answer, Mode::Refine, before.refined + 1),
            _ => {
                let start = before.search_from(task.start);
                let answer = register(task.mode, start)?;
                (before.nearest_to_last(answer), task.mode, 0)
            }
        };
        let state = match (before.takes(&answer), before.pose()) {
            (false, _) => TrackState::Lost,
            (true, Some(_)) => TrackState::Tracked,
            (true, None) => TrackState::Found,
        };
        if state != TrackState::Lost {
            *self = Tracker {
                last: Some(answer.target_from_source),
                missed: 0,
                refined,
            };
        }
        Ok(Sighting {
            state,
            answer,
            mode,
        })
    }

    /// Whether the answer's pose is accepted as the object's.
    fn takes(&self, answer: &Answer) -> bool {
        let is_probable = |p: f32| p >= PROBABLE;
        let is_certain = answer.probability.is_none_or(is_probable);
        answer.verdict == Verdict::Converged && (is_certain || self.is_continued_by(answer))
    }

    /// Whether the object is tracked and the pose is near enough to its last one.
    fn is_continued_by(&self, answer: &Answer) -> bool {
        let (Some(last), Some(found)) = (self.pose(), answer.refinement) else {
            return false;
        };
        let Covariance { about, radius, .. } = found.refined.covariance;
        let moved = answer.target_from_source.after(last.inverse());
        let [turn, shift] = CONTINUES;
        let distance = moved.apply(about).distance(about);
        answer.target_from_source.angle_to(&last) <= turn && distance <= shift * radius
    }

    /// The answer, with the pose replaced by the one rotated least from the last, among those that fit as well.
    fn nearest_to_last(&self, mut answer: Answer) -> Answer {
        let (Some(last), Some(found)) = (self.last, &mut answer.refinement) else {
            return answer;
        };
        let turned = |pose: &Pose| pose.angle_to(&last);
        let others = found.undetermined.poses.iter_mut().flatten();
        let nearest = others.min_by(|a, b| turned(a).total_cmp(&turned(b)));
        let given = &mut answer.target_from_source;
        if let Some(nearest) = nearest.filter(|nearest| turned(nearest) < turned(given)) {
            core::mem::swap(given, nearest);
            found.refined.target_from_source = *given;
        }
        answer
    }

    /// Where to start when refinement is not enough.
    fn search_from(&self, first: Start) -> Start {
        match (self.last.map_or(first, Start::at), self.missed) {
            (Start::Anywhere, _) => Start::Anywhere,
            (last, 0) => last,
            (Start::Pose(last, _), missed) if missed % 2 == 1 => Start::Pose(last, LOST),
            _ => Start::Anywhere,
        }
    }
}

#[cfg(all(test, feature = "pretrained-compact"))]
mod tests {
    use super::*;
    use crate::net::Scratch;
    use crate::polish::tests::{error, moved, part, pose};
    use crate::weights::Policy;
    use glam::Vec3;

    /// A tracker, and the model of what it follows.
    struct Following {
        tracker: Tracker,
        model: Vec<[f32; 3]>,
        scratch: Box<Scratch>,
        workspace: Box<Workspace>,
    }

    impl Following {
        fn new() -> Following {
            Following {
                tracker: Tracker::new(),
                model: part(600, 2),
                scratch: Box::new(Scratch::new()),
                workspace: Box::new(Workspace::new()),
            }
        }

        /// What the next cloud tells.
        fn see(&mut self, source: &[[f32; 3]]) -> Result<Sighting, Error> {
            let policy = Policy::pretrained_compact().expect("sound");
            let mut registrar = Registrar::new(policy, &mut self.scratch);
            let task = Task::new(Start::at(Pose::IDENTITY));
            let clouds = [source, &self.model];
            let Following {
                tracker, workspace, ..
            } = self;
            tracker.follow(&mut registrar, workspace, clouds, &task, |_| Ok(()))
        }

        /// The same for the object at time `t`; the pose must be right.
        fn see_part(&mut self, t: f32) -> (TrackState, Mode) {
            let truth = pose([0.4 * t, -0.3 * t, 0.5 * t], [0.2 * t, 0.3, -0.1 * t]);
            let source = moved(&part(500, 1), truth.inverse());
            let found = self.see(&source).expect("a cloud");
            let (angle, distance) = error(found.answer.target_from_source, truth);
            assert!(angle < 1.0 && distance < 0.02, "{t}: {angle} {distance}");
            (found.state, found.mode)
        }
    }

    /// Another object.
    fn ball() -> Vec<[f32; 3]> {
        let points = part(500, 7).into_iter();
        points
            .map(|p| (Vec3::from_array(p).normalize() * 0.6).to_array())
            .collect()
    }

    #[test]
    fn an_object_is_found_tracked_lost_and_found_again() {
        let mut following = Following::new();
        assert_eq!(following.see_part(0.0), (TrackState::Found, Mode::Best));
        for i in 1..WHOLE_EVERY {
            let seen = following.see_part(0.02 * i as f32);
            assert_eq!(seen, (TrackState::Tracked, Mode::Refine));
        }
        assert_eq!(following.see_part(0.6), (TrackState::Tracked, Mode::Best));
        assert_eq!(following.see_part(0.7), (TrackState::Tracked, Mode::Refine));
        // Too far for closest points, in one jump.
        assert_eq!(following.see_part(4.0), (TrackState::Tracked, Mode::Best));
        for _ in 0..3 {
            let seen = following.see(&ball()).expect("a cloud");
            assert_eq!((seen.state, seen.mode), (TrackState::Lost, Mode::Best));
        }
        assert_eq!(following.see_part(4.2), (TrackState::Found, Mode::Best));
        assert_eq!(following.see_part(4.3), (TrackState::Tracked, Mode::Refine));
    }

    #[test]
    fn what_continues_no_track_must_be_more_probable() {
        let mut following = Following::new();
        let seen = following.see(&part(500, 1)).expect("a cloud");
        let answer = |probability| Answer {
            probability: Some(probability),
            ..seen.answer
        };
        let takes = |tracker: Tracker| [0.7, 0.9].map(|p| tracker.takes(&answer(p)));
        let near = |angles, shift| Tracker {
            last: Some(pose(angles, shift).after(seen.answer.target_from_source)),
            ..Tracker::new()
        };
        for (last, continued) in [
            (near([0.4, 0.0, 0.0], [0.3, 0.0, 0.0]), true),
            (near([0.6, 0.0, 0.0], [0.0; 3]), false),
            (near([0.0; 3], [0.8, 0.0, 0.0]), false),
            (Tracker::new(), false),
        ] {
            assert_eq!(takes(last), [continued, true], "{last:?}");
            let mut lost = last;
            lost.miss();
            assert_eq!(takes(lost), [false, true], "{last:?}");
        }
        // With the policy alone, only how its steps ended is known.
        let alone = Answer {
            probability: None,
            ..seen.answer
        };
        assert!(Tracker::new().takes(&alone));
        let poor = Answer {
            verdict: Verdict::PoorFit,
            ..answer(0.9)
        };
        assert!(!Tracker::new().takes(&poor));
    }

    #[test]
    fn of_poses_that_fit_as_well_the_one_turned_least_is_taken() {
        let mut following = Following::new();
        let mut answer = following.see(&part(500, 1)).expect("a cloud").answer;
        let given = answer.target_from_source;
        let [far, near] = [3.0, 0.5].map(|turn| pose([0.0, turn, 0.0], [0.0; 3]).after(given));
        let open = &mut answer.refinement.as_mut().expect("refined").undetermined;
        open.poses = [Some(far), Some(near), None, None, None];
        let nearest = |angle| {
            let tracker = Tracker {
                last: Some(pose([0.0, angle, 0.0], [0.2; 3]).after(given)),
                ..Tracker::new()
            };
            tracker.nearest_to_last(answer)
        };
        assert_eq!(Tracker::new().nearest_to_last(answer), answer);
        assert_eq!(nearest(0.1), answer);
        let other = nearest(0.6);
        assert_eq!(other.target_from_source, near);
        let found = other.refinement.expect("refined");
        assert_eq!(found.refined.target_from_source, near);
        let swapped = [Some(far), Some(given), None, None, None];
        assert_eq!(found.undetermined.poses, swapped);
    }

    #[test]
    fn a_refused_cloud_is_one_without_the_object() {
        let mut following = Following::new();
        assert_eq!(following.see(&[]), Err(Error::EmptyCloud));
        assert_eq!(following.see_part(0.0), (TrackState::Found, Mode::Best));
        assert_eq!(following.see(&[]), Err(Error::EmptyCloud));
        assert_eq!(following.see_part(0.1), (TrackState::Found, Mode::Best));
    }

    #[test]
    fn a_lost_object_is_looked_for_by_turns() {
        let first = Start::at(pose([0.1; 3], [0.0; 3]));
        let last = pose([0.2; 3], [1.0; 3]);
        let mut tracker = Tracker::new();
        let starts = |tracker: Tracker, first| {
            let mut tracker = tracker;
            [(); 3].map(|()| {
                let start = tracker.search_from(first);
                tracker.miss();
                start
            })
        };
        let far = |start: Start| Start::Pose(start.pose(), LOST);
        assert_eq!(starts(tracker, first), [first, far(first), Start::Anywhere]);
        assert_eq!(starts(tracker, Start::Anywhere), [Start::Anywhere; 3]);
        tracker.last = Some(last);
        let from_last = [Start::at(last), far(Start::at(last)), Start::Anywhere];
        assert_eq!(starts(tracker, first), from_last);
        assert_eq!(starts(tracker, Start::Anywhere), from_last);
        assert_eq!(tracker.pose(), Some(last));
        tracker.miss();
        assert_eq!(tracker.pose(), None);
    }
}
