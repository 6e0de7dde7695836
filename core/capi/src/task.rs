//! What to do with two clouds.

use crate::model::{ReagentModel, named};
use crate::pointer::{floats, value};
use crate::register::ReagentPose;
use crate::status::ReagentStatus;
use core::ptr::null;
use reagent_core::Pose;
use reagent_core::pipeline::{Mode, Task};
use reagent_core::start::{Start, Uncertainty};

/// How much work a registration does.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReagentMode {
    /// The policy's steps alone, as the paper has it.
    Fast = 0,
    /// The policy's steps, then a few robust steps of closest points.
    Polish = 1,
    /// As POLISH, then a comparison with one to eight hundred other poses. The best is taken, judged by its fit and its distance
    /// from the start. This takes some six times as long.
    Verify = 2,
    /// A few robust steps of closest points from the start, without the policy: for tracking.
    Refine = 3,
}

/// What to do with two clouds: reagent_task makes a default one, in which fields may be changed.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReagentTask {
    /// A ReagentMode.
    pub mode: i32,
    /// Most steps of the policy; 10 in the paper.
    pub steps: u32,
    /// An estimate of the pose.
    pub start: ReagentPose,
    /// If not 0, all rotations are as probable as the estimate's.
    pub anywhere: u32,
    /// Standard deviation of the estimate's rotation about the object's centre, in radians.
    pub rotation_rad: f32,
    /// Standard deviation of the object's centre along the viewing axis, in target radii.
    pub along: f32,
    /// The same across the axis. Without a view point, the larger of the two holds in all directions.
    pub across: f32,
    /// Where the sensor stood: x, y and z in the source's frame and unit, if the source is a view from one point; else null.
    pub view_point: *const f32,
    /// What the sensor saw besides the source, such as the other pixels of a depth image: x, y and z of each point, in the
    /// source's frame and unit. What would stand in front of it counts against a pose as well. NaN and infinite points are
    /// ignored. Null if unknown; ignored without a view point.
    pub background: *const f32,
    /// Number of these points, at most 4096: pixels spread around the object are enough.
    pub background_points: usize,
    /// Which way the target's surface faces, as a closed mesh tells: x, y and z of a direction for each point of the target,
    /// in their order. What faces away from the sensor was not seen. Three times INFINITY at a point that nothing outside can
    /// see, such as one inside a housing. Null if unknown; ignored without a view point, and for a target of more than 2048
    /// points.
    pub outward: *const f32,
    /// Number of these directions: that of the target's points, or 0.
    pub outward_directions: usize,
    /// The target, prepared by reagent_prepare; null if it is not. A model of another target is ignored.
    pub model: *const ReagentModel,
}

/// A task for the best pose within the paper's ten steps, from the identity, with the default uncertainty.
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
        outward: null(),
        outward_directions: 0,
        model: null(),
    }
}

impl ReagentTask {
    /// The task in Rust.
    ///
    /// # Safety
    /// The view point is null, not aligned, or points to three floats; the background and the directions, to as many as it states; the
    /// model is null, not aligned, or points to a whole ReagentModel.
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
        let background = background
            .map_err(|status| status.if_too_many(ReagentStatus::BackgroundTooManyPoints))?;
        // SAFETY: the caller's promise.
        let outward = unsafe { floats(self.outward, self.outward_directions) };
        let outward = outward.map_err(|status| status.if_too_many(ReagentStatus::OutwardCount))?;
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
            outward,
            model,
            ..Task::new(start)
        })
    }
}
