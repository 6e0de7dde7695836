//! How the network sees a cloud.

use crate::pose::Pose;
use glam::Vec3;

/// An affine map `x' = R (x - origin) + t` under which a stored cloud is seen. It covers both a pose and a normalisation, so no
/// transformed copy of a cloud is ever stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Point that maps to the translation; the cloud's centroid in the disentangled form.
    pub origin: Vec3,
    /// Rotation (times a scale) and translation.
    pub map: Pose,
}

impl View {
    /// The cloud as it is stored.
    pub const IDENTITY: View = View {
        origin: Vec3::ZERO,
        map: Pose::IDENTITY,
    };

    /// Where a stored point appears.
    #[inline(always)]
    pub fn see(&self, point: [f32; 3]) -> [f32; 3] {
        self.map
            .apply(Vec3::from_array(point) - self.origin)
            .to_array()
    }
}
