//! Layers of bytes, written once for all vectors that multiply them; see [`vector::Sums`].

pub(super) mod dense;
#[cfg(target_arch = "x86_64")]
pub(super) mod search;
pub(super) mod vector;
