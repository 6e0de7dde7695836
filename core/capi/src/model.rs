//! Prepared targets: `reagent_core::model`.

use crate::pointer::{aligned, floats};
use crate::status::{ReagentStatus, status};
use crate::workspace::{ReagentWorkspace, in_place};
use core::mem::{align_of, size_of};
use core::ptr::addr_of_mut;
use reagent_core::model::Model;

/// Words of a ReagentModel.
pub const REAGENT_MODEL_WORDS: usize = 14_500;

/// A target prepared by reagent_prepare. It may be moved and copied, and any number of registrations may use it at a time.
#[repr(C)]
pub struct ReagentModel {
    pub(crate) words: [u64; REAGENT_MODEL_WORDS],
}

/// The content of a [`ReagentModel`].
struct State {
    /// [`PREPARED`] once the model is.
    mark: u32,
    model: Model,
}

const PREPARED: u32 = 0x5265_4d64;

const _: () = assert!(size_of::<State>() <= size_of::<ReagentModel>());
const _: () = assert!(align_of::<State>() <= align_of::<ReagentModel>());
// At most a tenth too large.
const _: () = assert!(size_of::<State>() * 10 >= size_of::<ReagentModel>() * 9);

/// Prepares a target once for any number of registrations: a ReagentTask may refer to the model. A target of more than 2048
/// points is prepared by every registration nevertheless.
///
/// # Safety
/// `model` and `workspace` point to a whole ReagentModel and ReagentWorkspace, of any content; `target` to 3 * `target_points` floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_prepare(
    model: *mut ReagentModel,
    workspace: *mut ReagentWorkspace,
    target: *const f32,
    target_points: usize,
) -> ReagentStatus {
    let prepare = || {
        if !aligned(model) {
            return Err(ReagentStatus::Pointer);
        }
        // SAFETY: the caller's promise.
        let target = unsafe { floats(target, target_points) }?;
        // SAFETY: the caller's promise.
        let workspace = unsafe { in_place(workspace) }?;
        let state = model.cast::<State>();
        // SAFETY: aligned and large enough, as asserted above; written whole before a reference to it is made.
        let model = unsafe {
            addr_of_mut!((*state).mark).write(0);
            addr_of_mut!((*state).model).write(Model::new());
            &mut *addr_of_mut!((*state).model)
        };
        workspace.prepare(target, model)?;
        // SAFETY: as above.
        unsafe { addr_of_mut!((*state).mark).write(PREPARED) };
        Ok(())
    };
    status(prepare().map_err(ReagentStatus::of_target))
}

/// The model that a task refers to, if any.
///
/// # Safety
/// `model` is null, not aligned, or points to a [`ReagentModel`] of any content that nobody writes to meanwhile.
pub(crate) unsafe fn named<'m>(
    model: *const ReagentModel,
) -> Result<Option<&'m Model>, ReagentStatus> {
    if model.is_null() {
        return Ok(None);
    }
    if !aligned(model) {
        return Err(ReagentStatus::Pointer);
    }
    let state = model.cast::<State>();
    // SAFETY: aligned and large enough, as asserted above; any bits are a u32, and the mark is set only after `reagent_prepare`
    // has written the rest.
    unsafe {
        match (&raw const (*state).mark).read() {
            PREPARED => Ok(Some(&(*state).model)),
            _ => Err(ReagentStatus::NotPrepared),
        }
    }
}
