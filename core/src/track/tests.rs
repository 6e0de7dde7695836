use super::*;
use crate::net::Scratch;
use crate::polish::tests::{Numbers, error, moved, part, pose};
use crate::verify::Fold;
use crate::verify::tests::{brick, revolved};
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
    // Turned by a third about y, the given pose fits as well, and so does the other.
    let open = &mut answer.refinement.as_mut().expect("refined").undetermined;
    open.poses = [Some(far), None, None, None, None];
    open.fold = Some(Fold {
        point: Vec3::ZERO,
        direction: Vec3::Y,
        order: 3,
        of_others: true,
    });
    for (angle, turn, first) in [(2.0, 2.094_395, far), (-1.1, 3.0 + 2.094_395, given)] {
        let tracker = Tracker {
            last: Some(pose([0.0, angle, 0.0], [0.2; 3]).after(given)),
            ..Tracker::new()
        };
        let found = tracker.nearest_to_last(answer);
        let expected = pose([0.0, turn, 0.0], [0.0; 3]).after(given);
        let (degrees, distance) = error(found.target_from_source, expected);
        assert!(degrees < 0.1 && distance < 1e-3, "{angle}: {degrees}");
        let open = found.refinement.expect("refined").undetermined;
        assert_eq!(open.poses[0], Some(first), "{angle}");
    }
}

/// A jar with a handle on one side, of so many points, and the part of it on which the handle is not.
fn jar(count: usize, seed: u32) -> [Vec<[f32; 3]>; 2] {
    let body = revolved(&mut Numbers(seed), count, |z| 0.5 + 0.1 * z, 0.8);
    let handle = brick([0.2, 0.08, 0.3], count / 4, seed + 1);
    let handle = moved(&handle, pose([0.0; 3], [0.65, 0.0, 0.1]));
    let plain = body.iter().copied().filter(|&[x, ..]| x < 0.3);
    let plain: Vec<_> = plain.collect();
    [body.into_iter().chain(handle).collect(), plain]
}

/// While the handle is hidden, the jar turns. As soon as the handle is seen again, the angle is known again.
#[test]
fn a_turn_that_was_open_is_looked_for_once_it_is_not() {
    let mut following = Following::new();
    let ([model, _], [whole, plain]) = (jar(700, 5), jar(800, 8));
    following.model = model;
    let turned = |turn| pose([0.1, 0.0, turn], [0.05, 0.0, 0.0]);
    let mut see = |points: &[[f32; 3]], turn: f32| {
        let source = moved(points, turned(turn).inverse());
        let found = following.see(&source).expect("a cloud");
        let (angle, _) = error(found.answer.target_from_source, turned(turn));
        (found.state, found.mode, angle)
    };
    let (state, _, off) = see(&whole, 0.0);
    assert!(state == TrackState::Found && off < 2.0, "{off}");
    for turn in [0.05, 0.3, 0.6, 0.9, 1.2] {
        let (state, mode, off) = see(&plain, turn);
        assert_eq!(
            (state, mode),
            (TrackState::Tracked, Mode::Refine),
            "{turn}: {off}"
        );
    }
    let (state, mode, off) = see(&whole, 1.25);
    assert_eq!((state, mode), (TrackState::Tracked, Mode::Best));
    assert!(off < 2.0, "{off}");
}

#[test]
fn a_pose_that_fits_worse_than_those_before_is_doubtful() {
    let mut following = Following::new();
    let seen = following.see(&part(500, 1)).expect("a cloud");
    let answer = |probability| Answer {
        probability: Some(probability),
        ..seen.answer
    };
    let after = |tracker: Tracker, p| tracker.after(&answer(p), Mode::Refine, Some(answer(p)));
    let tracker = after(after(Tracker::new(), 0.994), 0.995);
    assert_eq!(tracker.refined, 2);
    assert!(!tracker.is_doubtful(&answer(0.993)));
    assert!(tracker.is_doubtful(&answer(0.989)));
    // Or one whose turn is open no more.
    let was_open = Tracker {
        open: true,
        ..tracker
    };
    assert!(was_open.is_doubtful(&answer(0.995)));
    let last = seen.answer.target_from_source;
    let start = was_open.search_from(Start::Anywhere, true);
    assert_eq!(start, Start::Pose(last, OPEN));
    // Nothing is known of how well poses fit before the first.
    assert!(!Tracker::new().is_doubtful(&answer(0.6)));
    // A pose that was found instead leaves the level as it is; one that was confirmed does not.
    let elsewhere = Answer {
        target_from_source: pose([0.2, 0.0, 0.0], [0.0; 3]).after(seen.answer.target_from_source),
        ..answer(0.9)
    };
    let replaced = tracker.after(&answer(0.99), Mode::Best, Some(elsewhere));
    assert_eq!((replaced.level, replaced.refined), (tracker.level, 0));
    let confirmed = tracker.after(&answer(0.99), Mode::Best, Some(answer(0.9)));
    assert!(confirmed.level < tracker.level);
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
            let start = tracker.search_from(first, false);
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
