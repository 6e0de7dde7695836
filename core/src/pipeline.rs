//! A whole registration: the policy's steps, refinement, comparison with other poses, verdict. Every front end calls it, so
//! what a robot did can be repeated elsewhere to the bit.

use crate::cloud::LARGEST_COORDINATE;
use crate::error::Error;
use crate::evidence::Evidence;
pub use crate::facing::INSIDE;
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

/// How much work a registration does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// The policy's steps alone, as the paper has it.
    Fast,
    /// The policy's steps, then a few robust steps of closest points.
    Polish,
    /// As `Polish`, then a comparison with other poses.
    Verify,
    /// The most thorough of the above that the machine has memory for.
    #[default]
    Best,
    /// A few robust steps of closest points from the start, without the policy; for tracking.
    Refine,
}

impl Mode {
    /// All modes, from the fastest to the slowest.
    pub const ALL: [Mode; 5] = [
        Mode::Refine,
        Mode::Fast,
        Mode::Polish,
        Mode::Verify,
        Mode::Best,
    ];

    /// The name on command lines and in JSON.
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

    /// The mode that [`Mode::Best`] stands for where there is memory for everything.
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
    /// How much work to do.
    pub mode: Mode,
    /// Where to start.
    pub start: Start,
    /// Most steps of the policy; 0 leaves the policy out.
    pub steps: usize,
    /// Frame in which the policy sees the clouds; `None` for the target's own. Normalised clouds take [`Frame::IDENTITY`].
    pub frame: Option<Frame>,
    /// Where the sensor stood, in the source's frame and units, if the source is a view from one point.
    pub view_point: Option<Vec3>,
    /// What else the sensor saw, in the source's frame and units ([`Refiner::set_sensor`]); ignored without a view point.
    pub background: &'b [[f32; 3]],
    /// Outward normals of the target's points, in their order, as a mesh gives them, or [`INSIDE`] ([`Refiner::set_outward`]); ignored
    /// without a view point.
    pub outward: &'b [[f32; 3]],
    /// The target, prepared beforehand ([`Workspace::prepare`]); a model of another target is ignored.
    pub model: Option<&'b Model>,
}

impl<'b> Task<'b> {
    /// A task in mode [`Mode::Best`] with the paper's ten steps.
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

    /// Passes on to a refiner what the sensor tells.
    pub fn tell_sensor(&self, refiner: &mut Refiner<'_>) {
        if let Some(view_point) = self.view_point {
            refiner.set_sensor(view_point, self.background);
            refiner.set_outward(self.outward);
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

/// What a registration reports while it runs.
#[derive(Debug)]
pub enum Progress<'p, 'c> {
    /// The policy took a step; the registration is at the pose that it led to.
    Step(&'p Step, &'p Registration<'c>),
    /// Another piece of work is about to begin: a step, or a hypothesis.
    Next,
}

/// The pose, and what is known about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Rigid transform in the clouds' units.
    pub target_from_source: Pose,
    /// From the probability if the pose was refined, else from how the policy's steps ended.
    pub verdict: Verdict,
    /// Probability that a refined pose is right, up to what is undetermined; `None` without refinement.
    pub probability: Option<f32>,
    /// How the policy's steps ended; `None` if the policy was left out.
    pub policy: Option<Outcome>,
    /// The refinement, if the mode has one.
    pub refinement: Option<Refinement>,
}

impl Answer {
    /// The answer for a refined pose, after the policy's steps if it took any.
    ///
    /// # Errors
    /// [`Error::BadPose`] if the refined pose is not rigid.
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

/// Result of the refinement that follows the policy's steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// The pose returned, and how the clouds fit under it.
    pub refined: Refined,
    /// The policy's pose, polished.
    pub polished: Refined,
    /// Number of other poses tried; `None` if the mode tries none.
    pub hypotheses: Option<usize>,
    /// What the shape leaves undetermined, as far as it was examined: without a comparison, a turn about an axis where planes
    /// hardly hold it.
    pub undetermined: Undetermined,
    /// The evidence for and against the pose.
    pub evidence: Evidence,
    /// The poses compared, the most probable first; all `None` without a comparison.
    pub ranked: [Option<Ranked>; RANKED],
}

/// Registers `source [N, 3]` to `target [M, 3]`, both in the same unit. Calls `progress` before every piece of work and after
/// every step of the policy; an error from it ends the registration.
///
/// # Errors
/// [`Error`] for refused clouds, a refused task or start, and whatever `progress` returns.
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
        // Equations 3 and 4.
        while registration.steps() < task.steps && !registration.is_settled() {
            progress(Progress::Next)?;
            let step = registrar.step(&mut registration)?; // equations 8 and 9
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

/// Refines the pose `reached`, as far as the mode asks for it.
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
        Some(model) if model.is_of(target) => Refiner::for_model(model, source, workspace)?,
        _ => Refiner::new(source, target, workspace)?,
    };
    task.tell_sensor(&mut refiner);
    Ok(Some(if mode == Mode::Verify {
        let found = refiner.verify_while(reached, &task.start, go_on)?;
        Refinement {
            refined: Refined {
                covariance: found.undetermined.widen(found.best.covariance),
                ..found.best
            },
            polished: found.polished,
            hypotheses: Some(found.hypotheses),
            undetermined: found.undetermined,
            evidence: Evidence::verified(&found),
            ranked: found.ranked,
        }
    } else {
        let (polished, undetermined) = refiner.polish_and_examine(reached)?;
        Refinement {
            refined: Refined {
                covariance: undetermined.widen(polished.covariance),
                ..polished
            },
            polished,
            hypotheses: None,
            undetermined,
            evidence: Evidence::polished(&polished),
            ranked: [None; RANKED],
        }
    }))
}

/// A name that names no [`Mode`].
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
