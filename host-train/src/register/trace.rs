//! Trace files: registrations step by step, one JSON object a line.
//!
//! A registration begins with a header line, `{"registration": {…}}` ([`Header`]), and goes on with one line a step
//! ([`Step`]) in the order taken. If something followed the steps, it ends with `{"answer": {…}}` ([`FinalAnswer`]), the
//! final pose. A file holds any number of registrations, one after another.

use crate::dataset::Point;
use crate::pose64::Position;
use reagent_core::dims::{AXES, LOGITS, STEP_SIZES};
use reagent_core::pipeline::{Answer, Mode};
use reagent_core::{Frame, Pose, register};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest line that is read: a header with two clouds at the core's capacity has 400 kB.
const LINE_BYTES: usize = 4 << 20;
/// Longest file that is read.
const FILE_BYTES: u64 = 1 << 30;

/// Probabilities of the eleven steps, in the order of the step table, for each of three axes.
pub type Probabilities = [[f32; STEP_SIZES]; AXES];

/// What was registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Name of the pair.
    pub name: String,
    /// Name of the policy.
    pub policy: String,
    /// Observed source, `[N, 3]`, the user's units.
    pub source: Vec<Point>,
    /// Target, `[M, 3]`, the same units.
    pub target: Vec<Point>,
    /// True target_from_source, rows of `[R | t]`, if known.
    pub truth: Option<[[f32; 4]; 3]>,
    /// target_from_source before the first step.
    pub initial: [[f32; 4]; 3],
    /// Points of the user's coordinates, of the source and of the target, that clouds and poses are relative to; `None` if they
    /// are relative to nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origins: Option<[Position; 2]>,
}

/// One step of a registration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Number of the step, from 1.
    pub step: usize,
    /// Step ids of the translation along x, y, z (0 to 10, 5 is stop).
    pub translation_id: [u8; AXES],
    /// Step ids of the rotation about x, y, z.
    pub rotation_id: [u8; AXES],
    /// Signed translation, in the clouds' units.
    pub translation: [f32; AXES],
    /// Signed rotation angles, radians.
    pub rotation_rad: [f32; AXES],
    /// Pose after the step, rows of `[R | t]`, in the clouds' units.
    pub target_from_source: [[f32; 4]; 3],
    /// Probability of each translation step under the policy; `None` in traces of version 0.1.
    #[serde(default)]
    pub translation_probability: Option<Probabilities>,
    /// Probability of each rotation step under the policy.
    #[serde(default)]
    pub rotation_probability: Option<Probabilities>,
}

impl Step {
    /// Step number `step`, from 1, of a registration in `frame`, with the pose that it led to.
    pub fn new(step: usize, taken: &register::Step, frame: Frame, pose: Pose) -> Step {
        let [translation, rotation_rad] = taken.action.signed();
        Step {
            step,
            translation_id: taken.action.translation,
            rotation_id: taken.action.rotation,
            translation: translation.map(|t| t * frame.scale),
            rotation_rad,
            target_from_source: pose.to_rows(),
            translation_probability: Some(probabilities(&taken.logits_t)),
            rotation_probability: Some(probabilities(&taken.logits_r)),
        }
    }
}

/// Softmax over the steps of each axis; `logits [33]`, axis-major.
pub fn probabilities(logits: &[f32; LOGITS]) -> Probabilities {
    let mut of_axes = [[0.0; STEP_SIZES]; AXES];
    let (axes, _) = logits.as_chunks::<STEP_SIZES>();
    for (out, axis) in of_axes.iter_mut().zip(axes) {
        let highest = axis.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        *out = axis.map(|logit| (logit - highest).exp());
        let sum: f32 = out.iter().sum();
        *out = out.map(|p| p / sum);
    }
    of_axes
}

/// The final pose, after refinement and comparison with others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinalAnswer {
    /// Name of the mode, which says what followed the steps.
    pub mode: String,
    /// The verdict in words.
    pub verdict: String,
    /// Probability that the pose is right.
    pub probability: Option<f32>,
    /// Pose, rows of `[R | t]`, in the clouds' units.
    pub target_from_source: [[f32; 4]; 3],
}

impl FinalAnswer {
    /// The answer of a registration; `None` if nothing followed the policy's steps.
    pub fn of(answer: &Answer, mode: Mode) -> Option<FinalAnswer> {
        answer.refinement.is_some().then(|| FinalAnswer {
            mode: mode.resolved().to_string(),
            verdict: answer.verdict.to_string(),
            probability: answer.probability,
            target_from_source: answer.target_from_source.to_rows(),
        })
    }
}

/// A registration with its steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Traced {
    /// What was registered.
    pub header: Header,
    /// The steps taken.
    pub steps: Vec<Step>,
    /// What followed them.
    pub answer: Option<FinalAnswer>,
}

/// The text of a trace file with these registrations.
///
/// # Errors
/// The encoder's.
pub fn to_text(traced: &[Traced]) -> Result<String, serde_json::Error> {
    let mut text = String::new();
    for one in traced {
        text += &serde_json::to_string(&serde_json::json!({"registration": one.header}))?;
        text.push('\n');
        for step in &one.steps {
            text += &serde_json::to_string(step)?;
            text.push('\n');
        }
        if let Some(answer) = &one.answer {
            text += &serde_json::to_string(&serde_json::json!({"answer": answer}))?;
            text.push('\n');
        }
    }
    Ok(text)
}

/// Why a trace file was refused.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The operating system refused to read.
    #[error("cannot read trace {}", path.display())]
    Io {
        /// File concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A line does not belong where it is in a trace.
    #[error("{}, line {line}: {what}; write the trace again with --trace", path.display())]
    Line {
        /// File concerned.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong with it.
        what: String,
    },
    /// The file holds no registration.
    #[error("{}: no registration in the trace; write it again with --trace", path.display())]
    Empty {
        /// File concerned.
        path: PathBuf,
    },
}

/// A line of the file.
#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    Registration { registration: Header },
    Step(Box<Step>),
    Answer { answer: FinalAnswer },
}

/// Reads the first `limit` registrations of a trace file and checks the rest, too. The second value is the number
/// of registrations in the file.
///
/// # Errors
/// See [`TraceError`].
pub fn read(path: &Path, limit: usize) -> Result<(Vec<Traced>, usize), TraceError> {
    let io = |source| TraceError::Io {
        path: path.into(),
        source,
    };
    let mut file = BufReader::new(File::open(path).map_err(io)?.take(FILE_BYTES));
    let (mut kept, mut count) = (Vec::<Traced>::new(), 0);
    // The registration in progress.
    let mut current: Option<Traced> = None;
    let mut bytes = Vec::new();
    for line in 1.. {
        bytes.clear();
        let read = (&mut file)
            .take(LINE_BYTES as u64)
            .read_until(b'\n', &mut bytes)
            .map_err(io)?;
        if read == 0 {
            break;
        }
        let wrong = |what: String| TraceError::Line {
            path: path.into(),
            line,
            what,
        };
        if read == LINE_BYTES {
            return Err(wrong(format!("longer than {LINE_BYTES} bytes")));
        }
        if bytes.trim_ascii().is_empty() {
            continue;
        }
        match parse(&bytes).map_err(wrong)? {
            Line::Registration { registration } => {
                count += 1;
                let begun = Traced {
                    header: registration,
                    steps: Vec::new(),
                    answer: None,
                };
                if let Some(done) = current.replace(begun)
                    && kept.len() < limit
                {
                    kept.push(done);
                }
            }
            Line::Step(step) => {
                let Some(current) = &mut current else {
                    return Err(wrong(
                        "a step before the first registration's header".into(),
                    ));
                };
                let expected = current.steps.len() + 1;
                if current.answer.is_some() {
                    return Err(wrong("a step after the answer".into()));
                }
                if step.step != expected {
                    return Err(wrong(format!(
                        "step {} where step {expected} should be",
                        step.step
                    )));
                }
                current.steps.push(*step);
            }
            Line::Answer { answer } => {
                let free = current.as_mut().map(|current| &mut current.answer);
                let Some(place @ None) = free else {
                    return Err(wrong("an answer where no registration is open".into()));
                };
                *place = Some(answer);
            }
        }
    }
    if let Some(done) = current
        && kept.len() < limit
    {
        kept.push(done);
    }
    if count == 0 {
        return Err(TraceError::Empty { path: path.into() });
    }
    Ok((kept, count))
}

/// Parses and checks a line.
fn parse(bytes: &[u8]) -> Result<Line, String> {
    // `untagged` would say only that no variant fits.
    let value: serde_json::Value =
        serde_json::from_slice(bytes).map_err(|error| format!("not JSON ({error})"))?;
    let line = if value.get("registration").is_some() {
        Line::Registration {
            registration: serde_json::from_value(value["registration"].clone())
                .map_err(|error| format!("not a registration's header ({error})"))?,
        }
    } else if value.get("answer").is_some() {
        Line::Answer {
            answer: serde_json::from_value(value["answer"].clone())
                .map_err(|error| format!("not an answer ({error})"))?,
        }
    } else {
        Line::Step(
            serde_json::from_value(value)
                .map(Box::new)
                .map_err(|error| format!("not a step ({error})"))?,
        )
    };
    match &line {
        Line::Registration { registration } => check_header(registration)?,
        Line::Step(step) => check_step(step)?,
        Line::Answer { answer } => check_answer(answer)?,
    }
    Ok(line)
}

fn check_pose(what: &str, rows: [[f32; 4]; 3]) -> Result<(), String> {
    match Pose::from_rows(rows).checked() {
        Ok(_) => Ok(()),
        Err(_) => Err(format!("{what} is not a finite rigid transform")),
    }
}

fn check_header(header: &Header) -> Result<(), String> {
    for (what, cloud) in [("source", &header.source), ("target", &header.target)] {
        reagent_core::frame::check_cloud(cloud).map_err(|error| format!("{what}: {error}"))?;
    }
    check_pose("initial", header.initial)?;
    header
        .truth
        .map_or(Ok(()), |pose| check_pose("truth", pose))
}

fn check_answer(answer: &FinalAnswer) -> Result<(), String> {
    check_pose("target_from_source", answer.target_from_source)?;
    match answer.probability {
        Some(p) if !(0.0..=1.0).contains(&p) => Err(format!("{p} is not a probability")),
        _ => Ok(()),
    }
}

fn check_step(step: &Step) -> Result<(), String> {
    check_pose("target_from_source", step.target_from_source)?;
    let ids = step.translation_id.iter().chain(&step.rotation_id);
    if let Some(id) = ids.into_iter().find(|&&id| usize::from(id) >= STEP_SIZES) {
        return Err(format!("step id {id} is not below {STEP_SIZES}"));
    }
    let probabilities = step
        .translation_probability
        .iter()
        .chain(&step.rotation_probability);
    for axis in probabilities.flatten() {
        let sum: f32 = axis.iter().sum();
        if !((sum - 1.0).abs() < 1e-2 && axis.iter().all(|p| *p >= 0.0)) {
            return Err(format!("probabilities that sum to {sum}, not 1"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
