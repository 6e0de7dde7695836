//! Memory for the refinement after the policy's steps.

use crate::pointer::aligned;
use crate::status::ReagentStatus;
use core::mem::{align_of, size_of};
use reagent_core::polish::Workspace;

/// Words of a ReagentWorkspace.
pub const REAGENT_WORKSPACE_WORDS: usize = 30_300;

/// Memory for one call of reagent_register, reagent_refine or reagent_prepare, provided by the caller, with any content.
#[repr(C)]
pub struct ReagentWorkspace {
    pub(crate) words: [u64; REAGENT_WORKSPACE_WORDS],
}

const _: () = assert!(size_of::<Workspace>() <= size_of::<ReagentWorkspace>());
const _: () = assert!(align_of::<Workspace>() <= align_of::<ReagentWorkspace>());
// At most a tenth too large.
const _: () = assert!(size_of::<Workspace>() * 10 >= size_of::<ReagentWorkspace>() * 9);

/// Puts an empty workspace into the caller's memory.
///
/// # Safety
/// `workspace` is null, not aligned, or points to a whole [`ReagentWorkspace`] that nobody else uses meanwhile.
pub(crate) unsafe fn in_place<'w>(
    workspace: *mut ReagentWorkspace,
) -> Result<&'w mut Workspace, ReagentStatus> {
    if !aligned(workspace) {
        return Err(ReagentStatus::Pointer);
    }
    let workspace = workspace.cast::<Workspace>();
    // SAFETY: aligned and large enough, as asserted above; written whole before a reference to it is made.
    unsafe {
        workspace.write(Workspace::new());
        Ok(&mut *workspace)
    }
}
