//! The messages, field by field.

use super::CloudView;
use crate::error::Error;
use crate::golden::GoldenActions;
use crate::shape::Shape;
use crate::steps::Action;
use crate::verdict::Verdict;
use crate::weights;
use core::fmt;
use serde::{Deserialize, Serialize};

/// A policy's name for people.
pub type PolicyName = heapless::String<32>;

/// What a policy file is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// SHA-256 of the whole file.
    pub sha256: [u8; 32],
    /// Bytes of the file.
    pub length: u32,
    /// Bytes of every chunk but the last; 1 to [`super::CHUNK_BYTES`].
    pub chunk_length: u32,
    /// SHA-256 of the table of chunks: the SHA-256 of each chunk, one after the other.
    pub table_sha256: [u8; 32],
    /// Grows with every policy shipped to the fleet; a robot never goes back.
    pub version: u64,
    /// Version of the file format, as its header says ([`crate::weights::VERSION`]).
    pub file_version: u16,
    /// How the file stores numbers, as its header says ([`crate::weights::FORMAT_F32`]).
    pub number_format: u16,
    /// Shape of the network, as its header says ([`crate::shape::Shape`]).
    pub shape: [u16; 8],
    /// A name for people.
    pub name: PolicyName,
    /// SHA-256 of what it was trained on, as the run's record says; zeros where that is not known.
    pub training_sha256: [u8; 32],
    /// SHA-256 of the record of its evaluation; zeros where there is none.
    pub evaluation_sha256: [u8; 32],
    /// What it does on the clouds of the self-test.
    pub golden: GoldenActions,
}

impl Manifest {
    /// Whether this build can run such a file: format version, number format and network shape.
    pub fn runs_here(&self) -> bool {
        let formats = [weights::FORMAT_F32, weights::FORMAT_INT8];
        self.file_version == weights::VERSION
            && formats.contains(&self.number_format)
            && Shape::from_header(self.shape).is_some()
    }

    /// Number of chunks, and `None` for a chunk length that is not allowed.
    pub fn chunks(&self) -> Option<u32> {
        let allowed = (1..=super::CHUNK_BYTES as u32).contains(&self.chunk_length);
        allowed.then(|| self.length.div_ceil(self.chunk_length))
    }
}

/// A manifest and who vouches for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedManifest<'a> {
    /// The whole frame of a [`Manifest`], version byte first; what is signed.
    pub manifest: &'a [u8],
    /// ed25519 public key of the signer.
    pub public_key: [u8; 32],
    /// The 64 bytes of the ed25519 signature, in two halves.
    pub signature: [[u8; 32]; 2],
}

/// Two clouds to register.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefineRequest<'a> {
    /// Chosen by the client, returned with the answer.
    pub id: u64,
    /// Most steps to take, 10 in the paper; a stop on every axis ends earlier.
    pub max_steps: u8,
    /// Estimate of target_from_source as rows of `[R | t]`, in the clouds' units; none: identity.
    pub initial: Option<[[f32; 4]; 3]>,
    /// The observed cloud, any units.
    #[serde(borrow)]
    pub source: CloudView<'a>,
    /// The model or reference cloud, same units.
    #[serde(borrow)]
    pub target: CloudView<'a>,
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
    /// How they ended.
    pub verdict: Verdict,
    /// Time the registration took on the robot, microseconds.
    pub micros: u32,
    /// Version of the policy that answered.
    pub policy_version: u64,
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

/// Which policy a robot runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicyId {
    /// The manifest's version.
    pub version: u64,
    /// SHA-256 of the policy file.
    pub sha256: [u8; 32],
}

/// How a robot is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// The policy in use, if there is one.
    pub policy: Option<PolicyId>,
    /// Requests answered with a pose since the start.
    pub served: u64,
    /// Requests refused since the start.
    pub refused: u64,
    /// Requests running or waiting now.
    pub in_hand: u16,
}

/// What a board has and uses; bytes, and ticks of its own counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Board {
    /// Program and its constants in flash, without the policy.
    pub program_bytes: u32,
    /// RAM of everything that is not the stack: clouds, working memory, serial line.
    pub static_bytes: u32,
    /// RAM that the stack has reached at its highest since the start.
    pub stack_bytes: u32,
    /// RAM left for the stack.
    pub stack_capacity: u32,
    /// Most points of each cloud in a request.
    pub points: u32,
    /// Ticks that the last request's target took, checks included.
    pub target_ticks: u32,
    /// Ticks that its last step took.
    pub step_ticks: u32,
    /// Ticks a second.
    pub hertz: u32,
}

/// A step that a registration has taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepTaken {
    /// The request's.
    pub id: u64,
    /// The action.
    pub action: Action,
    /// The pose after it, as rows of `[R | t]`, in the clouds' units.
    pub target_from_source: [[f32; 4]; 3],
}

/// A part of the policy file whose manifest came before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Chunk<'a> {
    /// Its number, from 0; parts come in order.
    pub index: u32,
    /// Its bytes.
    pub bytes: &'a [u8],
}

impl fmt::Display for Cloud {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Cloud::Source => "source",
            Cloud::Target => "target",
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
                "the {cloud} cloud has {points} points, at most {MAX_POINTS} fit; subsample it"
            ),
            Reason::NotFinite(cloud, index) => write!(
                f,
                "point {index} of the {cloud} cloud has a NaN or infinite coordinate"
            ),
            Reason::BadCloud => write!(f, "all points of the target cloud coincide"),
            Reason::BadPose => write!(f, "the initial pose is not a finite rigid transform"),
            Reason::Internal => write!(f, "it failed; see its log"),
        }
    }
}
