//! Points cut into cells: those side by side follow each other (a k-d tree, written down in a row).

use crate::select::select;
use core::cmp::Ordering;
use glam::Vec3;

/// Cuts points in halves of whole cells until no cell has more than `most`, each across its longest side.
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

/// By the coordinate on an axis, then by the others: no two points that differ are equal, so that every algorithm that selects
/// or sorts by it comes to the same end.
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

/// Lowest and highest coordinates.
pub(crate) fn bounds<T>(points: &[T], at: impl Fn(&T) -> Vec3) -> [Vec3; 2] {
    let widen = |[low, high]: [Vec3; 2], at: Vec3| [low.min(at), high.max(at)];
    let start = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    points.iter().map(at).fold(start, widen)
}
