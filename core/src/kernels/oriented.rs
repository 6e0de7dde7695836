//! Points with normals, in the form that kernels take.

use super::lanes::{LANES, Lanes, Places, Row, Vectors};

/// Points and their normals, one row for each axis.
#[derive(Clone, Copy, Debug)]
pub struct Oriented {
    /// The points.
    pub points: [Row; 3],
    /// Their normals.
    pub normals: [Row; 3],
}

impl Oriented {
    /// Zeros. All bits are zero.
    pub const ZERO: Oriented = Oriented {
        points: [[0.0; LANES]; 3],
        normals: [[0.0; LANES]; 3],
    };
}

/// A surface's points and normals, by place.
#[derive(Clone, Copy, Debug)]
pub struct OrientedPoints<'a> {
    /// The points.
    pub points: &'a Places,
    /// Their normals.
    pub normals: &'a Places,
}

impl OrientedPoints<'_> {
    /// Points and normals at some places.
    #[inline(always)]
    pub(super) fn gather<L: Lanes>(&self, places: &[u16; LANES], first: usize) -> [Vectors<L>; 2] {
        [
            L::gather(self.points, places, first),
            L::gather(self.normals, places, first),
        ]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::dims::SURFACE_POINTS;
    use crate::polish::tests::Numbers;
    use glam::Vec3;

    /// Random points with random unit normals.
    pub(in crate::kernels) struct Cloud(Box<[Places; 2]>);

    impl Cloud {
        pub(in crate::kernels) fn drawn(seed: u32) -> Cloud {
            let mut numbers = Numbers(seed);
            let mut cloud = Cloud(Box::new([[[0.0; 3]; SURFACE_POINTS + 1]; 2]));
            let [points, normals] = &mut *cloud.0;
            for (point, normal) in points.iter_mut().zip(normals) {
                *point = numbers.point();
                *normal = Vec3::from(numbers.point()).normalize_or(Vec3::X).to_array();
            }
            cloud
        }

        pub(in crate::kernels) fn bare(&self) -> OrientedPoints<'_> {
            let [points, normals] = &*self.0;
            OrientedPoints { points, normals }
        }

        pub(in crate::kernels) fn at(&self, place: u16) -> (Vec3, Vec3) {
            let [point, normal] = [0, 1].map(|k: usize| self.0[k][usize::from(place)]);
            (point.into(), normal.into())
        }

        /// The first points, in lanes.
        pub(in crate::kernels) fn sample(&self, count: usize) -> Vec<Oriented> {
            let mut lanes = vec![Oriented::ZERO; count.div_ceil(LANES)];
            for place in 0..count {
                let (point, normal) = self.at(place as u16);
                let Oriented { points, normals } = &mut lanes[place / LANES];
                for axis in 0..3 {
                    points[axis][place % LANES] = point[axis];
                    normals[axis][place % LANES] = normal[axis];
                }
            }
            lanes
        }
    }
}
