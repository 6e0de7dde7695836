//! Working memory for selecting medians.

use crate::dims::SURFACE_POINTS;
use crate::outliers::Bulk;
use crate::select::select;

/// Integer keys of a surface's points, ordered as the numbers they stand for.
#[derive(Clone, Debug)]
pub(crate) struct Keys(pub(super) [u32; SURFACE_POINTS]);

impl Keys {
    /// All bits are zero.
    pub(crate) const ZERO: Keys = Keys([0; SURFACE_POINTS]);

    /// The bulk of a cloud, for [`super::Surface::fill`].
    pub(crate) fn bulk(&mut self, cloud: &[[f32; 3]]) -> Bulk {
        Bulk::of(cloud, &mut self.0)
    }

    /// The `k`-th smallest of the first `count` keys, as the float that it stands for.
    pub(super) fn select(&mut self, count: usize, k: usize) -> f32 {
        f32::from_bits(self.select_key(count, k))
    }

    pub(super) fn select_key(&mut self, count: usize, k: usize) -> u32 {
        let keys = self.0.get_mut(..count);
        let selected = keys.and_then(|keys| select(keys, k, u32::cmp));
        selected.unwrap_or_default()
    }
}
