//! Whether a view point can be one.

use crate::dataset::Point;
use glam::Vec3;
use reagent_core::pose::centroid;

/// Whether some points of a cloud lie behind a view point that looks at their centroid: the core takes no notice of it then.
pub(super) fn lies_among(eye: Vec3, cloud: &[Point]) -> bool {
    let ahead = centroid(cloud) - eye;
    let is_behind = |&point: &Point| ahead.dot(Vec3::from_array(point) - eye) <= 0.0;
    cloud.iter().any(is_behind)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_point_in_front_of_all_points_is_one() {
        let cloud = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.2], [0.0, 1.0, 0.9]];
        assert!(!lies_among(Vec3::ZERO, &cloud));
        assert!(lies_among(Vec3::new(0.4, 0.4, 1.0), &cloud));
        assert!(lies_among(centroid(&cloud), &cloud));
    }
}
