//! Versions, by which to check that header and library belong together.

/// Major version of this header: changes with incompatible calls.
pub const REAGENT_VERSION_MAJOR: u32 = 0;
/// Minor version of this header: changes with new calls, and before 1.0.0 with incompatible ones.
pub const REAGENT_VERSION_MINOR: u32 = 1;
/// Patch version of this header: changes with nothing that a caller sees.
pub const REAGENT_VERSION_PATCH: u32 = 0;
/// Version of this header as one number, to compare with reagent_version.
pub const REAGENT_VERSION: u32 =
    REAGENT_VERSION_MAJOR * 1000000 + REAGENT_VERSION_MINOR * 1000 + REAGENT_VERSION_PATCH;

/// Version of the linked library: REAGENT_VERSION of its own header.
#[unsafe(no_mangle)]
pub extern "C" fn reagent_version() -> u32 {
    REAGENT_VERSION
}
