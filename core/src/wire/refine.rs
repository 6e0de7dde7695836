//! Asking for a pose, and what comes back, field by field.

use super::CloudView;
use crate::error::Error;
use crate::verdict::Verdict;
use core::fmt;
use serde::{Deserialize, Serialize};

/// What follows the policy's steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Nothing: the policy alone.
    Fast,
    /// A few robust steps of closest points.
    Polish,
    /// The same, and comparison with other poses where the clouds do not fit.
    Verify,
    /// The last of these that the robot can do; the reply says which it was.
    #[default]
    Best,
}

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
    /// The observed cloud, any units.
    #[serde(borrow)]
    pub source: CloudView<'a>,
    /// The model or reference cloud, same units.
    #[serde(borrow)]
    pub target: CloudView<'a>,
}

/// Time that a request has unless it says otherwise, milliseconds.
pub const BUDGET_MS: u32 = 10_000;

impl<'a> RefineRequest<'a> {
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
            source,
            target,
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
    /// How they ended; of a refined pose, whether it is probably right.
    pub verdict: Verdict,
    /// Of a refined pose, how probably it is right.
    pub probability: Option<f32>,
    /// Time in the robot's queue, microseconds.
    pub waited_micros: u32,
    /// Time the registration took on the robot, microseconds.
    pub micros: u32,
    /// Version of the policy that answered.
    pub policy_version: u64,
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
    /// All points of the target coincide.
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
            Error::NoExtent => Reason::BadCloud,
            Error::BadPose => Reason::BadPose,
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
        })
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Mode::Fast => "fast",
            Mode::Polish => "polish",
            Mode::Verify => "verify",
            Mode::Best => "best",
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
            Reason::TooFewPoints(cloud, points) => write!(
                f,
                "the {cloud} cloud has {points} point(s), at least {MIN_POINTS} are needed"
            ),
            Reason::TooManyPoints(cloud, points) => write!(
                f,
                "the {cloud} cloud has {points} points, more than it has memory for (nobody takes more than {MAX_POINTS}); subsample it"
            ),
            Reason::NotFinite(cloud, index) => write!(
                f,
                "point {index} of the {cloud} cloud has a NaN or infinite coordinate"
            ),
            Reason::BadCloud => write!(f, "all points of the target cloud coincide"),
            Reason::BadPose => write!(f, "the initial pose is not a finite rigid transform"),
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
