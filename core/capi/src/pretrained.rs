//! The policies that ship with ReAgent, each linked in by a feature.
#![allow(dead_code, unused_imports, reason = "without a feature there is none")]

use crate::pointer::aligned;
use reagent_core::Policy;

/// The policy that ships with ReAgent in f32, for reagent_init; writes its length in bytes to `length`. Needs a library built
/// with the feature pretrained: define REAGENT_PRETRAINED.
///
/// # Safety
/// `length` points to a size, or is null.
#[cfg(feature = "pretrained")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_pretrained(length: *mut usize) -> *const u8 {
    // SAFETY: the caller's promise.
    unsafe { linked(Policy::pretrained_bytes(), length) }
}

/// The policy that ships with ReAgent in 8-bit integers, for reagent_init; writes its length in bytes to `length`. Needs a
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

/// The policy for small microcontrollers, for reagent_init; writes its length in bytes to `length`. Needs a library built with
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

/// The policy for single depth views in 8-bit integers, for reagent_init; writes its length in bytes to `length`. Needs a
/// library built with the feature pretrained-views: define REAGENT_PRETRAINED_VIEWS.
///
/// # Safety
/// `length` points to a size, or is null.
#[cfg(feature = "pretrained-views")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_pretrained_views_int8(length: *mut usize) -> *const u8 {
    // SAFETY: the caller's promise.
    unsafe { linked(Policy::pretrained_views_int8_bytes(), length) }
}

/// The policy for single depth views on small microcontrollers, for reagent_init; writes its length in bytes to `length`. Needs
/// a library built with the feature pretrained-views-compact: define REAGENT_PRETRAINED_VIEWS_COMPACT.
///
/// # Safety
/// `length` points to a size, or is null.
#[cfg(feature = "pretrained-views-compact")]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_pretrained_views_compact(length: *mut usize) -> *const u8 {
    // SAFETY: the caller's promise.
    unsafe { linked(Policy::pretrained_views_compact_bytes(), length) }
}

/// # Safety
/// `length` points to a size, or is null.
unsafe fn linked(file: &'static [u8], length: *mut usize) -> *const u8 {
    if aligned(length) {
        // SAFETY: the caller's promise.
        unsafe { length.write(file.len()) };
    }
    file.as_ptr()
}
