//! A pose made better, and how sure it is: `reagent_core::polish` and `reagent_core::verify`.

use crate::pointer::{aligned, floats, value};
use crate::register::ReagentPose;
use crate::status::{ReagentStatus, status};
use core::mem::{align_of, size_of};
use reagent_core::evidence::Evidence;
use reagent_core::polish::{Refiner, Workspace};
use reagent_core::start::Start;
use reagent_core::{Cloud, Error, Pose};

/// Words of a ReagentWorkspace.
pub const REAGENT_WORKSPACE_WORDS: usize = 24_700;

/// Memory of reagent_polish and reagent_verify: the caller's, of any content, for as long as the call.
#[repr(C)]
pub struct ReagentWorkspace {
    pub(crate) words: [u64; REAGENT_WORKSPACE_WORDS],
}

const _: () = assert!(size_of::<Workspace>() <= size_of::<ReagentWorkspace>());
const _: () = assert!(align_of::<Workspace>() <= align_of::<ReagentWorkspace>());
// No more than a tenth too large.
const _: () = assert!(size_of::<Workspace>() * 10 >= size_of::<ReagentWorkspace>() * 9);

/// Makes a pose better by at most 22 robust steps of closest points, both ways; it fits no worse afterwards. Of
/// more than 2048 points of a cloud so many are used. `probability` is where it is told how likely the pose is
/// within 5 degrees and .05 radii of the right one, or null: below .5 it should not be trusted.
///
/// # Safety
/// `workspace` points to a whole ReagentWorkspace; `source` and `target` to 3 * as many floats as they have
/// points; `pose` to a pose, where the better one is put; `probability` is null or points to a float.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_polish(
    workspace: *mut ReagentWorkspace,
    source: *const f32,
    source_points: usize,
    target: *const f32,
    target_points: usize,
    pose: *mut ReagentPose,
    probability: *mut f32,
) -> ReagentStatus {
    let clouds = [(source, source_points), (target, target_points)];
    // SAFETY: the caller's promise.
    status(unsafe {
        refine(workspace, clouds, pose, probability, |refiner, pose| {
            let found = refiner.polish(pose)?;
            Ok((found.target_from_source, Evidence::polished(&found)))
        })
    })
}

/// As reagent_polish, and compared with some four hundred other poses: the best one is taken, by how it fits and by how near to
/// `pose` it is. That takes some six times as long.
///
/// # Safety
/// As reagent_polish.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_verify(
    workspace: *mut ReagentWorkspace,
    source: *const f32,
    source_points: usize,
    target: *const f32,
    target_points: usize,
    pose: *mut ReagentPose,
    probability: *mut f32,
) -> ReagentStatus {
    let clouds = [(source, source_points), (target, target_points)];
    // SAFETY: the caller's promise.
    status(unsafe {
        refine(workspace, clouds, pose, probability, |refiner, pose| {
            let found = refiner.verify(pose, &Start::at(pose))?;
            Ok((found.best.target_from_source, Evidence::verified(&found)))
        })
    })
}

/// # Safety
/// As reagent_polish.
unsafe fn refine(
    workspace: *mut ReagentWorkspace,
    [source, target]: [(*const f32, usize); 2],
    pose: *mut ReagentPose,
    probability: *mut f32,
    by: impl FnOnce(&mut Refiner<'_>, Pose) -> Result<(Pose, Evidence), Error>,
) -> Result<(), ReagentStatus> {
    if !aligned(workspace) || !(probability.is_null() || probability.is_aligned()) {
        return Err(ReagentStatus::Pointer);
    }
    // SAFETY: the caller's promise.
    let initial = Pose::from_rows(unsafe { value(pose) }?.rows);
    // SAFETY: the caller's promise.
    let source = unsafe { floats(source.0, source.1) }?;
    // SAFETY: the caller's promise.
    let target = unsafe { floats(target.0, target.1) }.map_err(ReagentStatus::of_target)?;
    let checked = Cloud::F32(target).check().map_err(ReagentStatus::from);
    checked.map_err(ReagentStatus::of_target)?;
    let workspace = workspace.cast::<Workspace>();
    // SAFETY: aligned and large enough, as asserted above; written whole before a reference to it is made.
    let workspace = unsafe {
        workspace.write(Workspace::new());
        &mut *workspace
    };
    let (found, evidence) = by(&mut Refiner::new(source, target, workspace)?, initial)?;
    // SAFETY: the caller's promise; the pose was read above.
    unsafe {
        pose.write(ReagentPose {
            rows: found.to_rows(),
        });
        if let Some(probability) = probability.as_mut() {
            *probability = evidence.probability();
        }
    }
    Ok(())
}
