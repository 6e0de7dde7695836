//! The policy that ships with this crate, linked in.

use crate::error::Error;
use crate::weights::Policy;

/// Places the file where its arrays are aligned as they are in the file.
#[repr(C, align(64))]
struct Aligned<T: ?Sized>(T);

static FILE: &Aligned<[u8]> = &Aligned(*include_bytes!("../weights/reagent.rgw"));

impl Policy<'static> {
    /// The bytes of the policy that ships with this crate, 64-byte aligned (feature `pretrained`).
    pub const fn pretrained_bytes() -> &'static [u8] {
        &FILE.0
    }

    /// The policy that ships with this crate (feature `pretrained`).
    ///
    /// # Errors
    /// As [`Policy::parse`]; none as long as the linked image is intact.
    pub fn pretrained() -> Result<Self, Error> {
        Policy::parse(Self::pretrained_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_linked_policy_is_sound() {
        assert!(Policy::pretrained().is_ok());
    }
}
