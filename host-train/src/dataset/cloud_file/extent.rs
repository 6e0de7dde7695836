//! The place and size of a cloud.

use crate::pose64::Position;
use nalgebra::Vector3;

/// A cloud farther from the origin than this many radii is registered relative to a point of its own. Closer to the
/// origin, f32 resolves a millionth of the radius.
const FAR: f64 = 16.0;

/// The origin to which coordinates are relative in f32: zero, or the middle of a cloud so far away that f32 would
/// round more than a millionth of its size.
pub(crate) fn origin_of(points: impl Iterator<Item = Position> + Clone) -> Position {
    let (middle, radius) = extent(points);
    match Vector3::from(middle).norm() > FAR * radius {
        true => middle,
        false => [0.0; 3],
    }
}

/// Whether a cloud of the size of these points would lie far from the origin with its middle there.
pub(super) fn would_be_far(
    points: impl Iterator<Item = Position> + Clone,
    middle: Position,
) -> bool {
    Vector3::from(middle).norm() > FAR * extent(points).1
}

/// Steps of float32 above this share of a cloud's radius are visible in its shape.
const COARSE: f64 = 1e-3;

/// The step between neighbouring float32 numbers at the cloud's coordinates, if all of these are on float32's grid
/// and the step is coarse for the cloud's size.
pub(super) fn coarse_step(points: &[Position]) -> Option<f64> {
    let some = points.iter().copied();
    let (middle, radius) = extent(some.step_by(points.len().div_ceil(SOME_POINTS).max(1)));
    let largest = middle.into_iter().map(f64::abs).fold(0.0, f64::max) as f32;
    let step = f64::from(largest.next_up()) - f64::from(largest);
    let is_coarse = radius > 0.0 && step > COARSE * radius;
    let on_grid = |x: &f64| f64::from(*x as f32) == *x;
    (is_coarse && points.iter().flatten().all(on_grid)).then_some(step)
}

/// Points that suffice to estimate a cloud's place and size.
const SOME_POINTS: usize = 256;

/// Most points from which a cloud's extent is computed.
const MEDIAN_POINTS: usize = 1 << 16;

/// Median of each coordinate, and median distance from that point; medians ignore points that a sensor left at
/// zero. Large clouds are sampled at equal steps.
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
