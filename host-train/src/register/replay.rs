//! Replays what a robot did, and says where the result differs.
//!
//! A trace file holds [`Message::Trace`] frames one after another, as they go over a serial line
//! ([`reagent_core::wire::serial`]).

use crate::policy::WeightFile;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::pipeline::{self, Progress, Task};
use reagent_core::polish::Workspace;
use reagent_core::wire::serial::{CHECK_BYTES, Decoder, Line};
use reagent_core::wire::{
    self, Fit, Message, Mode, REQUEST_BYTES, RefineReply, RefineRequest, SMALL_FRAME_BYTES,
    STEP_BYTES, Trace,
};
use reagent_core::{Error, Registrar};
use std::fmt;
use std::path::PathBuf;
use thiserror::Error as ThisError;

/// Longest frame of a trace.
const TRACE_BYTES: usize =
    SMALL_FRAME_BYTES + REQUEST_BYTES + u8::MAX as usize * STEP_BYTES + CHECK_BYTES;

/// Why a trace cannot be replayed.
#[derive(Debug, ThisError)]
pub enum ReplayError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file holds something else.
    #[error("trace {number}: {what}; record it again with `firmware-sim refine --trace`")]
    Damaged {
        /// Its number in the file, from 1.
        number: usize,
        /// What is wrong with it.
        what: String,
    },
    /// None of the policies given is the one that the robot had.
    #[error(
        "trace {number} is of policy version {version}, SHA-256 {sha256}; give its file with --weights"
    )]
    Policy {
        /// Its number in the file, from 1.
        number: usize,
        /// Version in the robot's manifest.
        version: u64,
        /// Hash of the policy file, hexadecimal.
        sha256: String,
    },
    /// The core refuses the request that the robot answered.
    #[error("trace {number}: {error}")]
    Refused {
        /// Its number in the file, from 1.
        number: usize,
        /// Why.
        error: Error,
    },
}

/// A registration that was replayed.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// The request's id.
    pub id: u64,
    /// Version of the policy, from the robot's manifest.
    pub policy_version: u64,
    /// Steps that the robot took.
    pub steps: usize,
    /// What followed them.
    pub mode: Mode,
    /// Names of the kernels, the robot's and those of the replay.
    pub kernels: [String; 2],
    /// The first difference; `None` if every bit is the same.
    pub difference: Option<Difference>,
}

/// The first difference between a robot's registration and its replay.
#[derive(Clone, Debug, PartialEq)]
pub enum Difference {
    /// A step.
    Step {
        /// Its number, from 1.
        number: usize,
        /// Action and pose, the robot's and those of the replay.
        robot_and_here: [String; 2],
    },
    /// The number of steps.
    Steps {
        /// Steps that the robot took.
        robot: usize,
        /// Steps that the replay took.
        here: usize,
    },
    /// The answer, after equal steps.
    Answer {
        /// The robot's answer, and that of the replay.
        robot_and_here: [String; 2],
    },
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Difference::Step {
                number,
                robot_and_here: [robot, here],
            } => write!(f, "step {number}: robot {robot}; here {here}"),
            Difference::Steps { robot, here } => {
                write!(f, "the robot took {robot} steps; here it were {here}")
            }
            Difference::Answer {
                robot_and_here: [robot, here],
            } => write!(f, "answer: robot {robot}; here {here}"),
        }
    }
}

/// Replays every trace in a file's `bytes`, each with the one of `policies` that the robot had.
///
/// # Errors
/// See [`ReplayError`]; the first one that occurs.
pub fn replay(bytes: &[u8], policies: &[WeightFile]) -> Result<Vec<Replayed>, ReplayError> {
    let mut decoder = Decoder::new();
    let mut space = vec![0; TRACE_BYTES];
    let mut replayed = Vec::new();
    let damaged = |number, what: &str| ReplayError::Damaged {
        number,
        what: what.into(),
    };
    for &byte in bytes {
        let number = replayed.len() + 1;
        let length = match decoder.push(byte, &mut space) {
            None => continue,
            Some(Line::Frame(length)) => length,
            Some(_) => {
                return Err(damaged(
                    number,
                    "the check sum is wrong or the frame too long",
                ));
            }
        };
        let Ok(Message::Trace(trace)) = wire::decode(&space[..length]) else {
            return Err(damaged(number, "not a trace of this version"));
        };
        let Ok(Message::RefineRequest(request)) = wire::decode(trace.request) else {
            return Err(damaged(number, "it holds no request"));
        };
        let sha256 = trace.policy.sha256;
        let policy = policies.iter().find(|policy| policy.sha256() == sha256);
        let policy = policy.ok_or_else(|| ReplayError::Policy {
            number,
            version: trace.policy.version,
            sha256: const_hex::encode(sha256),
        })?;
        let again = once_more(&trace, &request, policy);
        replayed.push(again.map_err(|error| ReplayError::Refused { number, error })?);
    }
    if !decoder.is_idle() {
        return Err(damaged(replayed.len() + 1, "it is cut short"));
    }
    if replayed.is_empty() {
        return Err(damaged(1, "there is none"));
    }
    Ok(replayed)
}

fn once_more(
    trace: &Trace<'_>,
    request: &RefineRequest<'_>,
    policy: &WeightFile,
) -> Result<Replayed, Error> {
    let isa = Isa::named(&trace.kernels).unwrap_or_else(Isa::best);
    let source: Vec<_> = request.source.iter().collect();
    let target: Vec<_> = request.target.iter().collect();
    let [background, outward]: [Vec<_>; 2] =
        [request.background, request.outward].map(|cloud| cloud.iter().collect());
    let mut scratch = Box::new(Scratch::new());
    let mut workspace = Box::new(Workspace::with_isa(isa));
    let mut registrar = Registrar::with_isa(isa, policy.policy(), &mut scratch);
    let mut replayed = Replayed {
        id: trace.reply.id,
        policy_version: trace.policy.version,
        steps: trace.steps.iter().len(),
        mode: trace.reply.mode,
        kernels: [trace.kernels.as_str(), isa.name()].map(str::to_owned),
        difference: None,
    };
    let task = Task {
        mode: trace.reply.mode,
        ..request.task(&background, &outward)
    };
    let mut on_robot = trace.steps.iter();
    let mut difference = None;
    let compare = |progress: Progress<'_, '_>| {
        if let Progress::Step(taken, registration) = progress {
            let rows = registration.target_from_source().to_rows();
            if let Some((robot_action, robot_rows)) = on_robot.next()
                && difference.is_none()
                && (taken.action != robot_action || bits(rows) != bits(robot_rows))
            {
                let step = |action, rows| format!("{action:?} to {rows:?}");
                difference = Some(Difference::Step {
                    number: registration.steps(),
                    robot_and_here: [step(robot_action, robot_rows), step(taken.action, rows)],
                });
            }
        }
        Ok::<(), Error>(())
    };
    let clouds = [&source[..], &target[..]];
    let answer = pipeline::register(&mut registrar, &mut workspace, clouds, &task, compare)?;
    let here = answer.policy.map_or(0, |policy| policy.steps);
    replayed.difference = difference.or((here != replayed.steps).then_some(Difference::Steps {
        robot: replayed.steps,
        here,
    }));
    if replayed.difference.is_some() {
        return Ok(replayed);
    }
    let reply = RefineReply {
        target_from_source: answer.target_from_source.to_rows(),
        steps: u8::try_from(here).unwrap_or(u8::MAX),
        verdict: answer.verdict,
        probability: answer.probability,
        fit: answer.refinement.as_ref().map(Fit::of),
        ..trace.reply
    };
    let content = |reply: &RefineReply| {
        let probability = reply.probability.map(f32::to_bits);
        (
            bits(reply.target_from_source),
            reply.steps,
            reply.verdict,
            probability,
            reply.fit,
        )
    };
    if content(&reply) != content(&trace.reply) {
        let text = |reply: &RefineReply| {
            let (pose, probability) = (reply.target_from_source, reply.probability);
            format!("{} ({probability:?}) at {pose:?}", reply.verdict)
        };
        replayed.difference = Some(Difference::Answer {
            robot_and_here: [text(&trace.reply), text(&reply)],
        });
    }
    Ok(replayed)
}

fn bits(rows: [[f32; 4]; 3]) -> [[u32; 4]; 3] {
    rows.map(|row| row.map(f32::to_bits))
}
