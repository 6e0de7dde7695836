//! The policies that ship with this crate, each linked in by a feature.

use crate::error::Error;
use crate::weights::Policy;

/// Aligns a linked file as its arrays are aligned within it.
#[repr(C, align(64))]
struct Aligned<T: ?Sized>(T);

#[cfg(feature = "pretrained")]
static FILE: &Aligned<[u8]> = &Aligned(*include_bytes!("../weights/reagent.rgw"));
#[cfg(feature = "pretrained-int8")]
static INT8: &Aligned<[u8]> = &Aligned(*include_bytes!("../weights/reagent-int8.rgw"));
#[cfg(feature = "pretrained-compact")]
static COMPACT: &Aligned<[u8]> = &Aligned(*include_bytes!("../weights/reagent-compact-int8.rgw"));

#[cfg(feature = "pretrained-views")]
static VIEWS: &Aligned<[u8]> = &Aligned(*include_bytes!("../weights/views-int8.rgw"));
#[cfg(feature = "pretrained-views-compact")]
static VIEWS_COMPACT: &Aligned<[u8]> =
    &Aligned(*include_bytes!("../weights/views-compact-int8.rgw"));

#[cfg(feature = "pretrained")]
impl Policy<'static> {
    /// The bytes of the policy that ships with this crate, in f32, 64-byte aligned (feature `pretrained`,
    /// 10.1 MB).
    pub const fn pretrained_bytes() -> &'static [u8] {
        &FILE.0
    }

    /// The policy that ships with this crate, in f32 (feature `pretrained`).
    ///
    /// # Errors
    /// As [`Policy::parse`]; none as long as the linked image is intact.
    pub fn pretrained() -> Result<Self, Error> {
        Policy::parse(Self::pretrained_bytes())
    }
}

#[cfg(feature = "pretrained-int8")]
impl Policy<'static> {
    /// The bytes of the same policy in 8-bit integers, 64-byte aligned (feature `pretrained-int8`, 2.5 MB).
    pub const fn pretrained_int8_bytes() -> &'static [u8] {
        &INT8.0
    }

    /// The same policy in 8-bit integers (feature `pretrained-int8`).
    ///
    /// # Errors
    /// As [`Policy::parse`]; none as long as the linked image is intact.
    pub fn pretrained_int8() -> Result<Self, Error> {
        Policy::parse(Self::pretrained_int8_bytes())
    }
}

#[cfg(feature = "pretrained-compact")]
impl Policy<'static> {
    /// The bytes of the policy for small microcontrollers, in 8-bit
    /// integers, 64-byte aligned (feature `pretrained-compact`, 251 KiB).
    pub const fn pretrained_compact_bytes() -> &'static [u8] {
        &COMPACT.0
    }

    /// The policy for small microcontrollers (feature `pretrained-compact`).
    ///
    /// # Errors
    /// As [`Policy::parse`]; none as long as the linked image is intact.
    pub fn pretrained_compact() -> Result<Self, Error> {
        Policy::parse(Self::pretrained_compact_bytes())
    }
}

#[cfg(feature = "pretrained-views")]
impl Policy<'static> {
    /// The bytes of the policy for single depth views, in 8-bit integers, 64-byte aligned (feature `pretrained-views`,
    /// 2.5 MB).
    pub const fn pretrained_views_int8_bytes() -> &'static [u8] {
        &VIEWS.0
    }

    /// The policy for a source that is one depth view of the target, with a start near the true pose. It looks only at what may
    /// belong together ([`Sight`](crate::sight::Sight)) (feature `pretrained-views`).
    ///
    /// # Errors
    /// As [`Policy::parse`]; none as long as the linked image is intact.
    pub fn pretrained_views_int8() -> Result<Self, Error> {
        Policy::parse(Self::pretrained_views_int8_bytes())
    }
}

#[cfg(feature = "pretrained-views-compact")]
impl Policy<'static> {
    /// The bytes of the policy for single depth views on small microcontrollers, in 8-bit integers, 64-byte aligned
    /// (feature `pretrained-views-compact`, 251 KiB).
    pub const fn pretrained_views_compact_bytes() -> &'static [u8] {
        &VIEWS_COMPACT.0
    }

    /// The policy for single depth views on small microcontrollers (feature `pretrained-views-compact`).
    ///
    /// # Errors
    /// As [`Policy::parse`]; none as long as the linked image is intact.
    pub fn pretrained_views_compact() -> Result<Self, Error> {
        Policy::parse(Self::pretrained_views_compact_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Shape;

    #[test]
    fn the_linked_policies_are_sound() {
        #[cfg(feature = "pretrained")]
        assert_eq!(Policy::pretrained().map(|p| p.shape), Ok(Shape::FULL));
        #[cfg(feature = "pretrained-int8")]
        assert_eq!(Policy::pretrained_int8().map(|p| p.shape), Ok(Shape::FULL));
        #[cfg(feature = "pretrained-compact")]
        assert_eq!(
            Policy::pretrained_compact().map(|p| p.shape),
            Ok(Shape::COMPACT)
        );
        #[cfg(feature = "pretrained-views")]
        assert_eq!(
            Policy::pretrained_views_int8().map(|p| (p.shape, p.sight.cut.radii(), p.sight.focus)),
            Ok((Shape::FULL, 1.25, 3))
        );
        #[cfg(feature = "pretrained-views-compact")]
        assert_eq!(
            Policy::pretrained_views_compact().map(|p| (p.shape, p.sight.focus)),
            Ok((Shape::COMPACT, 3))
        );
    }
}
