//! Points cut into cells that are neighbours in memory as in space (a k-d tree, stored as a flat array).

use crate::select::select;
use core::cmp::Ordering;
use glam::Vec3;

/// Splits points into halves of whole cells, across the longest side, until no cell has more than `most`.
pub(crate) fn cut<T: Copy>(points: &mut [T], most: usize, at: impl Fn(&T) -> Vec3 + Copy) {
    let half = points.len().div_ceil(most) / 2 * most;
    if half == 0 {
        return;
    }
    let [low, high] = bounds(points, at);
    let axis = (high - low).max_position();
    select(points, half, |a, b| compare(axis, at(a), at(b)));
    if let Some((below, above)) = points.split_at_mut_checked(half) {
        cut(below, most, at);
        cut(above, most, at);
    }
}

/// Compares by the coordinate on `axis`, then by the others. Only identical points are equal, so every algorithm that selects
/// or sorts by it ends in the same order.
pub(crate) fn compare(axis: usize, a: Vec3, b: Vec3) -> Ordering {
    let (a, b) = (a.to_array(), b.to_array());
    let by = |axis: usize| match (a.get(axis % 3), b.get(axis % 3)) {
        (Some(a), Some(b)) => a.total_cmp(b),
        _ => Ordering::Equal,
    };
    by(axis)
        .then_with(|| by(axis + 1))
        .then_with(|| by(axis + 2))
}

/// The lowest and the highest coordinates.
pub(crate) fn bounds<T>(points: &[T], at: impl Fn(&T) -> Vec3) -> [Vec3; 2] {
    let widen = |[low, high]: [Vec3; 2], at: Vec3| [low.min(at), high.max(at)];
    let start = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    points.iter().map(at).fold(start, widen)
}
