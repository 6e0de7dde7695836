//! A registration, from its clouds to its pose.

use crate::cloud::{CloudPointer, ReagentGrid};
use crate::memory::{ReagentMemory, state, work};
use crate::pointer::{aligned, value};
use crate::status::{ReagentStatus, status};
use reagent_core::{Action, Frame, Pose};

/// A rigid transform that maps the source onto the target, as rows of [R | t], in the clouds' units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReagentPose {
    /// Three rows of four.
    pub rows: [[f32; 4]; 3],
}

impl From<Pose> for ReagentPose {
    fn from(pose: Pose) -> Self {
        ReagentPose {
            rows: pose.to_rows(),
        }
    }
}

/// One step of a registration: ids into the step table, 0 to 10, for x, y and z; 5 is "stop".
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReagentStep {
    /// Ids along the axes.
    pub translation: [u8; 3],
    /// Ids about the axes.
    pub rotation: [u8; 3],
}

impl From<Action> for ReagentStep {
    fn from(action: Action) -> Self {
        ReagentStep {
            translation: action.translation,
            rotation: action.rotation,
        }
    }
}

/// State of a registration.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReagentResult {
    /// The pose so far.
    pub target_from_source: ReagentPose,
    /// Steps taken.
    pub steps: u32,
    /// Whether further steps would change nothing: the last was "stop"
    /// on every axis, in all the ways in which the policy looks.
    pub converged: bool,
}

/// Sets the target, the model or reference cloud: `points` times x, y, z. It is read again when a source is set, but not later.
/// A registration in progress ends.
///
/// # Safety
/// `memory` is as reagent_init left it; `xyz` points to 3 * `points` floats that stay unchanged until the last source is set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_set_target(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    status(unsafe { set_target(memory, CloudPointer::floats(xyz, points)) })
}

/// As reagent_set_target, for a cloud on a grid: `points` times three codes.
///
/// # Safety
/// As reagent_set_target; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_set_target_on_grid(
    memory: *mut ReagentMemory,
    grid: *const ReagentGrid,
    codes: *const i16,
    points: usize,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    status(unsafe { set_target(memory, CloudPointer::codes(grid, codes, points)) })
}

/// # Safety
/// As reagent_set_target.
unsafe fn set_target(
    memory: *mut ReagentMemory,
    target: Result<CloudPointer, ReagentStatus>,
) -> Result<(), ReagentStatus> {
    let target = target.map_err(ReagentStatus::of_target)?;
    // SAFETY: the caller's promise.
    let state = unsafe { state(memory) }?;
    // SAFETY: the caller's promise.
    let frame = Frame::of_cloud(unsafe { target.cloud() });
    state.frame = frame.map_err(|error| ReagentStatus::from(error).of_target())?;
    state.target = Some(target);
    state.started = false;
    Ok(())
}

/// Sets the source, the observed cloud, in the target's units, and starts a registration.
/// This embeds the target, which takes as long as one step over as many points;
/// reagent_begin leaves that to slices. `initial` is an estimate of the pose, null for none.
///
/// # Safety
/// As reagent_set_target, but `xyz` stays unchanged until the last step; `initial` is null or points to a pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_set_source(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
    initial: *const ReagentPose,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    status(
        CloudPointer::floats(xyz, points)
            .and_then(|source| unsafe { start(memory, source, initial, false) }),
    )
}

/// As reagent_set_source, for a cloud on a grid; the target may be on another grid, or of floats.
///
/// # Safety
/// As reagent_set_source; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_set_source_on_grid(
    memory: *mut ReagentMemory,
    grid: *const ReagentGrid,
    codes: *const i16,
    points: usize,
    initial: *const ReagentPose,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    let source = unsafe { CloudPointer::codes(grid, codes, points) };
    // SAFETY: the caller's promise.
    status(source.and_then(|source| unsafe { start(memory, source, initial, false) }))
}

/// As reagent_set_source, but only checks the clouds; the slices of reagent_advance embed the target.
///
/// # Safety
/// As reagent_set_source; the target, too, stays unchanged until the last step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_begin(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
    initial: *const ReagentPose,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    status(
        CloudPointer::floats(xyz, points)
            .and_then(|source| unsafe { start(memory, source, initial, true) }),
    )
}

/// As reagent_begin, for a cloud on a grid.
///
/// # Safety
/// As reagent_begin; `grid` points to a grid, which is copied, and `codes` to 3 * `points` codes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_begin_on_grid(
    memory: *mut ReagentMemory,
    grid: *const ReagentGrid,
    codes: *const i16,
    points: usize,
    initial: *const ReagentPose,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    let source = unsafe { CloudPointer::codes(grid, codes, points) };
    // SAFETY: the caller's promise.
    status(source.and_then(|source| unsafe { start(memory, source, initial, true) }))
}

/// # Safety
/// As reagent_set_source, or if `sliced`, as reagent_begin.
unsafe fn start(
    memory: *mut ReagentMemory,
    source: CloudPointer,
    initial: *const ReagentPose,
    sliced: bool,
) -> Result<(), ReagentStatus> {
    // SAFETY: the caller's promise.
    let state = unsafe { state(memory) }?;
    let initial = if initial.is_null() {
        Pose::IDENTITY
    } else {
        // SAFETY: the caller's promise.
        Pose::from_rows(unsafe { value(initial) }?.rows)
    };
    let target = state.target.ok_or(ReagentStatus::NotStarted)?;
    // SAFETY: the caller's promise.
    let (source, target) = unsafe { (source.cloud(), target.cloud()) };
    let frame = state.frame;
    // SAFETY: initialised as the mark says.
    let (mut registrar, registration) = unsafe { work(state) };
    registrar.begin(registration, source, target, frame, initial)?;
    while !sliced && registration.is_at_target() {
        registrar.advance(registration, usize::MAX)?;
    }
    state.started = true;
    Ok(())
}

/// Does the next slice of the registration's work: looks at `points` points at most (but at least one) of either cloud; or runs
/// a head on what was seen, which costs at most as many multiply-adds as 9 points, or 17 if the policy looks both ways. If that
/// completes a step, writes what was done to `step`, unless null; writes whether it does to `stepped`, unless null. Steps and
/// poses are the same to the bit, however they are sliced.
///
/// # Safety
/// `memory` is as reagent_begin or reagent_set_source left it; `step` is null or points to a step, `stepped` is null or points
/// to a bool.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_advance(
    memory: *mut ReagentMemory,
    points: usize,
    step: *mut ReagentStep,
    stepped: *mut bool,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let state = unsafe { state(memory) }?;
        if !state.started {
            return Err(ReagentStatus::NotStarted);
        }
        // SAFETY: initialised as the mark says.
        let (mut registrar, registration) = unsafe { work(state) };
        let done = registrar.advance(registration, points)?;
        // SAFETY: the caller's promise.
        let (step, stepped) = unsafe { (step.as_mut(), stepped.as_mut()) };
        if let Some(stepped) = stepped {
            *stepped = done.is_some();
        }
        if let (Some(step), Some(done)) = (step, done) {
            *step = done.action.into();
        }
        Ok(())
    })())
}

/// Takes one step of the registration: looks at the source under the
/// present pose and moves it. Writes what was done to `step`, unless null.
///
/// # Safety
/// `memory` is as reagent_set_source left it; `step` is null or points to a step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_step(
    memory: *mut ReagentMemory,
    step: *mut ReagentStep,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let state = unsafe { state(memory) }?;
        if !state.started {
            return Err(ReagentStatus::NotStarted);
        }
        // SAFETY: initialised as the mark says.
        let (mut registrar, registration) = unsafe { work(state) };
        let action = registrar.step(registration)?.action;
        // SAFETY: the caller's promise.
        if let Some(step) = unsafe { step.as_mut() } {
            *step = action.into();
        }
        Ok(())
    })())
}

/// Writes the state of the registration to `result`.
///
/// # Safety
/// `memory` is as reagent_set_source left it; `result` points to a result.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_result(
    memory: *mut ReagentMemory,
    result: *mut ReagentResult,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let state = unsafe { state(memory) }?;
        if !aligned(result) {
            return Err(ReagentStatus::Pointer);
        }
        if !state.started {
            return Err(ReagentStatus::NotStarted);
        }
        // SAFETY: initialised as the mark says.
        let registration = unsafe { state.registration.assume_init_ref() };
        let found = ReagentResult {
            target_from_source: registration.target_from_source().into(),
            steps: registration.steps() as u32,
            converged: registration.is_settled(),
        };
        // SAFETY: the caller's promise, and checked above.
        unsafe { result.write(found) };
        Ok(())
    })())
}
