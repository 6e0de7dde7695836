//! A whole registration: the policy's steps, refinement, comparison with other poses, verdict. Every front end calls it: what
//! a robot did can be done again elsewhere to the bit.

use crate::cloud::LARGEST_COORDINATE;
use crate::error::Error;
use crate::evidence::Evidence;
use crate::frame::Frame;
use crate::model::Model;
use crate::polish::{Refined, Refiner, Workspace};
use crate::pose::Pose;
use crate::register::{Outcome, Registrar, Registration, Step};
use crate::start::Start;
use crate::verdict::Verdict;
use crate::verify::{RANKED, Ranked, Undetermined};
use core::fmt;
use core::str::FromStr;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// What is done with the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// The policy's steps alone, as the paper has it.
    Fast,
    /// The policy's steps, then a few robust steps of closest points.
    Polish,
    /// The same, compared with other poses.
    Verify,
    /// The last of these that the machine has memory for.
    #[default]
    Best,
    /// A few robust steps of closest points from the start, without the policy: for tracking.
    Refine,
}

impl Mode {
    /// All of them, in the order in which they take more time.
    pub const ALL: [Mode; 5] = [
        Mode::Refine,
        Mode::Fast,
        Mode::Polish,
        Mode::Verify,
        Mode::Best,
    ];

    /// As command lines and JSON name it.
    pub const fn name(self) -> &'static str {
        match self {
            Mode::Fast => "fast",
            Mode::Polish => "polish",
            Mode::Verify => "verify",
            Mode::Best => "best",
            Mode::Refine => "refine",
        }
    }

    /// Whether the policy takes steps.
    pub fn has_steps(self) -> bool {
        self != Mode::Refine
    }

    /// What [`Mode::Best`] stands for where there is memory for everything.
    pub fn resolved(self) -> Mode {
        if self == Mode::Best {
            Mode::Verify
        } else {
            self
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What to do with two clouds.
#[derive(Clone, Copy, Debug)]
pub struct Task<'b> {
    /// What is done.
    pub mode: Mode,
    /// Where it starts.
    pub start: Start,
    /// The policy's steps at most; where there are none, the policy is left out.
    pub steps: usize,
    /// In which frame the policy sees the clouds; the target's own, unless they are normalised already.
    pub frame: Option<Frame>,
    /// Where the sensor stood, in the source's units, if the source is a view from one point.
    pub view_point: Option<Vec3>,
    /// What it saw besides the source, in its frame and units ([`Refiner::seen_before`]); nothing without a view point.
    pub background: &'b [[f32; 3]],
    /// Which way the target's surface faces at its points, in their order ([`Refiner::faces`]), as a mesh tells; nothing without a
    /// view point.
    pub outward: &'b [[f32; 3]],
    /// The target, made ready before ([`Workspace::prepare`]); one of another target is left aside.
    pub model: Option<&'b Model>,
}

impl<'b> Task<'b> {
    /// The best pose within the paper's ten steps.
    pub const fn new(start: Start) -> Task<'b> {
        Task {
            mode: Mode::Best,
            start,
            steps: crate::dims::STEPS,
            frame: None,
            view_point: None,
            background: &[],
            outward: &[],
            model: None,
        }
    }

    /// Says to a refiner what the sensor tells.
    pub fn look(&self, refiner: &mut Refiner<'_>) {
        if let Some(view_point) = self.view_point {
            refiner.seen_before(view_point, self.background);
            refiner.faces(self.outward);
        }
    }

    /// Refuses a view point out of range, and an uncertainty that is negative or NaN.
    fn check(&self) -> Result<(), Error> {
        let near = |x: f32| x.abs() <= LARGEST_COORDINATE;
        let seen_from = self.view_point.map_or([0.0; 3], |point| point.to_array());
        if !seen_from.into_iter().all(near) {
            return Err(Error::BadViewPoint);
        }
        match self.start {
            Start::Pose(_, uncertainty) if !uncertainty.is_sound() => Err(Error::BadUncertainty),
            _ => Ok(()),
        }
    }
}

/// What happened, while it goes on.
#[derive(Debug)]
pub enum Progress<'p, 'c> {
    /// The policy took a step; the registration is where it led.
    Step(&'p Step, &'p Registration<'c>),
    /// Another piece of work begins: a step, or a hypothesis.
    Next,
}

/// The pose, and what can be said about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Rigid transform in the clouds' units.
    pub target_from_source: Pose,
    /// Of a refined pose by its probability, else how the policy's steps ended.
    pub verdict: Verdict,
    /// Of a refined pose: that it is right, up to what is undetermined.
    pub probability: Option<f32>,
    /// How the policy's steps ended, unless it was left out.
    pub policy: Option<Outcome>,
    /// What followed, unless nothing did.
    pub refinement: Option<Refinement>,
}

impl Answer {
    /// Of a refined pose, which something may have led to.
    ///
    /// # Errors
    /// [`Error::BadPose`] for one that is not rigid.
    pub fn refined(found: Refinement, policy: Option<Outcome>) -> Result<Answer, Error> {
        Ok(Answer {
            target_from_source: found.refined.target_from_source.checked()?,
            verdict: Verdict::of_evidence(&found.evidence),
            probability: Some(found.evidence.probability()),
            policy,
            refinement: Some(found),
        })
    }
}

/// What followed the policy's steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// The pose given out, and how the clouds fit under it.
    pub refined: Refined,
    /// The policy's pose, polished.
    pub polished: Refined,
    /// Other poses that were tried, if the mode tries any.
    pub hypotheses: Option<usize>,
    /// What the shape leaves open, as far as it was looked for.
    pub undetermined: Undetermined,
    /// What speaks for the pose and against it.
    pub evidence: Evidence,
    /// The poses that were compared, the most probable first; none where there was no comparison.
    pub ranked: [Option<Ranked>; RANKED],
}

/// Registers `source [N, 3]` to `target [M, 3]`, both in one unit. `progress` is asked before every piece of work whether to go
/// on, and told every step.
///
/// # Errors
/// Clouds or a start that are refused ([`Error`]), and whatever `progress` returns.
pub fn register<'c, E: From<Error>>(
    registrar: &mut Registrar<'_, '_>,
    workspace: &mut Workspace,
    [source, target]: [&'c [[f32; 3]]; 2],
    task: &Task<'_>,
    mut progress: impl FnMut(Progress<'_, 'c>) -> Result<(), E>,
) -> Result<Answer, E> {
    let start = task.start.pose();
    task.check()?;
    let frame = task
        .frame
        .map_or_else(|| Frame::of(target), Frame::checked)?;
    let mut registration = Registration::new();
    let has_steps = task.mode.has_steps() && task.steps > 0;
    if has_steps {
        registrar.start_in(&mut registration, source, target, frame, start)?;
        while registration.steps() < task.steps && !registration.is_settled() {
            progress(Progress::Next)?;
            let step = registrar.step(&mut registration)?; // equations 1 to 4, 8 and 9
            progress(Progress::Step(&step, &registration))?;
        }
    }
    let policy = has_steps.then(|| registration.outcome());
    let reached = policy.map_or(start, |policy| policy.target_from_source);
    let go_on = || progress(Progress::Next);
    let refinement = refine(workspace, [source, target], reached, task, go_on)?;
    if let Some(found) = refinement {
        return Ok(Answer::refined(found, policy)?);
    }
    Ok(Answer {
        target_from_source: reached.checked()?,
        verdict: policy.map_or(Verdict::StepLimit, |policy| policy.verdict),
        probability: None,
        policy,
        refinement: None,
    })
}

/// What the mode does with a pose that was reached.
///
/// # Errors
/// As [`register`].
pub fn refine<E: From<Error>>(
    workspace: &mut Workspace,
    [source, target]: [&[[f32; 3]]; 2],
    reached: Pose,
    task: &Task<'_>,
    mut go_on: impl FnMut() -> Result<(), E>,
) -> Result<Option<Refinement>, E> {
    task.check()?;
    let mode = task.mode.resolved();
    if mode == Mode::Fast {
        return Ok(None);
    }
    go_on()?;
    let mut refiner = match task.model {
        Some(model) if model.is_of(target) => Refiner::on(model, source, workspace)?,
        _ => Refiner::new(source, target, workspace)?,
    };
    task.look(&mut refiner);
    Ok(Some(if mode == Mode::Verify {
        let found = refiner.verify_while(reached, &task.start, go_on)?;
        Refinement {
            refined: Refined {
                covariance: found.undetermined.taken_into(found.best.covariance),
                ..found.best
            },
            polished: found.polished,
            hypotheses: Some(found.hypotheses),
            undetermined: found.undetermined,
            evidence: Evidence::verified(&found),
            ranked: found.ranked,
        }
    } else {
        let polished = refiner.polish(reached)?;
        Refinement {
            refined: polished,
            polished,
            hypotheses: None,
            undetermined: Undetermined::NOTHING,
            evidence: Evidence::polished(&polished),
            ranked: [None; RANKED],
        }
    }))
}

/// A name that is no [`Mode`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnknownMode;

impl fmt::Display for UnknownMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, between @ .., last] = Mode::ALL;
        write!(f, "not a mode: {first}")?;
        for mode in between {
            write!(f, ", {mode}")?;
        }
        write!(f, " or {last}")
    }
}

impl core::error::Error for UnknownMode {}

impl FromStr for Mode {
    type Err = UnknownMode;

    fn from_str(name: &str) -> Result<Mode, UnknownMode> {
        let mut all = Mode::ALL.into_iter();
        all.find(|mode| mode.name() == name).ok_or(UnknownMode)
    }
}
