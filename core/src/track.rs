//! Tracking: follows an object through a stream of clouds, with a bounded amount of work for each.
//!
//! | the object is | first | if that gives no pose that is probably right |
//! |---|---|---|
//! | tracked | closest points from the last pose ([`Mode::Refine`]) | the task's mode from the last pose; if that fails, it is lost |
//! | tracked, but a turn that was open is so no more | the task's mode from the last pose, turned by up to any angle | the refined pose stays |
//! | tracked, but it fits worse than the clouds before | the task's mode from the last pose | the refined pose stays |
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
use crate::verify::{OTHERS, Undetermined};
use core::fmt;

/// Of this many clouds in a row, one gets a whole registration: once a second at a camera's rate.
const WHOLE_EVERY: u32 = 30;
/// Uncertainty of a lost object's last pose: it may have turned by a right angle and moved by its own size since.
const LOST: Uncertainty = Uncertainty {
    rotation_rad: 1.5,
    along: 2.0,
    across: 2.0,
};

/// Uncertainty of a tracked object's last pose if a turn was open: what settles the angle may have come into view anywhere.
const OPEN: Uncertainty = Uncertainty {
    rotation_rad: 1.5,
    ..Uncertainty::DEFAULT
};
/// Drop of a refined pose's log-odds, below the mean of those before, from which on it may be in a neighbouring minimum; and the share
/// of each cloud in that mean.
const DROPPED: f32 = 0.5;
const SHARE: f32 = 0.2;
/// Angle below which a refined pose and one that was found by comparing poses are one, radians.
const SAME_RAD: f32 = 0.05;

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
    /// Mean log-odds of their poses, the last ones first.
    level: Option<f32>,
    /// Whether a turn of the last refined pose was open.
    open: bool,
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
            level: None,
            open: false,
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
        let refined = refined.filter(|answer| before.takes(answer));
        let (answer, mode) = match refined {
            Some(answer) if !before.is_doubtful(&answer) => (answer, Mode::Refine),
            _ => {
                let has_closed = refined.is_some_and(|answer| before.open && !is_open(&answer));
                let start = before.search_from(task.start, has_closed);
                let answer = register(task.mode, start)?;
                match refined.filter(|_| !before.takes(&answer)) {
                    Some(refined) => (refined, Mode::Refine),
                    None => (before.nearest_to_last(answer), task.mode),
                }
            }
        };
        let state = match (before.takes(&answer), before.pose()) {
            (false, _) => TrackState::Lost,
            (true, Some(_)) => TrackState::Tracked,
            (true, None) => TrackState::Found,
        };
        if state != TrackState::Lost {
            *self = before.after(&answer, mode, refined);
        }
        Ok(Sighting {
            state,
            answer,
            mode,
        })
    }

    /// With the object in this cloud, where `refined` was found first.
    fn after(&self, answer: &Answer, mode: Mode, refined: Option<Answer>) -> Tracker {
        let is_refined = mode == Mode::Refine;
        // A pose that was replaced by another does not show how well right poses fit.
        let is_confirmed = |refined: &Answer| {
            let turn = refined
                .target_from_source
                .angle_to(&answer.target_from_source);
            is_refined || turn < SAME_RAD
        };
        let now = refined.filter(is_confirmed).as_ref().and_then(log_odds);
        let level = match (self.level, now) {
            (Some(level), Some(now)) => Some(level + SHARE * (now - level)),
            (level, now) => now.or(level),
        };
        Tracker {
            last: Some(answer.target_from_source),
            missed: 0,
            refined: if is_refined { self.refined + 1 } else { 0 },
            level,
            open: is_refined && is_open(answer),
        }
    }

    /// Whether a refined pose may be in a neighbouring minimum.
    fn is_doubtful(&self, answer: &Answer) -> bool {
        let has_closed = self.open && !is_open(answer);
        let levels = self.level.zip(log_odds(answer));
        has_closed || levels.is_some_and(|(level, now)| now < level - DROPPED)
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
        let given = answer.target_from_source;
        let turned = |pose: &Pose| pose.angle_to(&last);
        let open = &mut found.undetermined;
        let nearest_of = |open: &Undetermined, given| {
            let all = open.copies(given).chain(core::iter::once(given));
            all.min_by(|a, b| turned(a).total_cmp(&turned(b)))
        };
        let nearest = nearest_of(open, given).filter(|nearest| turned(nearest) < turned(&given));
        let Some(nearest) = nearest else {
            return answer;
        };
        // If it belongs to another pose than the given one, that takes the other's place.
        let alone = Undetermined {
            poses: [None; OTHERS],
            fold: open.fold.filter(|fold| fold.of_others),
            ..*open
        };
        let others = open.poses.iter_mut().flatten();
        let of_other = others.filter(|other| nearest_of(&alone, **other) == Some(nearest));
        of_other.for_each(|other| *other = given);
        answer.target_from_source = nearest;
        found.refined.target_from_source = nearest;
        answer
    }

    /// Where to start when refinement is not enough.
    fn search_from(&self, first: Start, has_closed: bool) -> Start {
        match (self.last.map_or(first, Start::at), self.missed) {
            (Start::Anywhere, _) => Start::Anywhere,
            (Start::Pose(last, _), 0) if has_closed => Start::Pose(last, OPEN),
            (last, 0) => last,
            (Start::Pose(last, _), missed) if missed % 2 == 1 => Start::Pose(last, LOST),
            _ => Start::Anywhere,
        }
    }
}

/// Whether a turn is open.
fn is_open(answer: &Answer) -> bool {
    let open = answer.refinement.as_ref().map(|found| found.undetermined);
    open.is_some_and(|open| open.axis.is_some())
}

/// Log-odds of the answer's probability.
fn log_odds(answer: &Answer) -> Option<f32> {
    answer.probability.map(|p| libm::logf(p / (1.0 - p)))
}

#[cfg(all(test, feature = "pretrained-compact"))]
mod tests;
