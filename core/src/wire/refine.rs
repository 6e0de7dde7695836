//! Asking for a pose, and what comes back, field by field.

use super::CloudView;
use crate::covariance::Covariance;
use crate::error::Error;
pub use crate::pipeline::Mode;
use crate::pipeline::{Refinement, Task};
use crate::polish::Refined;
use crate::pose::Pose;
use crate::start::Start;
use crate::verdict::Verdict;
use crate::verify::Undetermined;
use core::fmt;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Two clouds to register.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefineRequest<'a> {
    /// Chosen by the client, returned with the answer.
    pub id: u64,
    /// Who asks: a number of the client's own, under which it is known to be there and may take requests back;
    /// 0 for one that is not followed.
    pub client: u64,
    /// Time from the arrival at the robot to the answer, milliseconds. When it has passed, the robot answers
    /// [`Reason::Deadline`]: in the queue at once, at work after the step under way.
    pub budget_ms: u32,
    /// What follows the policy's steps.
    pub mode: Mode,
    /// Most steps to take, 10 in the paper; a stop on every axis ends earlier.
    pub max_steps: u8,
    /// Whether the robot publishes a [`super::Trace`] after the answer.
    pub trace: bool,
    /// Estimate of target_from_source as rows of `[R | t]`, in the clouds' units; none: identity.
    pub initial: Option<[[f32; 4]; 3]>,
    /// Whether any rotation is as probable as the initial pose.
    pub anywhere: bool,
    /// Where the sensor stood, in the source's frame and units, if the source is a view from one point.
    pub view_point: Option<[f32; 3]>,
    /// The observed cloud, any units.
    #[serde(borrow)]
    pub source: CloudView<'a>,
    /// The model or reference cloud, same units.
    #[serde(borrow)]
    pub target: CloudView<'a>,
    /// What was seen from the view point besides the source, in its frame and units; one point of a cell is enough
    /// ([`crate::polish::Refiner::nearest_in_cell`]).
    #[serde(borrow)]
    pub background: CloudView<'a>,
    /// Outward directions at the target's points, in their order, as [`Task::outward`]; empty if nothing tells them.
    #[serde(borrow)]
    pub outward: CloudView<'a>,
}

/// Time that a request has unless it says otherwise, milliseconds.
pub const BUDGET_MS: u32 = 10_000;

impl<'a> RefineRequest<'a> {
    /// What it asks for, with its background's points and its outward directions.
    pub fn task<'b>(&self, background: &'b [[f32; 3]], outward: &'b [[f32; 3]]) -> Task<'b> {
        let pose = self.initial.map_or(Pose::IDENTITY, Pose::from_rows);
        Task {
            mode: self.mode,
            steps: usize::from(self.max_steps),
            view_point: self.view_point.map(Vec3::from_array),
            background,
            outward,
            ..Task::new(if self.anywhere {
                Start::Anywhere
            } else {
                Start::at(pose)
            })
        }
    }

    /// A request for the best pose within ten steps and [`BUDGET_MS`], from the identity.
    pub fn new(id: u64, source: CloudView<'a>, target: CloudView<'a>) -> Self {
        RefineRequest {
            id,
            client: 0,
            budget_ms: BUDGET_MS,
            mode: Mode::Best,
            max_steps: crate::dims::STEPS as u8,
            trace: false,
            initial: None,
            anywhere: false,
            view_point: None,
            source,
            target,
            background: CloudView::of(&[]),
            outward: CloudView::of(&[]),
        }
    }
}

/// The pose found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefineReply {
    /// The request's.
    pub id: u64,
    /// Plain rigid transform as rows of `[R | t]`, in the clouds' units.
    pub target_from_source: [[f32; 4]; 3],
    /// Steps taken.
    pub steps: u8,
    /// What followed them; never [`Mode::Best`].
    pub mode: Mode,
    /// Of a refined pose, whether it is probably right; else how the steps ended, which does not judge the pose.
    pub verdict: Verdict,
    /// Of a refined pose, how probably it is right, up to what [`Fit::axis`], [`Fit::slide`] and [`Fit::others`] leave open.
    pub probability: Option<f32>,
    /// Of a refined pose, how the clouds fit under it.
    pub fit: Option<Fit>,
    /// Time in the robot's queue, microseconds.
    pub waited_micros: u32,
    /// Time the registration took on the robot, microseconds.
    pub micros: u32,
    /// Version of the policy that answered.
    pub policy_version: u64,
}

/// How clouds fit under a refined pose, and what their shape leaves open.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Share of the source's points that lie on the target's surface.
    pub overlap: f32,
    /// Root of the mean squared distance of those from it, in the clouds' units.
    pub inlier_rmse: f32,
    /// Size of the source over that of the target.
    pub extents_ratio: f32,
    /// Points that differ from all others, in the cloud with fewer of them.
    pub distinct_points: u16,
    /// Shares of the source's and of the target's points that were left out, since they lie far from all others.
    pub left_out: [f32; 2],
    /// Share of the target's points behind which the sensor saw something ([`Refined::seen_through`]).
    pub seen_through: f32,
    /// Turned about this axis they fit as well ([`crate::verify::Axis`]): a point on it, its direction, both in the target's frame and
    /// units, and the least and largest turn, radians.
    pub axis: Option<([f32; 3], [f32; 3], [f32; 2])>,
    /// Moved along this direction they fit as well ([`crate::verify::Slide`]): unit vector, and the least and largest shift.
    pub slide: Option<([f32; 3], [f32; 2])>,
    /// Turned about an axis in any direction they do, since the target is a ball.
    pub any_rotation: bool,
    /// Turned by any multiple of a full turn over a number they fit as well ([`crate::verify::Fold`]): a point of the axis, its direction,
    /// and the number.
    pub fold: Option<([f32; 3], [f32; 3], u8)>,
    /// Other poses that fit as well, without those that the fold makes of the given one.
    pub others: u8,
    /// How uncertain the pose is ([`crate::covariance::Covariance`]): the point about which it turns, and the lower triangle
    /// by rows.
    pub covariance: ([f32; 3], [f32; TRIANGLE]),
}

/// Numbers of a symmetric matrix of six rows.
const TRIANGLE: usize = 21;

impl Fit {
    /// What a refinement found.
    pub fn of(found: &Refinement) -> Fit {
        let Refined {
            overlap,
            inlier_rmse,
            extents_ratio,
            distinct_points,
            left_out,
            seen_through,
            ..
        } = found.refined;
        let Undetermined {
            axis,
            slide,
            any_rotation,
            fold,
            poses,
        } = found.undetermined;
        let Covariance { about, matrix, .. } = found.refined.covariance;
        let mut triangle = [0.0; TRIANGLE];
        let lower = matrix
            .iter()
            .zip(1..)
            .flat_map(|(row, count)| row.iter().take(count));
        triangle
            .iter_mut()
            .zip(lower)
            .for_each(|(place, &x)| *place = x);
        Fit {
            overlap,
            inlier_rmse,
            extents_ratio,
            distinct_points: u16::try_from(distinct_points).unwrap_or(u16::MAX),
            left_out,
            seen_through,
            axis: axis.map(|axis| {
                let [point, direction] = [axis.point, axis.direction].map(|v| v.to_array());
                (point, direction, axis.range_rad)
            }),
            slide: slide.map(|slide| (slide.direction.to_array(), slide.range)),
            any_rotation,
            fold: fold.map(|fold| {
                let [point, direction] = [fold.point, fold.direction].map(|v| v.to_array());
                (point, direction, fold.order)
            }),
            others: {
                let each = fold
                    .filter(|fold| fold.of_others)
                    .map_or(1, |fold| fold.order);
                poses.iter().flatten().count() as u8 * each
            },
            covariance: (about.to_array(), triangle),
        }
    }
}

/// Takes a request back: nobody waits for its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cancel {
    /// The request's [`RefineRequest::client`].
    pub client: u64,
    /// The request's [`RefineRequest::id`].
    pub id: u64,
}

impl Cancel {
    /// What takes this request back.
    pub fn of(request: &RefineRequest<'_>) -> Cancel {
        Cancel {
            client: request.client,
            id: request.id,
        }
    }
}

/// Why there is no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// The request's, 0 where none could be read.
    pub id: u64,
    /// What was wrong.
    pub reason: Reason,
}

/// Which cloud of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cloud {
    /// The observed one.
    Source,
    /// The reference.
    Target,
    /// What was seen besides the source.
    Background,
}

/// What is wrong with a request, or why the robot cannot serve it now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reason {
    /// The robot's queue is full.
    Busy,
    /// The robot has no policy yet.
    NoPolicy,
    /// The frame has another version.
    WrongVersion {
        /// Version the robot speaks.
        spoken: u8,
    },
    /// The payload is not a refine request.
    Malformed,
    /// A cloud has no points.
    EmptyCloud(Cloud),
    /// A cloud has fewer points than fix a rigid transform.
    TooFewPoints(Cloud, u32),
    /// A cloud has more points than the robot takes.
    TooManyPoints(Cloud, u32),
    /// The point of this index has a NaN or infinite coordinate.
    NotFinite(Cloud, u32),
    /// All points of a cloud coincide, or nearly.
    BadCloud,
    /// The initial pose is not a finite rigid transform.
    BadPose,
    /// The robot failed in a way that is not the request's fault.
    Internal,
    /// The time that the request gave has passed.
    Deadline,
    /// The robot cannot do what should follow the policy's steps.
    NoSuchMode(Mode),
    /// The policy in the board's flash is cut, damaged or of another format or shape.
    PolicyDamaged,
    /// The policy in the board's flash does something else there than its manifest says.
    FailedSelfTest,
    /// The request was taken back.
    TakenBack,
    /// A coordinate of the view point is NaN, infinite or beyond 1e12.
    BadViewPoint,
}

impl Reason {
    /// The reason for an error met with this cloud in hand.
    pub fn of(error: Error, cloud: Cloud) -> Reason {
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        match error {
            Error::EmptyCloud => Reason::EmptyCloud(cloud),
            Error::TooFewPoints { points } => Reason::TooFewPoints(cloud, count(points)),
            Error::TooManyPoints { points, .. } => Reason::TooManyPoints(cloud, count(points)),
            Error::NotFinite { index } => Reason::NotFinite(cloud, count(index)),
            Error::OutOfRange { index } => Reason::NotFinite(cloud, count(index)),
            Error::NoExtent | Error::TooSmall => Reason::BadCloud,
            Error::BadPose => Reason::BadPose,
            Error::BadViewPoint => Reason::BadViewPoint,
            Error::Frame => Reason::Malformed,
            Error::FrameVersion { .. } => Reason::WrongVersion {
                spoken: super::VERSION,
            },
            _ => Reason::Internal,
        }
    }
}

impl fmt::Display for Cloud {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Cloud::Source => "source",
            Cloud::Target => "target",
            Cloud::Background => "background",
        })
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use crate::dims::{MAX_POINTS, MIN_POINTS};
        match self {
            Reason::Busy => write!(f, "busy: its queue is full; ask another robot or later"),
            Reason::NoPolicy => write!(f, "it has no policy yet; publish one to its fleet"),
            Reason::WrongVersion { spoken } => {
                write!(f, "it speaks frame version {spoken}; update the older side")
            }
            Reason::Malformed => write!(f, "the payload is not a refine request"),
            Reason::EmptyCloud(cloud) => write!(f, "the {cloud} cloud is empty"),
            Reason::TooFewPoints(cloud, points) => {
                let s = if *points == 1 { "" } else { "s" };
                write!(
                    f,
                    "the {cloud} cloud has {points} point{s}, at least {MIN_POINTS} are needed"
                )
            }
            Reason::TooManyPoints(cloud, points) => write!(
                f,
                "the {cloud} cloud has {points} points, more than it has memory for (nobody takes more than {MAX_POINTS}); subsample it"
            ),
            Reason::NotFinite(cloud, index) => write!(
                f,
                "point {index} of the {cloud} cloud has a coordinate that was not measured: NaN, infinite or beyond 1e12; leave such points out"
            ),
            Reason::BadCloud => write!(f, "all points of a cloud coincide, or nearly"),
            Reason::BadPose => write!(
                f,
                "the initial pose is not a rigid transform, or its translation is beyond 1e12; give a rotation without scale, and a translation in the clouds' unit"
            ),
            Reason::BadViewPoint => write!(
                f,
                "the view point has a coordinate that is NaN, infinite or beyond 1e12; give the sensor's place in the source's frame, or none"
            ),
            Reason::Internal => write!(f, "it failed; see its log"),
            Reason::Deadline => write!(
                f,
                "the deadline has passed; give more time or ask a robot with less to do"
            ),
            Reason::PolicyDamaged => write!(
                f,
                "the policy in its flash is damaged or none that it runs; publish it again, in int8"
            ),
            Reason::TakenBack => write!(f, "it was taken back"),
            Reason::FailedSelfTest => write!(
                f,
                "the policy in its flash fails the self-test there; publish another, and test the board's memory"
            ),
            Reason::NoSuchMode(mode) => {
                write!(f, "it has no memory for mode {mode}; ask for fast or best")
            }
        }
    }
}
