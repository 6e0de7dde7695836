//! ReAgent from C. The header is `include/reagent.h`; [`reagent_init`] comes first.
//!
//! The only `unsafe` outside the kernels: pointers from C are checked for null and alignment, and
//! trusted to point to as much memory as they are said to. Every function is bounded in time, allocates
//! nothing and calls nothing of the system.
#![cfg_attr(target_os = "none", no_std)]
#![allow(unsafe_code, reason = "a C interface is made of pointers")]

use core::mem::{MaybeUninit, align_of, size_of};
use core::ptr::addr_of_mut;
use reagent_core::net::Scratch;
use reagent_core::{Action, Error, Frame, Policy, Pose, Registrar, Registration, Verdict};

#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

/// Words of a ReagentMemory.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub const REAGENT_MEMORY_WORDS: usize = 6400;
/// Words of a ReagentMemory.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
pub const REAGENT_MEMORY_WORDS: usize = 1920;

/// Memory of one registrar: the caller's, of any content, where it likes. It must not be moved or
/// copied between calls.
#[repr(C)]
pub struct ReagentMemory {
    words: [u64; REAGENT_MEMORY_WORDS],
}

/// What is in a [`ReagentMemory`].
struct State {
    /// [`INITIALISED`] once the rest has been.
    mark: u32,
    /// Points of the target whose embedding is due.
    target: (*const [f32; 3], usize),
    frame: Frame,
    started: bool,
    policy: MaybeUninit<Policy<'static>>,
    scratch: MaybeUninit<Scratch>,
    registration: MaybeUninit<Registration<'static>>,
}

const INITIALISED: u32 = 0x5265_4167;

const _: () = assert!(size_of::<State>() <= size_of::<ReagentMemory>());
const _: () = assert!(align_of::<State>() <= align_of::<ReagentMemory>());
// No more than a tenth too large.
const _: () = assert!(size_of::<State>() * 10 >= size_of::<ReagentMemory>() * 9);

/// What came of a call. Whatever is not OK has changed nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReagentStatus {
    /// Done.
    Ok = 0,
    /// A pointer is null or not aligned.
    Pointer = 1,
    /// reagent_init has not succeeded on this memory.
    NotInitialised = 2,
    /// No target or no source has been set.
    NotStarted = 3,
    /// A cloud has no points.
    EmptyCloud = 4,
    /// A cloud has fewer than 3 points.
    TooFewPoints = 5,
    /// A cloud has more than 4096 points.
    TooManyPoints = 6,
    /// A coordinate is NaN or infinite.
    NotFinite = 7,
    /// All points of the target coincide.
    NoExtent = 8,
    /// The initial pose is not a finite rigid transform.
    BadPose = 9,
    /// The weights are cut, or bytes follow their end.
    WeightsLength = 10,
    /// The bytes are no weight file.
    WeightsMagic = 11,
    /// The weight file is of a version, number format or shape that this library does not run.
    WeightsFormat = 12,
    /// The weights are damaged.
    WeightsDamaged = 13,
    /// The weights do not start on a 4-byte boundary.
    WeightsAlignment = 14,
    /// Anything else.
    Other = 15,
}

impl From<Error> for ReagentStatus {
    fn from(error: Error) -> Self {
        match error {
            Error::EmptyCloud => ReagentStatus::EmptyCloud,
            Error::TooFewPoints { .. } => ReagentStatus::TooFewPoints,
            Error::TooManyPoints { .. } => ReagentStatus::TooManyPoints,
            Error::NotFinite { .. } => ReagentStatus::NotFinite,
            Error::NoExtent => ReagentStatus::NoExtent,
            Error::BadPose => ReagentStatus::BadPose,
            Error::WeightsLength { .. } => ReagentStatus::WeightsLength,
            Error::WeightsMagic => ReagentStatus::WeightsMagic,
            Error::WeightsVersion { .. }
            | Error::WeightsFormat { .. }
            | Error::WeightsDecision { .. }
            | Error::WeightsShape { .. } => ReagentStatus::WeightsFormat,
            Error::WeightsCrc | Error::WeightsNotFinite { .. } | Error::WeightsRange { .. } => {
                ReagentStatus::WeightsDamaged
            }
            Error::WeightsAlignment => ReagentStatus::WeightsAlignment,
            _ => ReagentStatus::Other,
        }
    }
}

/// A rigid transform that maps the source onto the target, as rows of [R | t], in the clouds' units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReagentPose {
    /// Three rows of four.
    pub rows: [[f32; 4]; 3],
}

/// One step of a registration: ids 0 to 10 of the step table for x, y and z; 5 is "stop".
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReagentStep {
    /// Along the axes.
    pub translation: [u8; 3],
    /// About the axes.
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

/// Where a registration is.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReagentResult {
    /// The pose so far.
    pub target_from_source: ReagentPose,
    /// Steps taken.
    pub steps: u32,
    /// The last step was "stop" on every axis: further ones change nothing.
    pub converged: bool,
}

/// Whether it can be read through.
fn aligned<T>(pointer: *const T) -> bool {
    !pointer.is_null() && pointer.is_aligned()
}

/// # Safety
/// `memory` points to a [`ReagentMemory`], of any content, that nobody else uses meanwhile.
unsafe fn state<'m>(memory: *mut ReagentMemory) -> Result<&'m mut State, ReagentStatus> {
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

/// # Safety
/// `points` points to `count` times three floats that live while the slice does.
unsafe fn cloud<'c>(points: *const [f32; 3], count: usize) -> &'c [[f32; 3]] {
    if count == 0 {
        return &[];
    }
    // SAFETY: the caller's, and `count` was checked to be no more than the most points of a cloud.
    unsafe { core::slice::from_raw_parts(points, count) }
}

fn check_pointer(xyz: *const f32, points: usize) -> Result<(), ReagentStatus> {
    if points > reagent_core::dims::MAX_POINTS {
        return Err(ReagentStatus::TooManyPoints);
    }
    if points > 0 && !aligned(xyz) {
        return Err(ReagentStatus::Pointer);
    }
    Ok(())
}

fn status(outcome: Result<(), ReagentStatus>) -> ReagentStatus {
    outcome.err().unwrap_or(ReagentStatus::Ok)
}

/// Checks a policy file (.rgw), which is read in place from then on, and makes the memory ready.
///
/// # Safety
/// `memory` points to a whole ReagentMemory; `weights` to `length` bytes that stay as they are for as
/// long as the memory is used.
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
    let weights: &'static [u8] = unsafe { core::slice::from_raw_parts(weights, length) };
    let policy = match Policy::parse(weights) {
        Ok(policy) => policy,
        Err(error) => return error.into(),
    };
    let state = memory.cast::<State>();
    // SAFETY: aligned and large enough, as asserted above; every field is written, in place, before a
    // reference to the whole is made.
    unsafe {
        addr_of_mut!((*state).target).write((core::ptr::null(), 0));
        addr_of_mut!((*state).frame).write(Frame::IDENTITY);
        addr_of_mut!((*state).started).write(false);
        addr_of_mut!((*state).policy).write(MaybeUninit::new(policy));
        addr_of_mut!((*state).scratch).write(MaybeUninit::new(Scratch::new()));
        addr_of_mut!((*state).registration).write(MaybeUninit::new(Registration::new()));
        addr_of_mut!((*state).mark).write(INITIALISED);
    }
    ReagentStatus::Ok
}

/// Sets the target, the model or reference cloud: `points` times x, y, z. It is read again when a
/// source is set, and not after. A registration under way ends.
///
/// # Safety
/// `memory` is as reagent_init left it; `xyz` points to 3 * `points` floats that stay as they are
/// until the last source is set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_set_target(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let state = unsafe { state(memory) }?;
        check_pointer(xyz, points)?;
        // SAFETY: the caller's promise, and checked above.
        let frame = Frame::of(unsafe { cloud(xyz.cast(), points) })?;
        state.frame = frame;
        state.target = (xyz.cast(), points);
        state.started = false;
        Ok(())
    })())
}

/// Sets the source, the observed cloud, in the target's units, and begins a registration: embeds the
/// target, which takes as long as one step of as many points; reagent_begin leaves that to slices. `initial`
/// is an estimate of the pose to find, null for none.
///
/// # Safety
/// As reagent_set_target, with `xyz` staying as it is until the last step; `initial` is null or points
/// to a pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_set_source(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
    initial: *const ReagentPose,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    status(unsafe { start(memory, xyz, points, initial, false) })
}

/// As reagent_set_source, but only looks through the clouds: the slices of reagent_advance embed the target.
///
/// # Safety
/// As reagent_set_source; the target, too, stays as it is until the last step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_begin(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
    initial: *const ReagentPose,
) -> ReagentStatus {
    // SAFETY: the caller's promise.
    status(unsafe { start(memory, xyz, points, initial, true) })
}

/// # Safety
/// As reagent_set_source, or where `sliced` as reagent_begin.
unsafe fn start(
    memory: *mut ReagentMemory,
    xyz: *const f32,
    points: usize,
    initial: *const ReagentPose,
    sliced: bool,
) -> Result<(), ReagentStatus> {
    // SAFETY: the caller's promise.
    let state = unsafe { state(memory) }?;
    check_pointer(xyz, points)?;
    if !initial.is_null() && !initial.is_aligned() {
        return Err(ReagentStatus::Pointer);
    }
    // SAFETY: the caller's promise, and checked above.
    let initial = unsafe { initial.as_ref() };
    let initial = initial.map_or(Pose::IDENTITY, |pose| Pose::from_rows(pose.rows));
    if state.target.1 == 0 {
        return Err(ReagentStatus::NotStarted);
    }
    // SAFETY: the caller's promise, and checked when they were set.
    let (source, target) = unsafe {
        (
            cloud(xyz.cast(), points),
            cloud(state.target.0, state.target.1),
        )
    };
    let frame = state.frame;
    // SAFETY: initialised as the mark says.
    let (mut registrar, registration) = unsafe { work(state) };
    if sliced {
        registrar.begin_in(registration, source, target, frame, initial)?;
    } else {
        registrar.start_in(registration, source, target, frame, initial)?;
    }
    state.started = true;
    Ok(())
}

/// The registrar and its registration.
///
/// # Safety
/// `state` has been initialised, as its mark says.
unsafe fn work(state: &mut State) -> (Registrar<'static, '_>, &mut Registration<'static>) {
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

/// Does the next slice of the registration's work: looks at no more than `points` points (but at least one) of
/// either cloud, or takes what was seen in, which is as much work as about 20 points are. `step` is where it is
/// told what was done when that was a step, or null; `stepped` is where it is told whether it was one, or null.
/// Steps and poses are the same to the bit, however they are sliced.
///
/// # Safety
/// `memory` is as reagent_begin or reagent_set_source left it; `step` is null or points to a step, `stepped` is
/// null or points to a bool.
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
        let done = registrar.advance(registration, points);
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

/// Takes one step of the registration: looks at the source under the pose so far and moves it.
/// `step` is where it is told what was done, or null.
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
        let action = registrar.step(registration).action;
        // SAFETY: the caller's promise.
        if let Some(step) = unsafe { step.as_mut() } {
            *step = action.into();
        }
        Ok(())
    })())
}

/// The policy that ships with ReAgent in 8-bit integers, for reagent_init; its bytes into `length`. Of a
/// library built with the feature pretrained-int8: define REAGENT_PRETRAINED_INT8.
///
/// # Safety
/// `length` points to a size, or is null.
#[cfg(feature = "pretrained-int8")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_pretrained_int8(length: *mut usize) -> *const u8 {
    // SAFETY: the caller's promise.
    unsafe { linked(Policy::pretrained_int8_bytes(), length) }
}

/// The policy for small microcontrollers, for reagent_init; its bytes into `length`. Of a library built with
/// the feature pretrained-compact: define REAGENT_PRETRAINED_COMPACT.
///
/// # Safety
/// `length` points to a size, or is null.
#[cfg(feature = "pretrained-compact")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_pretrained_compact(length: *mut usize) -> *const u8 {
    // SAFETY: the caller's promise.
    unsafe { linked(Policy::pretrained_compact_bytes(), length) }
}

/// # Safety
/// `length` points to a size, or is null.
#[cfg(any(feature = "pretrained-int8", feature = "pretrained-compact"))]
unsafe fn linked(file: &'static [u8], length: *mut usize) -> *const u8 {
    if aligned(length) {
        // SAFETY: the caller's promise.
        unsafe { length.write(file.len()) };
    }
    file.as_ptr()
}

/// Where the registration is.
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
            target_from_source: ReagentPose {
                rows: registration.target_from_source().to_rows(),
            },
            steps: registration.steps() as u32,
            converged: registration.verdict() == Verdict::Converged,
        };
        // SAFETY: the caller's promise, and checked above.
        unsafe { result.write(found) };
        Ok(())
    })())
}

#[cfg(test)]
mod tests;
