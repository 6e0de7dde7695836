//! Pointers from C: checked for null and alignment, trusted for the rest.

use crate::ReagentStatus;
use core::slice::from_raw_parts;
use reagent_core::dims::MAX_POINTS;

/// The value behind a pointer that must not be null.
///
/// # Safety
/// `pointer` is null, not aligned, or points to a value.
pub(crate) unsafe fn value<T: Copy>(pointer: *const T) -> Result<T, ReagentStatus> {
    if !aligned(pointer) {
        return Err(ReagentStatus::Pointer);
    }
    // SAFETY: the caller's promise, and checked above.
    Ok(unsafe { pointer.read() })
}

/// Whether a pointer can be read through.
pub(crate) fn aligned<T>(pointer: *const T) -> bool {
    !pointer.is_null() && pointer.is_aligned()
}

/// Whether a cloud of `points` points can be read through a pointer.
pub(crate) fn check_pointer<T>(numbers: *const T, points: usize) -> Result<(), ReagentStatus> {
    if points > MAX_POINTS {
        return Err(ReagentStatus::TooManyPoints);
    }
    if points > 0 && !aligned(numbers) {
        return Err(ReagentStatus::Pointer);
    }
    Ok(())
}

/// The points of a cloud of floats.
///
/// # Safety
/// `xyz` is null, not aligned, or points to 3 * `points` floats that live while the slice does.
pub(crate) unsafe fn floats<'c>(
    xyz: *const f32,
    points: usize,
) -> Result<&'c [[f32; 3]], ReagentStatus> {
    check_pointer(xyz, points)?;
    if points == 0 {
        return Ok(&[]);
    }
    // SAFETY: the caller's promise, and checked above.
    Ok(unsafe { from_raw_parts(xyz.cast(), points) })
}
