//! The bytes that robots and hosts exchange: frames and key expressions, defined once for both ends.
//!
//! A frame is one version byte ([`VERSION`], [`MANIFEST_VERSION`]), one byte that says which [`Message`] follows, and the
//! message's fields in [postcard](https://postcard.jamesmunns.com/wire-format) encoding. The same
//! frames travel as Zenoh payloads and, stuffed with COBS, over a serial line.
//!
//! | second byte | message | where |
//! |---|---|---|
//! | 0 | [`Manifest`] | inside a signed manifest; the signature covers the whole frame |
//! | 1 | [`SignedManifest`] | `…/policy/manifest`, published and answered |
//! | 2 | [`RefineRequest`] | payload of a query to `…/robot/<id>/refine` |
//! | 3 | [`RefineReply`] | its reply |
//! | 4 | [`Refusal`] | its error reply |
//! | 5 | [`Status`] | `…/robot/<id>/status`, published and answered |
//! | 6 | [`Message::Ask`] | serial line: asks how the board is, answered by a status and a [`Board`] |
//! | 7 | [`Board`] | serial line: what the board has and uses |
//! | 8 | [`StepTaken`] | serial line: after each step, before the reply |
//! | 9 | [`Chunk`] | serial line: a part of the policy whose manifest came before, answered by a status |
//! | 10 | [`Trace`] | `…/robot/<id>/trace`, published after an answer whose request wants it |
//! | 11 | [`Cancel`] | `…/robot/<id>/cancel`, published by a client that no longer waits |
//!
//! | version | requests have since | replies have since |
//! |---|---|---|
//! | 3 | time budgets, modes, clients, clouds on a grid ([`crate::grid`]) | the fields that go with them, also in the status |
//! | 4 | view points, starts from anywhere | how the clouds fit, what their shape leaves undetermined |
//! | 5 | | the pose's covariance |
//! | 6 | | shares of the points that were left out |
//! | 7 | what was seen besides the source | |
//! | 8 | | the direction along which the translation is undetermined |
//! | 9 | | how far the turn is open in either sense |
//! | 10 | | balls, and symmetries of shapes with several equal parts |
//! | 11 | which way the target's surface faces | through how much of the target the sensor looked |
//! | 12 | | in the status: what is wrong with the robot |
//!
//! Manifests are stored under their signature and have a version of their own; its version 4 brought the epoch.
//!
//! The signature itself is checked by whoever holds the keys, not here.

mod cloud;
mod frames;
mod in_place;
pub mod keys;
mod refine;
mod release;
pub mod serial;
mod trace;

pub use cloud::CloudView;
pub use frames::{Board, Chunk, FlashCheck, Health, Manifest, PolicyName, SignedManifest, Status};
pub use in_place::{RequestInPlace, decode_in_place, refuse_beginning};
pub use refine::{
    BUDGET_MS, Cancel, Cloud, Fit, Mode, Reason, RefineReply, RefineRequest, Refusal,
};
pub use release::{NotTaken, PolicyId, Release, Tally, WhyNot};
pub use trace::{KernelName, STEP_BYTES, StepTaken, StepsView, Trace, step_bytes};

use crate::dims::MAX_POINTS;
use crate::error::Error;
use serde::{Deserialize, Serialize};

/// Version of the frames: the first byte of each frame but a manifest.
pub const VERSION: u8 = 12;
/// Version of manifests, signed or not: the first byte of each. Robots keep manifests when they themselves are updated.
pub const MANIFEST_VERSION: u8 = 4;
/// Most bytes in one [`Chunk`] of a policy file.
pub const CHUNK_BYTES: usize = 32 * 1024;
/// Most bytes of any frame but a refine request, a chunk and a trace.
pub const SMALL_FRAME_BYTES: usize = 512;
/// Most bytes of a refine request besides the points: version, kind, numbers, pose, grids, lengths.
pub const REQUEST_OVERHEAD_BYTES: usize = 160;
/// Bytes before the policy file in a board's flash: length of the
/// manifest's frame (u32, little-endian), the frame, then unused bytes.
pub const FLASH_HEADER_BYTES: usize = 512;
/// Most bytes of a refine request that a robot can serve.
pub const REQUEST_BYTES: usize = REQUEST_OVERHEAD_BYTES + 4 * MAX_POINTS * cloud::POINT_BYTES;

/// The content of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message<'a> {
    /// What a policy file is; signed as these bytes.
    Manifest(Manifest),
    /// A manifest with its signature.
    #[serde(borrow)]
    SignedManifest(SignedManifest<'a>),
    /// Two clouds to register.
    RefineRequest(RefineRequest<'a>),
    /// The pose found.
    RefineReply(RefineReply),
    /// Why there is no pose.
    Refusal(Refusal),
    /// How a robot is doing.
    Status(Status),
    /// Asks how the board is.
    Ask,
    /// What a board has and uses.
    Board(Board),
    /// A step that a registration has taken.
    StepTaken(StepTaken),
    /// A part of a policy file.
    Chunk(Chunk<'a>),
    /// What a registration did.
    Trace(Trace<'a>),
    /// Nobody waits for the answer any more.
    Cancel(Cancel),
}

/// Writes a frame to the front of `buffer` and returns it.
///
/// [`Error::FrameBuffer`] if it does not fit. [`SMALL_FRAME_BYTES`] hold every message except: a request, which takes
/// [`REQUEST_OVERHEAD_BYTES`] and 12 bytes a point (6 on a grid); a chunk; and a trace, which takes [`SMALL_FRAME_BYTES`], its
/// request and [`STEP_BYTES`] a step.
pub fn encode<'b>(message: &Message<'_>, buffer: &'b mut [u8]) -> Result<&'b [u8], Error> {
    let [version, body @ ..] = &mut *buffer else {
        return Err(Error::FrameBuffer);
    };
    *version = match message {
        Message::Manifest(_) | Message::SignedManifest(_) => MANIFEST_VERSION,
        _ => VERSION,
    };
    let length = postcard::to_slice(message, body)
        .map_err(|_| Error::FrameBuffer)?
        .len();
    buffer.get(..=length).ok_or(Error::FrameBuffer)
}

/// Decodes `bytes` as one frame; clouds and signed bytes are borrowed from it.
///
/// # Errors
/// [`Error::FrameVersion`] for another version, [`Error::Frame`] for anything else that is not
/// exactly one frame.
pub fn decode(bytes: &[u8]) -> Result<Message<'_>, Error> {
    let (&found, body) = bytes.split_first().ok_or(Error::Frame)?;
    let version = match body {
        [0 | 1, ..] => MANIFEST_VERSION,
        _ => VERSION,
    };
    if found != version {
        return Err(Error::FrameVersion {
            found,
            expected: version,
        });
    }
    match postcard::take_from_bytes(body) {
        Ok((message, [])) => Ok(message),
        _ => Err(Error::Frame),
    }
}

#[cfg(test)]
mod tests;
