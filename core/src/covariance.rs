//! How uncertain a refined pose is.
//!
//! The distances between planes that are left under the pose are what noise and sampling leave; their normal equations
//! say how far the pose may move until they grow by as much (the covariance of weighted least squares, `σ² (JᵀWJ)⁻¹`). Where noise
//! is a part of the distance between neighbours, the planes fitted to these are off, too, and the covariance grows by that. Where noise
//! is as large as that distance, planes cannot be fitted, and errors are larger than it says.

use crate::solve::NormalEquations;
use glam::Vec3;

/// How many residuals say as much as one independent one: each pair of neighbours is seen from both clouds, and the
/// planes of neighbours are fitted to the same points. Fitted on pairs drawn from built-in shapes.
const REPEATED: f64 = 3.0;
/// Noise below which coordinates in f32 do not tell, target radii.
const LEAST_NOISE: f64 = 1e-5;
/// Standard deviations of what the clouds leave open: any turn, and a radius of the target.
const OPEN_TURN: f64 = core::f64::consts::PI;
const OPEN_SHIFT: f64 = 1.0;

/// Covariance of a pose's error `(ω, v)`, a rotation vector in radians and then a translation in the clouds' units, both along
/// the target's axes. It perturbs from the left, about a point near the target's centroid: if `x` is where the pose puts a
/// point, the truth puts it at `about + exp(ω) (x - about) + v`.
///
/// What the shape leaves open has a standard deviation of up to π, and of up to one target radius; where it was looked how far, that of
/// any place in between alike. Other poses that fit as well
/// ([`crate::verify::Undetermined::poses`]) are not in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance {
    /// The target's centroid; if a turn about an axis is open, the point of that axis nearest to it.
    pub about: Vec3,
    /// The target's radius, in the clouds' units.
    pub radius: f32,
    /// Symmetric, rotation first.
    pub matrix: [[f32; 6]; 6],
    /// See [`Covariance::shift_deviation`].
    by_planes: f32,
}

impl Covariance {
    /// Of equations of planes and the mean of their squared residuals, both in target radii about the target's centroid, and by
    /// how much the planes' own errors raise the variance.
    pub(crate) fn of(
        equations: &NormalEquations,
        [variance, raised]: [f64; 2],
        about: Vec3,
        radius: f32,
    ) -> Covariance {
        let variance = variance.max(LEAST_NOISE * LEAST_NOISE);
        let exact = Covariance::of_planes(equations, variance, about, radius);
        Covariance {
            by_planes: exact.by_planes,
            ..Covariance::of_planes(equations, variance * raised, about, radius)
        }
    }

    // Called twice: two frames of it would not fit on a board's stack.
    #[inline(never)]
    fn of_planes(
        equations: &NormalEquations,
        variance: f64,
        about: Vec3,
        radius: f32,
    ) -> Covariance {
        let [turn, shift] = [OPEN_TURN, OPEN_SHIFT].map(|deviation| 1.0 / (deviation * deviation));
        let weights = [turn, turn, turn, shift, shift, shift];
        let mut matrix = equations.inverse(1.0 / (REPEATED * variance), weights);
        for (i, row) in matrix.iter_mut().enumerate() {
            for (j, x) in row.iter_mut().enumerate() {
                let lengths = u8::from(i >= 3) + u8::from(j >= 3);
                (0..lengths).for_each(|_| *x *= radius);
            }
        }
        let shifts = matrix.iter().enumerate().skip(3);
        let variances = shifts.filter_map(|(i, row)| row.get(i));
        Covariance {
            about,
            radius,
            matrix,
            by_planes: libm::sqrtf(variances.sum::<f32>()) / radius,
        }
    }

    /// States the same uncertainty about another point.
    pub(crate) fn move_to(&mut self, about: Vec3) {
        let r = about - self.about;
        // The translation there is v + ω × r.
        let moved = |[a, b, c, d, e, f]: [f32; 6]| -> [f32; 6] {
            let v = Vec3::new(d, e, f) + Vec3::new(a, b, c).cross(r);
            [a, b, c, v.x, v.y, v.z]
        };
        let transposed = |rows: [[f32; 6]; 6]| -> [[f32; 6]; 6] {
            core::array::from_fn(|i| rows.map(|row| row.get(i).copied().unwrap_or(0.0)))
        };
        self.matrix = transposed(transposed(self.matrix.map(moved)).map(moved));
        self.about = about;
    }

    /// Takes in that a turn about an axis is open, between two angles, radians.
    pub(crate) fn open_turn(&mut self, axis: Vec3, range_rad: [f32; 2]) {
        self.open(0, axis, mean_square(range_rad));
    }

    /// Takes in that a shift along a direction is open, between two.
    pub(crate) fn open_shift(&mut self, direction: Vec3, range: [f32; 2]) {
        self.open(3, direction, mean_square(range));
    }

    /// Makes a variance that large at least, of three rows from the first.
    fn open(&mut self, first: usize, direction: Vec3, variance: f32) {
        let direction = direction.to_array();
        let mut held = 0.0;
        for (row, a) in self.matrix.iter().skip(first).zip(direction) {
            for (x, b) in row.iter().skip(first).zip(direction) {
                held += a * b * x;
            }
        }
        let more = (variance - held).max(0.0);
        for (row, a) in self.matrix.iter_mut().skip(first).zip(direction) {
            for (x, b) in row.iter_mut().skip(first).zip(direction) {
                *x += a * b * more;
            }
        }
    }

    /// Standard deviation of the translation in all directions together, target radii, by the planes alone: as if these were
    /// exact, and nothing else were open.
    pub fn shift_deviation(&self) -> f32 {
        self.by_planes
    }
}

/// Of all between two numbers.
fn mean_square([least, most]: [f32; 2]) -> f32 {
    (least * least + least * most + most * most) / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::tests::Numbers;
    use crate::polish::{Refiner, Workspace};
    use crate::pose::Pose;

    fn found(source: &[[f32; 3]], target: &[[f32; 3]]) -> Covariance {
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(source, target, &mut workspace).expect("valid clouds");
        refiner.polish(Pose::IDENTITY).expect("rigid").covariance
    }

    #[test]
    fn what_is_open_is_large_and_finite() {
        // A plane: two shifts and a turn are open.
        let mut numbers = Numbers(5);
        let mut plane = || -> Vec<[f32; 3]> {
            let point = |_| [numbers.next(), numbers.next(), 0.0];
            (0..600).map(point).collect()
        };
        let (source, target) = (plane(), plane());
        let covariance = found(&source, &target);
        let deviation = |i: usize| covariance.matrix[i][i].sqrt();
        let all: Vec<f32> = (0..6).map(deviation).collect();
        assert!(all[2] > 1.0 && all[3] > 0.5 && all[4] > 0.5, "{all:?}");
        assert!(all[0] < 0.01 && all[1] < 0.01 && all[5] < 0.01, "{all:?}");
        assert!(
            covariance
                .matrix
                .as_flattened()
                .iter()
                .all(|x| x.is_finite())
        );
        let transposed = |i: usize, j: usize| covariance.matrix[j][i];
        assert!((0..36).all(|k| covariance.matrix[k / 6][k % 6] == transposed(k / 6, k % 6)));
    }

    #[test]
    fn what_is_open_is_taken_in_along_its_direction_alone() {
        let diagonal = |i: usize, j: usize| if i == j { 1e-4 } else { 0.0 };
        let mut covariance = Covariance {
            about: Vec3::ZERO,
            radius: 2.0,
            matrix: core::array::from_fn(|i| core::array::from_fn(|j| diagonal(i, j))),
            by_planes: 0.0,
        };
        let (along, across) = (Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.8, 0.6, 0.0));
        covariance.open_turn(Vec3::Z, [-0.3, 0.3]);
        covariance.open_shift(along, [-0.1, 0.5]);
        // Less than what is there changes nothing.
        covariance.open_shift(along, [0.0, 0.01]);
        let variance = |first: usize, direction: Vec3| -> f32 {
            let d = direction.to_array();
            let of =
                |k: usize| d[k / 3] * d[k % 3] * covariance.matrix[first + k / 3][first + k % 3];
            (0..9).map(of).sum()
        };
        let close = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert!(close(variance(0, Vec3::Z), 0.03) && close(variance(0, Vec3::X), 1e-4));
        assert!(close(variance(3, along), 0.07) && close(variance(3, across), 1e-4));
    }
}
