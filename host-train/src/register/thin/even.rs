//! Even thinning over space: a measure of how uneven a cloud is, and one point from each cell of a grid.

use super::{along, bounds};
use crate::dataset::Point;

/// Most points on which evenness is measured.
const JUDGED: usize = 1024;
/// Mean number of points in a cell of the grid that measures evenness.
const POINTS_A_CELL: usize = 4;
/// Clouds below this evenness are uneven. Views and clouds drawn from surfaces have .6 to .9; lidar scans, whose
/// rings lie close around the sensor, have .1 to .46.
const UNEVEN: f64 = 0.5;
/// Most cell sizes that are tried.
const TRIALS: usize = 16;

/// Whether few places hold most of the points. The points must be in order along the curve.
pub(super) fn is_uneven(points: &[Point]) -> bool {
    let step = points.len().div_ceil(JUDGED).max(1);
    let some: Vec<Point> = points.iter().step_by(step).copied().collect();
    evenness(&some) < UNEVEN
}

/// Jain's fairness index of the number of points in the occupied cells: 1 if all hold the same number, otherwise
/// about the share of the cells that hold most of the points. 1 if there are too few points to tell.
fn evenness(points: &[Point]) -> f64 {
    let Some(grid) = Grid::of(points, points.len() / POINTS_A_CELL) else {
        return 1.0;
    };
    let keys = grid.sorted_keys(points);
    let counts = || keys.chunk_by(|a, b| a == b).map(|cell| cell.len() as f64);
    let squares: f64 = counts().map(|count| count * count).sum();
    (points.len() as f64).powi(2) / (squares * counts().count() as f64)
}

/// The middle point of each occupied cell, in a grid with at least `count` such cells and few more; `None` if there
/// are not so many distinct places.
pub(super) fn one_a_cell(points: &[Point], count: usize) -> Option<Vec<Point>> {
    let grid = Grid::of(points, count)?;
    let mut keyed: Vec<(u64, Point)> = points.iter().map(|p| (grid.key(p), *p)).collect();
    keyed.sort_unstable_by(along);
    let cells = keyed.chunk_by(|a, b| a.0 == b.0);
    Some(cells.map(|cell| cell[cell.len() / 2].1).collect())
}

/// A grid of cubic cells.
struct Grid {
    low: Point,
    size: f64,
}

impl Grid {
    /// The grid in which at least `occupied` cells hold points, and few more, found by narrowing the cell size.
    fn of(points: &[Point], occupied: usize) -> Option<Grid> {
        let (low, side) = bounds(points);
        let side = f64::from(side);
        if occupied == 0 || side <= 0.0 {
            return None;
        }
        // A key has 20 bits for each axis, and one for points on the border.
        let (mut fine, mut coarse) = (side / f64::from(1 << 20), side);
        let mut found = None;
        let mut size = side / (occupied as f64).sqrt();
        for _ in 0..TRIALS {
            size = size.max(fine);
            let grid = Grid { low, size };
            let cells = grid.sorted_keys(points).chunk_by(|a, b| a == b).count();
            if cells < occupied {
                coarse = size;
            } else {
                (fine, found) = (size, Some(grid));
                if cells <= occupied + occupied / 16 {
                    break;
                }
            }
            // A surface occupies four times as many cells of half the size.
            let next = size * (cells as f64 / occupied as f64).sqrt();
            let is_between = fine < next && next < coarse;
            size = if is_between {
                next
            } else {
                (fine * coarse).sqrt()
            };
        }
        found
    }

    fn sorted_keys(&self, points: &[Point]) -> Vec<u64> {
        let mut keys: Vec<u64> = points.iter().map(|p| self.key(p)).collect();
        keys.sort_unstable();
        keys
    }

    /// A cell's indices along the three axes, packed into one number.
    fn key(&self, point: &Point) -> u64 {
        let place = |axis: usize| (f64::from(point[axis] - self.low[axis]) / self.size) as u64;
        place(0) | place(1) << 21 | place(2) << 42
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::random::{Purpose, stream};
    use crate::register::thin::{spread_as_all, thin};
    use rand::RngExt;

    /// Flat ground, seen by a lidar at 2 m: the density falls with the third power of the distance.
    fn ground(count: usize) -> Vec<Point> {
        let rng = &mut stream(4, Purpose::Surface, 0);
        let mut point = || {
            let (down, turn) = (
                rng.random_range(0.05..0.45f32),
                rng.random_range(0.0..std::f32::consts::TAU),
            );
            let distance = 2.0 / down.tan();
            [distance * turn.cos(), distance * turn.sin(), 0.0]
        };
        (0..count).map(|_| point()).collect()
    }

    #[test]
    fn uneven_clouds_are_thinned_evenly() {
        let mut points = ground(20_000);
        let far = |points: &[Point]| {
            let is_far = |p: &&Point| p[0].hypot(p[1]) > 20.0;
            points.iter().filter(is_far).count()
        };
        let some = thin(&points, 2000);
        assert_eq!(some.len(), 2000);
        assert!(some.iter().all(|p| points.contains(p)));
        let crowded = spread_as_all(&points, 2000);
        assert!(far(&crowded) < 400, "{}", far(&crowded));
        assert!(far(&some) > 1000, "{}", far(&some));
        let (before, after) = (evenness(&crowded), evenness(&some));
        assert!(before < 0.45 && after > 0.6, "{before} became {after}");
        points.reverse();
        assert_eq!(thin(&points, 2000), some);
    }

    #[test]
    fn surfaces_are_thinned_as_before() {
        for category in 0..22 {
            let mesh = procedural::shape(1, category).mesh;
            let points = mesh.sample(20_000, &mut stream(2, Purpose::Surface, 0));
            for count in [4096, 2048, 300] {
                let as_all = spread_as_all(&points, count);
                let evenness = evenness(&as_all);
                assert!(evenness > 0.55, "shape {category}: {evenness}");
                assert_eq!(thin(&points, count), as_all);
            }
        }
    }

    #[test]
    fn places_that_do_not_differ_are_taken_as_before() {
        let mut points = ground(3000);
        points[..2990].fill([1.0; 3]);
        assert_eq!(thin(&points, 500), spread_as_all(&points, 500));
        assert!(one_a_cell(&points, 500).is_none());
        assert!(one_a_cell(&[[1.0; 3]; 9], 4).is_none());
        for few in 0..9 {
            assert!(!is_uneven(&points[2985..2985 + few]));
        }
    }
}
