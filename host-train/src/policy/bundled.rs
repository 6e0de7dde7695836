//! Policies that are linked in.

use reagent_core::Policy;

/// Policies that are linked in, by name.
pub static BUNDLED: [(&str, &[u8]); 5] = [
    (REAGENT, Policy::pretrained_bytes()),
    (REAGENT_INT8, Policy::pretrained_int8_bytes()),
    (COMPACT, Policy::pretrained_compact_bytes()),
    (VIEWS, Policy::pretrained_views_int8_bytes()),
    (VIEWS_COMPACT, Policy::pretrained_views_compact_bytes()),
];
/// The bundled policy for whole clouds.
pub const REAGENT: &str = "reagent";
/// The same in 8-bit integers.
pub const REAGENT_INT8: &str = "reagent-int8";
/// The bundled policy for a source that is a single depth view.
pub const VIEWS: &str = "views";
/// The bundled small policy for whole clouds.
pub const COMPACT: &str = "compact";
/// The bundled small policy for a source that is a single depth view.
pub const VIEWS_COMPACT: &str = "views-compact";
