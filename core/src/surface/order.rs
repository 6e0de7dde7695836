//! Points in spatial order, without duplicates.

use crate::cells::{compare, cut};
use crate::kernels::RUN;
use crate::select::sort;
use glam::Vec3;

/// Points in a cell, a whole number of blocks.
const CELL: usize = 128;

/// Puts points into spatial order without duplicates; returns how many remain. The points of each run, block and power-of-two
/// cell are close to each other.
pub(super) fn put_in_order(points: &mut [[f32; 3]]) -> usize {
    let at = |p: &[f32; 3]| Vec3::from_array(*p);
    let by_coordinates = |a: &[f32; 3], b: &[f32; 3]| compare(0, at(a), at(b));
    sort(points, by_coordinates);
    // Drops duplicates.
    let mut len = 0usize;
    for k in 0..points.len() {
        let before = len.checked_sub(1).and_then(|last| points.get(last));
        let point = points.get(k).copied();
        if let (Some(point), true) = (point, before != point.as_ref())
            && let Some(place) = points.get_mut(len)
        {
            *place = point;
            len += 1;
        }
    }
    let points = points.get_mut(..len).unwrap_or(&mut []);
    cut(points, CELL, at);
    for cell in points.chunks_mut(CELL) {
        cut(cell, RUN, at);
    }
    for run in points.chunks_mut(RUN) {
        sort(run, |a, b| {
            drawn(a).cmp(&drawn(b)).then_with(|| by_coordinates(a, b))
        });
    }
    len
}

/// A pseudo-random number of a point, the same one every time.
fn drawn(point: &[f32; 3]) -> u32 {
    let mix = |sum: u32, x: &f32| {
        (sum ^ x.to_bits())
            .wrapping_mul(0x9e37_79b1)
            .rotate_left(13)
    };
    point.iter().fold(0, mix)
}
