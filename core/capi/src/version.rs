//! Whether header and library belong together.

/// Version of this header: changes with incompatible calls.
pub const REAGENT_VERSION_MAJOR: u32 = 0;
/// Version of this header: changes with new calls (with incompatible ones, too, before 1.0.0).
pub const REAGENT_VERSION_MINOR: u32 = 1;
/// Version of this header: changes with nothing that a caller sees.
pub const REAGENT_VERSION_PATCH: u32 = 0;
/// Version of this header as one number, to compare with reagent_version.
pub const REAGENT_VERSION: u32 =
    REAGENT_VERSION_MAJOR * 1000000 + REAGENT_VERSION_MINOR * 1000 + REAGENT_VERSION_PATCH;

/// Version of the library that is linked: REAGENT_VERSION of its own header.
#[unsafe(no_mangle)]
pub extern "C" fn reagent_version() -> u32 {
    REAGENT_VERSION
}
