//! Where a cloud lies, and how large it is.

use crate::pose64::Position;
use nalgebra::Vector3;

/// A cloud farther from the origin than this many times its radius is registered relative to a point of its
/// own; nearer by, f32 resolves a millionth of the radius.
const FAR: f64 = 16.0;

/// The point relative to which coordinates are f32: zero, or the middle of a cloud far from it, of whose size
/// f32 would round more than a millionth.
pub(crate) fn origin_of(points: impl Iterator<Item = Position> + Clone) -> Position {
    let (middle, radius) = extent(points);
    match Vector3::from(middle).norm() > FAR * radius {
        true => middle,
        false => [0.0; 3],
    }
}

/// Points of which the extent of a cloud is found at most.
const MEDIAN_POINTS: usize = 1 << 16;

/// Median of each coordinate, and median distance from there: points that a sensor left at zero do not count. Of a large cloud,
/// points at equal steps stand for all.
fn extent(points: impl Iterator<Item = Position> + Clone) -> (Position, f64) {
    let count = points.clone().count();
    let points: Vec<Position> = points
        .step_by(count.div_ceil(MEDIAN_POINTS).max(1))
        .collect();
    let median = |mut values: Vec<f64>| {
        let half = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => *values.select_nth_unstable_by(half, f64::total_cmp).1,
        }
    };
    let middle = [0, 1, 2].map(|axis| median(points.iter().map(|p| p[axis]).collect()));
    let distance = |p: &Position| (Vector3::from(*p) - Vector3::from(middle)).norm();
    (middle, median(points.iter().map(distance).collect()))
}
