//! What to do with two clouds.

use crate::model::{ReagentModel, named};
use crate::pointer::{floats, value};
use crate::register::ReagentPose;
use crate::status::ReagentStatus;
use core::ptr::null;
use reagent_core::Pose;
use reagent_core::pipeline::{Mode, Task};
use reagent_core::start::{Start, Uncertainty};

/// What is done with a start.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReagentMode {
    /// The policy's steps alone, as the paper has it.
    Fast = 0,
    /// The policy's steps, then a few robust steps of closest points.
    Polish = 1,
    /// The same, compared with some four hundred other poses: the best is taken, by how it fits and by how near to the start it is.
    /// That takes some six times as long.
    Verify = 2,
    /// A few robust steps of closest points from the start, without the policy: for tracking.
    Refine = 3,
}

/// What to do with two clouds: reagent_task makes one, and what is to be different is set in it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReagentTask {
    /// A ReagentMode.
    pub mode: i32,
    /// The policy's steps at most; 10 in the paper.
    pub steps: u32,
    /// An estimate of the pose to find.
    pub start: ReagentPose,
    /// Unless 0: any rotation is as probable as that of the estimate.
    pub anywhere: u32,
    /// Standard deviation of the estimate's rotation about the object's centre, radians.
    pub rotation_rad: f32,
    /// Standard deviation of the object's centre along the viewing axis, target radii.
    pub along: f32,
    /// The same across it. Where no view point is known the larger of both holds everywhere.
    pub across: f32,
    /// Where the sensor stood, x, y and z in the source's frame and unit, if the source is a view from one point; else null.
    pub view_point: *const f32,
    /// What it saw besides the source, such as the other pixels of a depth image: x, y and z of each point, in the source's frame
    /// and unit. What would stand before that counts against a pose, too. Points that are NaN or infinite are left out. Null if it is not
    /// known; left aside without a view point.
    pub background: *const f32,
    /// How many points that are, at most 4096: pixels spread around the object are enough.
    pub background_points: usize,
    /// The target, made ready by reagent_prepare; null if it is not. One of another target is left aside.
    pub model: *const ReagentModel,
}

/// The best pose within the paper's ten steps, from the identity, as uncertain as an estimator's or an operator's pose.
#[unsafe(no_mangle)]
pub extern "C" fn reagent_task() -> ReagentTask {
    let Uncertainty {
        rotation_rad,
        along,
        across,
    } = Uncertainty::DEFAULT;
    ReagentTask {
        mode: ReagentMode::Verify as i32,
        steps: reagent_core::dims::STEPS as u32,
        start: Pose::IDENTITY.into(),
        anywhere: 0,
        rotation_rad,
        along,
        across,
        view_point: null(),
        background: null(),
        background_points: 0,
        model: null(),
    }
}

impl ReagentTask {
    /// The same in Rust.
    ///
    /// # Safety
    /// The view point is null, not aligned, or points to three floats; the background to as many points as it says; the model is null,
    /// not aligned, or points to a whole ReagentModel.
    pub(crate) unsafe fn read<'c>(&self) -> Result<Task<'c>, ReagentStatus> {
        let mode = [Mode::Fast, Mode::Polish, Mode::Verify, Mode::Refine];
        let mode = usize::try_from(self.mode).ok().and_then(|i| mode.get(i));
        let view_point = if self.view_point.is_null() {
            None
        } else {
            // SAFETY: the caller's promise.
            Some(unsafe { value(self.view_point.cast::<[f32; 3]>()) }?.into())
        };
        // SAFETY: the caller's promise.
        let background = unsafe { floats(self.background, self.background_points) };
        let background = background.map_err(|status| match status {
            ReagentStatus::TooManyPoints => ReagentStatus::BackgroundTooManyPoints,
            other => other,
        })?;
        // SAFETY: the caller's promise.
        let model = unsafe { named(self.model) }?;
        let uncertainty = Uncertainty {
            rotation_rad: self.rotation_rad,
            along: self.along,
            across: self.across,
        };
        let start = match self.anywhere {
            0 => Start::Pose(Pose::from_rows(self.start.rows), uncertainty),
            _ => Start::Anywhere,
        };
        Ok(Task {
            mode: *mode.ok_or(ReagentStatus::NoSuchMode)?,
            steps: self.steps as usize,
            view_point,
            background,
            model,
            ..Task::new(start)
        })
    }
}
