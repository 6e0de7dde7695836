//! Manifests, statuses and boards, field by field.

use super::{NotTaken, PolicyId, Release, Tally};
use crate::golden::GoldenActions;
use crate::shape::Shape;
use crate::verdict::VERDICTS;
use crate::weights;
use serde::{Deserialize, Serialize};

/// A policy's name for people.
pub type PolicyName = heapless::String<32>;

/// What a policy file is, and to whom it goes.
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
    /// Epoch of the release: with a greater epoch, versions start anew.
    pub epoch: u32,
    /// Grows with every policy shipped to the fleet; a robot never goes back within an epoch.
    pub version: u64,
    /// Robots whose [`Manifest::draw`] is at most this take the policy; the greatest value reaches all of them.
    pub reach: u32,
    /// Version of the file format, as in its header ([`crate::weights::VERSION`]).
    pub file_version: u16,
    /// Number format of the file, as in its header ([`crate::weights::FORMAT_F32`]).
    pub number_format: u16,
    /// Shape of the network, as in its header ([`crate::shape::Shape`]).
    pub shape: [u16; 8],
    /// A name for people to read.
    pub name: PolicyName,
    /// SHA-256 of the training data, as recorded by the run; zeros if unknown.
    pub training_sha256: [u8; 32],
    /// SHA-256 of the record of its evaluation; zeros if there is none.
    pub evaluation_sha256: [u8; 32],
    /// Its actions on the clouds of the self-test.
    pub golden: GoldenActions,
}

impl Manifest {
    /// Which policy this is.
    pub fn id(&self) -> PolicyId {
        PolicyId {
            epoch: self.epoch,
            version: self.version,
            sha256: self.sha256,
        }
    }

    /// Its place among the policies shipped to the fleet.
    pub fn release(&self) -> Release {
        self.id().release()
    }

    /// A robot's place in the order in which a roll-out in parts reaches the fleet: pseudo-random for each policy, and the same
    /// for everybody who asks.
    pub fn draw(&self, robot: &str) -> u32 {
        let [a, b, c, d, ..] = self.sha256;
        let mut x = weights::checksum(robot.as_bytes()) ^ u32::from_le_bytes([a, b, c, d]);
        // Checksums of names that differ in one digit differ in few bits; MurmurHash3's finaliser mixes them.
        x = (x ^ x >> 16).wrapping_mul(0x85eb_ca6b);
        x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
        x ^ x >> 16
    }

    /// Whether it goes to this robot.
    pub fn reaches(&self, robot: &str) -> bool {
        self.draw(robot) <= self.reach
    }

    /// Whether this build can run the file: format version, number format and network shape.
    pub fn runs_here(&self) -> bool {
        let formats = [weights::FORMAT_F32, weights::FORMAT_INT8];
        self.file_version == weights::VERSION
            && formats.contains(&self.number_format)
            && Shape::from_header(self.shape).is_some()
    }

    /// Number of chunks; `None` for a chunk length that is not allowed.
    pub fn chunks(&self) -> Option<u32> {
        let allowed = (1..=super::CHUNK_BYTES as u32).contains(&self.chunk_length);
        allowed.then(|| self.length.div_ceil(self.chunk_length))
    }
}

/// A manifest with the signature that vouches for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedManifest<'a> {
    /// The whole frame of a [`Manifest`], version byte first: the signed bytes.
    pub manifest: &'a [u8],
    /// ed25519 public key of the signer.
    pub public_key: [u8; 32],
    /// The 64 bytes of the ed25519 signature, in two halves.
    pub signature: [[u8; 32]; 2],
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
    /// Drawn anew at each start of the robot; two instances at once are two robots of one name.
    pub instance: u32,
    /// Poses by verdict, in the order of [`crate::Verdict`].
    pub verdicts: [u32; VERDICTS],
    /// The last policy that was announced but not taken since the one in use was taken.
    pub not_taken: Option<NotTaken>,
    /// What the policy in use has done so far.
    pub tally: Tally,
    /// What it knows to be wrong with itself.
    pub health: Health,
}

/// What a robot knows to be wrong with itself, beside what the rest of its status says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// Its state directory was deleted or replaced, so nothing is kept any more.
    pub state_lost: bool,
    /// A certificate of its session does not hold by its clock, so its next session is refused.
    pub certificate_invalid: bool,
}

impl Health {
    /// In words, each fault.
    pub fn faults(self) -> impl Iterator<Item = &'static str> {
        let faults = [
            (self.state_lost, "its state directory is gone"),
            (
                self.certificate_invalid,
                "a certificate of its session does not hold by its clock",
            ),
        ];
        faults
            .into_iter()
            .filter_map(|(is, what)| is.then_some(what))
    }
}

/// What a board has and uses, in bytes and in ticks of its own counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Board {
    /// Flash taken by the program and its constants, without the policy.
    pub program_bytes: u32,
    /// RAM of everything but the stack: clouds, working memory, serial line.
    pub static_bytes: u32,
    /// Highest use of the stack since the start.
    pub stack_bytes: u32,
    /// RAM reserved for the stack.
    pub stack_capacity: u32,
    /// Most points of each cloud in a request.
    pub points: u32,
    /// Ticks that the last request's target took, checks included.
    pub target_ticks: u32,
    /// Ticks that the last request's steps took.
    pub steps_ticks: u32,
    /// Ticks of the longest slice of work since the start, during which nothing else ran.
    pub slice_ticks: u32,
    /// Ticks a second.
    pub hertz: u32,
    /// The board's check of the policy in its flash.
    pub flash: FlashCheck,
}

/// A board's check of the policy in its flash, at its start and after each update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum FlashCheck {
    /// There is no policy: none was ever written, or an update was interrupted.
    #[default]
    Empty,
    /// It is intact, and did in the self-test what its manifest says.
    Passed,
    /// It is truncated or damaged, or of a format or shape that the board does not run.
    Damaged,
    /// It is intact, but acts differently here from what its manifest says.
    FailedSelfTest,
}

/// A part of the policy file whose manifest came before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Chunk<'a> {
    /// Its number, from 0; chunks come in order.
    pub index: u32,
    /// Its bytes.
    pub bytes: &'a [u8],
}
