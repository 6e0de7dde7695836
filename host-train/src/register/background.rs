//! The points of a background that matter to a registration.

use crate::dataset::Point;
use glam::Vec3;
use reagent_core::Error;
use reagent_core::polish::{Refiner, Workspace};
use std::collections::HashSet;

/// Reduces a background, what was seen besides the source, to the nearest point in each cell of the image in which free
/// space is checked: some two thousand points at most, with bit for bit the result of all points.
///
/// # Errors
/// Clouds that the core refuses.
pub fn nearest_per_cell(
    [source, target]: [&[Point]; 2],
    view_point: Vec3,
    background: &[Point],
) -> Result<Vec<Point>, Error> {
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(source, target, &mut workspace)?;
    refiner.set_sensor(view_point, background);
    let mut cells = HashSet::new();
    let is_nearest = |&&point: &&Point| {
        let cell = refiner.nearest_in_cell(Vec3::from_array(point));
        cell.is_some_and(|cell| cells.insert(cell))
    };
    let mut nearest: Vec<Point> = background.iter().filter(is_nearest).copied().collect();
    if nearest.is_empty() {
        // The image is wider with a background, even with one that is out of sight.
        nearest.extend(background.first());
    }
    Ok(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::random::{Purpose, stream};
    use glam::Mat3;
    use reagent_core::Pose;

    #[test]
    fn a_few_points_say_what_all_do() {
        let mesh = procedural::shape(1, 1).mesh;
        let [source, target] =
            [1, 2].map(|i| mesh.sample(700, &mut stream(3, Purpose::Surface, i)));
        let eye = Vec3::new(0.5, -0.3, -6.0);
        let wall = |i: usize| {
            let (x, y) = ((i % 200) as f32 / 30.0, (i / 200) as f32 / 30.0);
            [x - 3.3, y - 3.3, 1.5 + 0.3 * x]
        };
        let mut background: Vec<Point> = (0..40_000).map(wall).collect();
        background.push([f32::NAN; 3]);
        let clouds = [source.as_slice(), &target];
        let out_of_sight = [[0.0, 0.0, -20.0]; 3];
        for background in [&background[..], &out_of_sight, &[]] {
            let few = nearest_per_cell(clouds, eye, background).expect("two clouds");
            assert!(few.len() <= 48 * 48 && few.is_empty() == background.is_empty());
            let mut workspace = Box::new(Workspace::new());
            let mut residuals = |background: &[Point]| -> Vec<_> {
                let mut refiner =
                    Refiner::new(&source, &target, &mut workspace).expect("two clouds");
                refiner.set_sensor(eye, background);
                let moved = |k: i32| Pose {
                    rotation: Mat3::from_rotation_x(0.1 * k as f32),
                    translation: Vec3::new(0.2, 0.1, 0.3) * k as f32,
                };
                let residual = |k| refiner.residual(moved(k)).expect("a pose");
                (-6..6).map(residual).collect()
            };
            let all = residuals(background);
            assert_eq!(residuals(&few), all);
            if few.len() > 1 {
                assert_ne!(residuals(&few[..few.len() / 2]), all);
            }
        }
    }
}
