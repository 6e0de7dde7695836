//! A cloud as a sampled surface: points in spatial order, boxes around runs of them, and normals. Matching leaves it unchanged:
//! [`matching`] keeps its results apart.

use crate::dims::SURFACE_POINTS;
use crate::kernels::{Boxes, Corners, Isa, OrientedPoints, Places, RUNS};
use crate::outliers::{Bulk, ordered, unordered};
use crate::solve::principal_axes;
use glam::{Mat3, Vec3};
use keys::Keys;

mod boxes;
pub(crate) mod keys;
pub(crate) mod matching;
mod normals;
mod order;

use order::put_in_order;

/// One radius in the stored form of [`Surface::inward`].
const INWARD: f32 = 127.0;

/// A sampled surface, in a frame of the caller's.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    len: usize,
    points: Places,
    normals: Places,
    /// See [`Self::inward()`], in units of a radius / [`INWARD`].
    inward: [[i8; 3]; SURFACE_POINTS],
    blocks: Boxes,
    /// Boxes around the runs of points within the blocks.
    runs: [Corners; RUNS],
    /// Share of the cloud's points that were left out as outliers.
    pub(crate) left_out: f32,
    /// Radius of a neighbourhood: the median one has 24 points besides its centre; more where 24 are all noise.
    pub(crate) radius: f32,
}

impl Surface {
    /// A surface without points. All bits are zero, so that a static one takes no room in a program's file.
    pub(crate) const EMPTY: Surface = Surface {
        len: 0,
        points: [[0.0; 3]; SURFACE_POINTS + 1],
        normals: [[0.0; 3]; SURFACE_POINTS + 1],
        inward: [[0; 3]; SURFACE_POINTS],
        blocks: Boxes::ZERO,
        runs: [[[0.0; 3]; 2]; RUNS],
        left_out: 0.0,
        radius: 0.0,
    };

    /// The points, in spatial order.
    pub(crate) fn points(&self) -> &[[f32; 3]] {
        self.points.get(..self.len).unwrap_or(&[])
    }

    /// Point and normal at a place; zero beyond the last.
    pub(crate) fn at(&self, place: usize) -> (Vec3, Vec3) {
        match (self.points.get(place), self.normals.get(place)) {
            (Some(&point), Some(&normal)) => (Vec3::from_array(point), Vec3::from_array(normal)),
            _ => (Vec3::ZERO, Vec3::ZERO),
        }
    }

    /// Points and normals in the form that kernels take. Places beyond the last hold leftovers.
    pub(crate) fn bare(&self) -> OrientedPoints<'_> {
        OrientedPoints {
            points: &self.points,
            normals: &self.normals,
        }
    }

    /// Offset from a point to the mean of the neighbours that gave its normal, along the surface, in units of those
    /// neighbourhoods' radius: about 0 inside a surface, and .34 at its edge.
    pub(crate) fn inward(&self, place: usize) -> Vec3 {
        let parts = self.inward.get(place).copied().unwrap_or_default();
        Vec3::from_array(parts.map(f32::from)) * (1.0 / INWARD)
    }

    /// Takes the distinct points of a cloud's bulk as `(point - centre) * factor`, evenly thinned to the capacity, and
    /// estimates their normals.
    pub(crate) fn fill(
        &mut self,
        isa: Isa,
        cloud: &[[f32; 3]],
        bulk: Bulk,
        centre: Vec3,
        factor: f32,
        keys: &mut Keys,
    ) {
        let n = cloud.len().min(SURFACE_POINTS);
        let at = |i: usize| cloud.get(i * cloud.len() / n.max(1)).copied();
        let at = |i: usize| at(i).unwrap_or_default();
        let seen = |i: usize| (Vec3::from_array(at(i)) - centre) * factor;
        let kept = (0..n).filter(|&i| bulk.holds(at(i)));
        let mut count = 0;
        for (place, i) in self.points.iter_mut().zip(kept) {
            *place = seen(i).to_array();
            count += 1;
        }
        self.left_out = (n - count) as f32 / n.max(1) as f32;
        self.len = put_in_order(self.points.get_mut(..count).unwrap_or(&mut []));
        self.enclose();
        self.radius = self.neighbourhood(keys);
        self.estimate_normals(isa, keys);
    }

    /// Negates x; doing it twice restores the surface to the bit.
    pub(crate) fn mirror(&mut self) {
        let vectors = self.points.iter_mut().chain(&mut self.normals);
        vectors.for_each(|[x, _, _]| *x = -*x);
        self.inward.iter_mut().for_each(|[x, _, _]| *x = -*x);
        self.mirror_boxes();
    }

    /// Principal axes of the points about the origin.
    pub(crate) fn axes(&self) -> Mat3 {
        let mut sums = [0.0f32; 6];
        for &[x, y, z] in self.points() {
            let products = [x * x, y * y, z * z, x * y, x * z, y * z];
            sums.iter_mut()
                .zip(products)
                .for_each(|(sum, product)| *sum += product);
        }
        principal_axes(sums)
    }

    /// Median distance of the points from their middle, the median of each coordinate. Some points of another object far away
    /// do not change this size.
    pub(crate) fn extent(&self, keys: &mut Keys) -> f32 {
        let middle = [0, 1, 2].map(|axis: usize| {
            for (key, p) in keys.0.iter_mut().zip(self.points()) {
                *key = ordered(p.get(axis).copied().unwrap_or_default());
            }
            unordered(keys.select_key(self.len, self.len / 2))
        });
        let middle = Vec3::from_array(middle);
        for (key, &p) in keys.0.iter_mut().zip(self.points()) {
            *key = (Vec3::from_array(p) - middle).length_squared().to_bits();
        }
        libm::sqrtf(keys.select(self.len, self.len / 2))
    }
}

#[cfg(test)]
mod tests;
