//! Asking a robot for a pose.

mod fleet;
mod robots;

pub use fleet::Client;
pub use robots::Heard;

use crate::session::plain;
use reagent_core::Error;
use reagent_core::wire::{
    self, CloudView, Message, RefineReply, RefineRequest, Refusal, Status, keys,
};
use std::time::{Duration, Instant};
use thiserror::Error as ThisError;
use zenoh::Session;
use zenoh::query::ReplyError;
use zenoh::sample::{Sample, SourceInfo};

/// How much longer than a request's own time its client waits, so that the answer can cross the network.
pub const MARGIN: Duration = Duration::from_secs(1);
/// Running robots answer a status query within this time.
const STATUS_TIME: Duration = Duration::from_secs(2);

/// Why there is no pose.
#[derive(Debug, ThisError)]
pub enum RefineError {
    /// The fleet's or robot's name cannot be part of a key expression, or the clouds do not fit a frame.
    #[error("{0}")]
    Request(Error),
    /// Nobody serves this key, or the robot went away before it answered.
    #[error(
        "no robot answered at {key} within {waited:.1?}; is it running, in this fleet and on this network?"
    )]
    NoRobot {
        /// The key asked.
        key: String,
        /// How long.
        waited: Duration,
    },
    /// The robot refused the request.
    #[error("robot {robot} refused request {}: {}", .refusal.id, .refusal.reason)]
    Refused {
        /// Who.
        robot: String,
        /// Why.
        refusal: Refusal,
    },
    /// The answer is not a frame of this protocol, or it answers another request.
    #[error("the answer from {key} cannot be used: {reason}")]
    Answer {
        /// The key asked.
        key: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Neither an answer nor an error came in time.
    #[error(
        "no answer from {key} within {waited:.1?}; give more time, or see whether the robot and its link work"
    )]
    Deadline {
        /// The key asked.
        key: String,
        /// How long.
        waited: Duration,
    },
    /// The session failed.
    #[error("zenoh: {}", plain(.0))]
    Zenoh(#[from] zenoh::Error),
}

/// Sends a request to a robot and waits for its pose. A [`Client`] does the same and can also take the request back.
///
/// # Errors
/// See [`RefineError`]. Every error comes at most [`MARGIN`] after the request's own time.
pub async fn refine(
    session: &Session,
    fleet: &str,
    robot: &str,
    request: &RefineRequest<'_>,
) -> Result<RefineReply, RefineError> {
    refine_from(session, None, fleet, robot, request).await
}

/// As [`refine`], and says whose request it is.
async fn refine_from(
    session: &Session,
    source: Option<SourceInfo>,
    fleet: &str,
    robot: &str,
    request: &RefineRequest<'_>,
) -> Result<RefineReply, RefineError> {
    let key = keys::refine(fleet, robot).map_err(RefineError::Request)?;
    let clouds = [
        request.source,
        request.target,
        request.background,
        request.outward,
    ];
    let points: usize = clouds.iter().map(CloudView::len).sum();
    let mut frame = vec![0; wire::REQUEST_OVERHEAD_BYTES + 12 * points];
    let length = wire::encode(&Message::RefineRequest(*request), &mut frame)
        .map_err(RefineError::Request)?
        .len();
    frame.truncate(length);
    let budget = Duration::from_millis(request.budget_ms.into());
    let reply = ask_from(session, source, &key, robot, frame, budget + MARGIN).await?;
    if reply.id == request.id {
        Ok(reply)
    } else {
        Err(RefineError::Answer {
            key: key.to_string(),
            reason: format!("it is for request {}, not {}", reply.id, request.id),
        })
    }
}

/// Sends a frame to a robot's refine key and reads the answer, whatever the frame is.
///
/// # Errors
/// As [`refine`], after `time` at most.
pub async fn ask(
    session: &Session,
    key: &keys::Key,
    robot: &str,
    frame: Vec<u8>,
    time: Duration,
) -> Result<RefineReply, RefineError> {
    ask_from(session, None, key, robot, frame, time).await
}

async fn ask_from(
    session: &Session,
    source: Option<SourceInfo>,
    key: &keys::Key,
    robot: &str,
    frame: Vec<u8>,
    time: Duration,
) -> Result<RefineReply, RefineError> {
    let late = || RefineError::Deadline {
        key: key.to_string(),
        waited: time,
    };
    let asked = Instant::now();
    let answer = async {
        // A congested link may also delay the request itself.
        let replies = session.get(key.as_str()).payload(frame).timeout(time);
        let replies = replies.source_info(source);
        zenoh::Result::Ok(replies.await?.recv_async().await)
    };
    let answer = tokio::time::timeout(time, answer).await;
    let reply = answer.map_err(|_| late())??;
    let unusable = |reason: String| RefineError::Answer {
        key: key.to_string(),
        reason,
    };
    let Ok(reply) = reply else {
        return Err(RefineError::NoRobot {
            key: key.to_string(),
            waited: asked.elapsed(),
        });
    };
    match reply.result() {
        Ok(sample) => match wire::decode(&sample.payload().to_bytes()) {
            Ok(Message::RefineReply(reply)) => Ok(reply),
            Ok(_) => Err(unusable("it is another kind of frame".into())),
            Err(error) => Err(unusable(error.to_string())),
        },
        Err(refused) => Err(match read_refusal(refused) {
            Ok(refusal) => RefineError::Refused {
                robot: robot.into(),
                refusal,
            },
            // Zenoh's text for a timeout.
            Err(text) if text == "Timeout" => late(),
            Err(text) => unusable(text),
        }),
    }
}

/// The refusal in an error reply, or the reply's text (Zenoh's own errors, such as a timeout).
fn read_refusal(reply: &ReplyError) -> Result<Refusal, String> {
    let payload = reply.payload().to_bytes();
    match wire::decode(&payload) {
        Ok(Message::Refusal(refusal)) => Ok(refusal),
        _ => Err(String::from_utf8_lossy(&payload).into_owned()),
    }
}

/// The name of the robot that sent a status, and the status.
fn read_status(sample: &Sample) -> Option<(&str, Status)> {
    let robot = keys::robot_of(sample.key_expr().as_str())?;
    match wire::decode(&sample.payload().to_bytes()) {
        Ok(Message::Status(status)) => Some((robot, status)),
        _ => None,
    }
}
