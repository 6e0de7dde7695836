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

/// Whether a cloud of the size of these points, with its middle there, lies far from the origin.
pub(super) fn would_be_far(
    points: impl Iterator<Item = Position> + Clone,
    middle: Position,
) -> bool {
    Vector3::from(middle).norm() > FAR * extent(points).1
}

/// Steps of float32 larger than this share of a cloud's radius are seen in its shape.
const COARSE: f64 = 1e-3;

/// How far neighbouring numbers of float32 are apart where the cloud lies, if its coordinates are of this type or on its grid and
/// that is much for its size.
pub(super) fn coarse_step(points: &[Position]) -> Option<f64> {
    let some = points.iter().copied();
    let (middle, radius) = extent(some.step_by(points.len().div_ceil(SOME_POINTS).max(1)));
    let largest = middle.into_iter().map(f64::abs).fold(0.0, f64::max) as f32;
    let step = f64::from(largest.next_up()) - f64::from(largest);
    let is_coarse = radius > 0.0 && step > COARSE * radius;
    let on_grid = |x: &f64| f64::from(*x as f32) == *x;
    (is_coarse && points.iter().flatten().all(on_grid)).then_some(step)
}

/// Points that tell well enough where a cloud lies.
const SOME_POINTS: usize = 256;

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
