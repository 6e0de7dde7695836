//! The caller's memory, and its content.

use crate::ReagentStatus;
use crate::cloud::CloudPointer;
use crate::pointer::aligned;
use core::mem::{MaybeUninit, align_of, size_of};
use core::ptr::addr_of_mut;
use core::slice::from_raw_parts;
use reagent_core::net::Scratch;
use reagent_core::{Frame, Policy, Registrar, Registration};

// Large unless the compiler is known to be for microcontrollers: each compiler names its processor differently.
/// Words of a ReagentMemory.
#[cfg(not(target_arch = "arm"))]
pub const REAGENT_MEMORY_WORDS: usize = 8128;
/// Words of a ReagentMemory.
#[cfg(target_arch = "arm")]
pub const REAGENT_MEMORY_WORDS: usize = 2240;

/// Memory of one registrar, provided by the caller, with any content. It must not be moved or copied between calls.
#[repr(C)]
pub struct ReagentMemory {
    pub(crate) words: [u64; REAGENT_MEMORY_WORDS],
}

/// The content of a [`ReagentMemory`].
pub(crate) struct State {
    /// [`INITIALISED`] once the other fields are.
    mark: u32,
    /// The target, to be embedded when a source is set; `None` before one is set.
    pub(crate) target: Option<CloudPointer>,
    pub(crate) frame: Frame,
    pub(crate) started: bool,
    policy: MaybeUninit<Policy<'static>>,
    scratch: MaybeUninit<Scratch>,
    pub(crate) registration: MaybeUninit<Registration<'static>>,
}

const INITIALISED: u32 = 0x5265_4167;

const _: () = assert!(size_of::<State>() <= size_of::<ReagentMemory>());
const _: () = assert!(align_of::<State>() <= align_of::<ReagentMemory>());
// At most a tenth too large.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "arm"))]
const _: () = assert!(size_of::<State>() * 10 >= size_of::<ReagentMemory>() * 9);

/// The content of a memory.
///
/// # Safety
/// `memory` points to a [`ReagentMemory`], of any content, that nobody else uses meanwhile.
pub(crate) unsafe fn state<'m>(memory: *mut ReagentMemory) -> Result<&'m mut State, ReagentStatus> {
    if !aligned(memory) {
        return Err(ReagentStatus::Pointer);
    }
    let state = memory.cast::<State>();
    // SAFETY: aligned and large enough, as asserted above; any bits are a u32.
    if unsafe { addr_of_mut!((*state).mark).read() } != INITIALISED {
        return Err(ReagentStatus::NotInitialised);
    }
    // SAFETY: `reagent_init` has written all of it.
    Ok(unsafe { &mut *state })
}

/// The registrar and its registration.
///
/// # Safety
/// `state` was initialised, as its mark says.
pub(crate) unsafe fn work(
    state: &mut State,
) -> (Registrar<'static, '_>, &mut Registration<'static>) {
    // SAFETY: the caller's promise.
    unsafe {
        (
            Registrar::new(
                state.policy.assume_init_read(),
                state.scratch.assume_init_mut(),
            ),
            state.registration.assume_init_mut(),
        )
    }
}

/// Checks a policy file (.rgw), which is read in place from then on, and prepares the memory.
///
/// # Safety
/// `memory` points to a whole ReagentMemory, and `weights` to `length` bytes that stay unchanged as long as the memory is used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_init(
    memory: *mut ReagentMemory,
    weights: *const u8,
    length: usize,
) -> ReagentStatus {
    if !aligned(memory) || weights.is_null() || length > isize::MAX as usize {
        return ReagentStatus::Pointer;
    }
    // SAFETY: the caller's promise.
    let weights: &'static [u8] = unsafe { from_raw_parts(weights, length) };
    let policy = match Policy::parse(weights) {
        Ok(policy) => policy,
        Err(error) => return error.into(),
    };
    let state = memory.cast::<State>();
    // SAFETY: aligned and large enough, as asserted above; every field is written, in place, before a
    // reference to the whole is made.
    unsafe {
        addr_of_mut!((*state).target).write(None);
        addr_of_mut!((*state).frame).write(Frame::IDENTITY);
        addr_of_mut!((*state).started).write(false);
        addr_of_mut!((*state).policy).write(MaybeUninit::new(policy));
        addr_of_mut!((*state).scratch).write(MaybeUninit::new(Scratch::new()));
        addr_of_mut!((*state).registration).write(MaybeUninit::new(Registration::new()));
        addr_of_mut!((*state).mark).write(INITIALISED);
    }
    ReagentStatus::Ok
}
