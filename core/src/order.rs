//! The order in which a cloud's points are embedded, chosen to save time. Neighbouring points follow each other, so that one
//! bound for all of them is tight ([`crate::kernels`]). Ahead of them go some points far from the middle, from all over the
//! cloud: their maxima come close to the final ones, and points below a maximum are skipped. The feature is the same to the bit
//! in any order.
//!
//! Sixteen points share a bound. Cells are cut across their longest side until none has more points (a k-d tree).

use crate::cells::{bounds, cut};
use crate::cloud::Cloud;
use crate::dims::POINTS_ORDERED;
use crate::kernels::NEAR;
use glam::Vec3;

/// Points in a cell that sends one point ahead.
const SEED_CELL: usize = 2 * NEAR;

/// An order of a cloud's points; the cloud's own until one is found.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    points: [u16; POINTS_ORDERED],
    /// Points in the order: the whole cloud, or 0 for the cloud's own order.
    len: usize,
    /// Number of points sent ahead.
    seeds: usize,
}

/// A point and its index.
#[derive(Clone, Copy)]
struct Place {
    at: Vec3,
    point: u16,
}

impl Order {
    /// The cloud's own order.
    pub(crate) const NONE: Order = Order {
        points: [0; POINTS_ORDERED],
        len: 0,
        seeds: 0,
    };

    /// Returns to the cloud's own order.
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Finds an order for a cloud; a cloud too large for the array keeps its own.
    pub(crate) fn find(&mut self, cloud: Cloud<'_>) {
        self.clear();
        let mut places = [Place {
            at: Vec3::ZERO,
            point: 0,
        }; POINTS_ORDERED];
        let Some(places) = places.get_mut(..cloud.len()) else {
            return;
        };
        for (point, (place, at)) in places.iter_mut().zip(cloud.points()).enumerate() {
            *place = Place {
                at: at.into(),
                point: point as u16,
            };
        }
        let seeds = arrange(places, |place| place.at);
        for (point, place) in self.points.iter_mut().zip(&*places) {
            *point = place.point;
        }
        (self.len, self.seeds) = (cloud.len(), seeds);
    }

    /// The index of the point at a place in the order.
    pub(crate) fn point(&self, place: usize) -> usize {
        match self.points.get(..self.len).and_then(|p| p.get(place)) {
            Some(&point) => point.into(),
            None => place,
        }
    }

    /// How many points from `place` on may be embedded together; points sent ahead do not mix with others.
    pub(crate) fn together(&self, place: usize) -> usize {
        match self.seeds.checked_sub(place) {
            Some(seeds) if seeds > 0 && self.len > 0 => seeds,
            _ => usize::MAX,
        }
    }
}

/// Reorders a cloud in place, for a device without memory for an order, such as a microcontroller. Poses may differ in their
/// last bits, since the centroid is summed in the order of the points.
pub fn put_in_order(cloud: &mut [[f32; 3]]) {
    arrange(cloud, |&point| point.into());
}

/// Reorders points in place; returns how many go ahead.
fn arrange<T: Copy>(points: &mut [T], at: impl Fn(&T) -> Vec3 + Copy) -> usize {
    let [low, high] = bounds(points, at);
    let middle = (low + high) / 2.0;
    cut(points, SEED_CELL, at);
    let mut seeds = 0;
    for first in (0..points.len()).step_by(SEED_CELL) {
        let cell = points.iter().enumerate().skip(first).take(SEED_CELL);
        let from_middle = |point: &T| at(point).distance_squared(middle);
        let far = cell.max_by(|(_, a), (_, b)| from_middle(a).total_cmp(&from_middle(b)));
        if let Some((far, _)) = far {
            points.swap(seeds, far);
            seeds += 1;
        }
    }
    // Groups stay whole: the count is rounded up to a multiple of the group size.
    seeds = seeds.next_multiple_of(NEAR).min(points.len());
    if let Some(rest) = points.get_mut(seeds..) {
        cut(rest, NEAR, at);
    }
    seeds
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn order_of(points: &[[f32; 3]]) -> Vec<usize> {
        let mut order = Order::NONE;
        order.find(Cloud::F32(points));
        (0..points.len()).map(|place| order.point(place)).collect()
    }

    proptest! {
        #[test]
        fn every_point_has_a_place(points in proptest::collection::vec(any::<[f32; 3]>(), 0..300)) {
            let mut order = order_of(&points);
            order.sort_unstable();
            prop_assert!(order.into_iter().eq(0..points.len()));
        }
    }

    #[test]
    fn neighbours_follow_each_other() {
        // 32 x 32 points of a square, in an order that jumps from one end to the other.
        let at = |i: usize| [(i * 13 % 32) as f32, (i / 32 * 7 % 32) as f32, 0.0];
        let points: Vec<[f32; 3]> = (0..1024).map(at).collect();
        let order = order_of(&points);
        let (seeds, rest) = order.split_at(1024 / SEED_CELL);
        for cell in rest.chunks(NEAR) {
            let places = cell.iter().map(|&point| Place {
                at: points[point].into(),
                point: point as u16,
            });
            let [low, high] = bounds(&places.collect::<Vec<_>>(), |place| place.at);
            assert!((high - low).max_element() <= 8.0);
        }
        // Each cell sends its point farthest from the middle.
        let corners = seeds.iter().filter(|&&point| {
            let [x, y, _] = points[point];
            (x == 0.0 || x == 31.0) && (y == 0.0 || y == 31.0)
        });
        assert_eq!(corners.count(), 4);
    }

    #[test]
    fn a_cloud_is_as_it_comes_until_an_order_is_found() {
        let order = Order::NONE;
        assert_eq!(order.point(7), 7);
        assert_eq!(order.together(0), usize::MAX);
        let mut order = Order::NONE;
        order.find(Cloud::F32(&[[1.0, 2.0, 3.0]; 100]));
        assert_eq!(order.together(1), 15);
        assert_eq!(order.together(16), usize::MAX);
        order.clear();
        assert_eq!(order.point(99), 99);
    }
}
