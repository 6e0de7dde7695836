//! Whole registrations, and refinement after the policy's steps: `reagent_core::pipeline`.

use crate::answer::ReagentAnswer;
use crate::memory::{ReagentMemory, state, work};
use crate::pointer::{aligned, floats, value};
use crate::register::ReagentPose;
use crate::status::{ReagentStatus, status};
use crate::task::ReagentTask;
use crate::workspace::{ReagentWorkspace, in_place};
use reagent_core::pipeline::{self, Progress, Task};
use reagent_core::polish::Workspace;
use reagent_core::{Cloud, Error, Pose, Verdict};

/// Runs a whole registration: the policy's steps, then the refinement of the task's mode. The refinement uses at most 2048
/// points of each cloud. A registration in progress in the memory ends.
///
/// # Safety
/// `memory` is as reagent_init left it; `workspace` points to a whole ReagentWorkspace; `source` and `target` to 3 floats for
/// each of their points; `task` to a task; `answer` to room for an answer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_register(
    memory: *mut ReagentMemory,
    workspace: *mut ReagentWorkspace,
    source: *const f32,
    source_points: usize,
    target: *const f32,
    target_points: usize,
    task: *const ReagentTask,
    answer: *mut ReagentAnswer,
) -> ReagentStatus {
    let clouds = [(source, source_points), (target, target_points)];
    let register = |workspace: &mut Workspace, [source, target]: Clouds<'_>, task: Task<'_>| {
        // SAFETY: the caller's promise.
        let state = unsafe { state(memory) }?;
        // SAFETY: initialised as the mark says.
        let (mut registrar, _) = unsafe { work(state) };
        let clouds = [source, target];
        let mut stepped = false;
        let found = pipeline::register(&mut registrar, workspace, clouds, &task, |progress| {
            stepped |= matches!(progress, Progress::Step(..));
            Ok::<_, Error>(())
        });
        // A refusal before the first step leaves a registration in progress as it is.
        state.started &= found.is_err() && !stepped;
        let found = found?;
        Ok(ReagentAnswer::of(
            found.target_from_source,
            found.verdict,
            found.policy.map_or(0, |policy| policy.steps),
            found.refinement.as_ref(),
        ))
    };
    // SAFETY: the caller's promise.
    status(unsafe { answered(workspace, clouds, task, answer, register) })
}

/// Refines a pose, perhaps reached by reagent_step, as the task's mode says: no policy is needed. The start counts as evidence,
/// but the refinement does not begin there.
///
/// # Safety
/// As reagent_register; `reached` points to a pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_refine(
    workspace: *mut ReagentWorkspace,
    source: *const f32,
    source_points: usize,
    target: *const f32,
    target_points: usize,
    reached: *const ReagentPose,
    task: *const ReagentTask,
    answer: *mut ReagentAnswer,
) -> ReagentStatus {
    let clouds = [(source, source_points), (target, target_points)];
    let refine = |workspace: &mut Workspace, clouds: Clouds<'_>, task: Task<'_>| {
        // SAFETY: the caller's promise.
        let reached = Pose::from_rows(unsafe { value(reached) }?.rows).checked()?;
        let found = pipeline::refine(workspace, clouds, reached, &task, || Ok::<_, Error>(()))?;
        let (pose, verdict) = match &found {
            Some(found) => (
                found.refined.target_from_source.checked()?,
                Verdict::of_evidence(&found.evidence),
            ),
            None => (reached, Verdict::StepLimit),
        };
        Ok(ReagentAnswer::of(pose, verdict, 0, found.as_ref()))
    };
    // SAFETY: the caller's promise.
    status(unsafe { answered(workspace, clouds, task, answer, refine) })
}

/// Source, then target.
type Clouds<'c> = [&'c [[f32; 3]]; 2];

/// # Safety
/// As reagent_register.
unsafe fn answered(
    workspace: *mut ReagentWorkspace,
    [source, target]: [(*const f32, usize); 2],
    task: *const ReagentTask,
    answer: *mut ReagentAnswer,
    by: impl FnOnce(&mut Workspace, Clouds<'_>, Task<'_>) -> Result<ReagentAnswer, ReagentStatus>,
) -> Result<(), ReagentStatus> {
    if !aligned(answer) {
        return Err(ReagentStatus::Pointer);
    }
    // SAFETY: the caller's promise.
    let task = unsafe { value(task)?.read() }?;
    // SAFETY: the caller's promise.
    let source = unsafe { floats(source.0, source.1) }?;
    // SAFETY: the caller's promise.
    let target = unsafe { floats(target.0, target.1) }.map_err(ReagentStatus::of_target)?;
    Cloud::F32(source).check()?;
    let checked = Cloud::F32(target).check().map_err(ReagentStatus::from);
    checked.map_err(ReagentStatus::of_target)?;
    if ![0, target.len()].contains(&task.outward.len()) {
        return Err(ReagentStatus::OutwardCount);
    }
    // SAFETY: the caller's promise.
    let found = by(unsafe { in_place(workspace) }?, [source, target], task)?;
    // SAFETY: the caller's promise, and checked above.
    unsafe { answer.write(found) };
    Ok(())
}
