//! Small solvers: the normal equations of a rigid motion, and principal axes.

#![allow(clippy::indexing_slicing, reason = "loops over six unknowns")]

use crate::kernels::Sums;
use crate::pose::Pose;
use crate::rotation::Rotation;
use glam::{Mat3, Vec3};

/// Second moments `[xx, yy, zz, xy, xz, yz]`.
pub(crate) type Spread = [f32; 6];

/// Unit eigenvector of the smallest eigenvalue of a positive semidefinite spread; zero if it is not unique.
pub(crate) fn smallest_direction(spread: Spread) -> Vec3 {
    least(spread).0
}

/// [`smallest_direction`], and its eigenvalue as a share of the trace.
pub(crate) fn least([xx, yy, zz, xy, xz, yz]: Spread) -> (Vec3, f32) {
    let trace = xx + yy + zz;
    if trace.is_nan() || trace <= 1e-30 {
        return (Vec3::ZERO, 0.0);
    }
    let f = 1.0 / trace;
    let [xx, yy, zz, xy, xz, yz] = [xx, yy, zz, xy, xz, yz].map(|x| x * f);
    // p(λ) = λ³ - λ² + c λ - d has three roots in [0, 1]; from 0, Newton's method climbs to the lowest.
    let c = xx * yy + xx * zz + yy * zz - xy * xy - xz * xz - yz * yz;
    let d = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    let mut root = 0.0f32;
    for _ in 0..8 {
        let value = ((root - 1.0) * root + c) * root - d;
        let slope = (3.0 * root - 2.0) * root + c;
        if slope > 1e-9 && value < 0.0 {
            // The lowest root is at most 1/3; if all three are about equal, rounding may lead beyond.
            root = (root - value / slope).min(1.0 / 3.0);
        }
    }
    let a = Vec3::new(xx - root, xy, xz);
    let b = Vec3::new(xy, yy - root, yz);
    let e = Vec3::new(xz, yz, zz - root);
    let candidates = [a.cross(b), a.cross(e), b.cross(e)];
    let mut best = (1e-9f32, Vec3::ZERO);
    for v in candidates {
        let squared = v.length_squared();
        if squared > best.0 {
            best = (squared, v * (1.0 / libm::sqrtf(squared)));
        }
    }
    (best.1, root)
}

/// Principal axes of a spread as the columns of a rotation; the last is that of the smallest spread.
pub(crate) fn principal_axes(spread: Spread) -> Mat3 {
    let last = smallest_direction(spread);
    let last = if last == Vec3::ZERO { Vec3::Z } else { last };
    let (u, v) = last.any_orthonormal_pair();
    // The other two axes follow in closed form within their plane.
    let rows = symmetric(spread);
    let (uu, uv, vv) = (u.dot(rows * u), u.dot(rows * v), v.dot(rows * v));
    let (sine, cosine) = libm::sincosf(0.5 * libm::atan2f(2.0 * uv, uu - vv));
    let first = u * cosine + v * sine;
    Mat3::from_cols(first, last.cross(first), last)
}

/// The matrix of second moments.
fn symmetric([xx, yy, zz, xy, xz, yz]: Spread) -> Mat3 {
    Mat3::from_cols(
        Vec3::new(xx, xy, xz),
        Vec3::new(xy, yy, yz),
        Vec3::new(xz, yz, zz),
    )
}

/// Share of its trace added to a matrix of shifts, which is singular for a plane.
const LOOSE: f32 = 1e-3;
/// Damping that keeps a singular matrix positive despite rounding.
const ROUNDING: f64 = 1e-15;

/// Normal equations of a small rigid motion `x -> x + ω × x + v`; unknowns `ω`, then `v`.
#[derive(Clone, Debug)]
pub(crate) struct NormalEquations {
    /// Lower triangle of the matrix, by rows.
    a: [f64; 21],
    b: [f64; 6],
}

impl NormalEquations {
    /// Empty equations.
    pub(crate) const ZERO: NormalEquations = NormalEquations {
        a: [0.0; 21],
        b: [0.0; 6],
    };

    /// Adds a residual's term to the matrix: the motion of the point `at` along `direction`.
    pub(crate) fn add(&mut self, at: Vec3, direction: Vec3, weight: f32) {
        self.add_row([at.cross(direction), direction], f64::from(weight));
    }

    /// Suppresses a motion, given as a turn and a shift: adds it to the matrix, weighted with the trace.
    pub(crate) fn hold(&mut self, motion: [Vec3; 2]) {
        let trace: f64 = [0, 2, 5, 9, 14, 20]
            .iter()
            .map(|&k: &usize| self.a[k])
            .sum();
        self.add_row(motion, trace);
    }

    fn add_row(&mut self, [turn, shift]: [Vec3; 2], weight: f64) {
        let mut row = [0.0; 6];
        let parts = turn.to_array().into_iter().chain(shift.to_array());
        for (place, x) in row.iter_mut().zip(parts) {
            *place = f64::from(x);
        }
        let mut k = 0;
        for i in 0..6 {
            for j in 0..=i {
                self.a[k] += weight * row[i] * row[j];
                k += 1;
            }
        }
    }

    /// The equations of sums over lanes.
    pub(crate) fn of(sums: &Sums) -> NormalEquations {
        let mut totals = sums.0.iter().map(|row| {
            let (mut even, mut odd) = (0.0f64, 0.0f64);
            for pair in row.as_chunks::<2>().0 {
                even += f64::from(pair[0]);
                odd += f64::from(pair[1]);
            }
            even + odd
        });
        NormalEquations {
            a: core::array::from_fn(|_| totals.next().unwrap_or(0.0)),
            b: core::array::from_fn(|_| totals.next().unwrap_or(0.0)),
        }
    }

    /// The matrix's rotation block.
    pub(crate) fn turning(&self) -> Spread {
        [0, 2, 5, 1, 3, 4].map(|k| self.a[k] as f32)
    }

    /// The matrix's translation block.
    pub(crate) fn shifting(&self) -> Spread {
        [9, 14, 20, 13, 18, 19].map(|k| self.a[k] as f32)
    }

    /// The matrix of turns alone, each with the shift that suits it best (the Schur complement), and the map from a turn to that
    /// shift.
    pub(crate) fn free_turning(&self) -> (Spread, Mat3) {
        // The block of three rows of shifts and three columns of turns, column by column.
        let mixed = [6, 10, 15, 7, 11, 16, 8, 12, 17].map(|k: usize| self.a[k] as f32);
        let mixed = Mat3::from_cols_array(&mixed);
        let [turns, shifts] = [self.turning(), self.shifting()].map(symmetric);
        let [xx, yy, zz, ..] = self.shifting();
        let damping = Mat3::from_diagonal(Vec3::splat(LOOSE * (xx + yy + zz)));
        let inverse = (shifts + damping).inverse();
        let shift_of = if inverse.is_finite() {
            -(inverse * mixed)
        } else {
            Mat3::ZERO
        };
        let Mat3 {
            x_axis: x,
            y_axis: y,
            z_axis: z,
        } = turns + mixed.transpose() * shift_of;
        let diagonal = [x.x, y.y, z.z].map(|x| x.max(0.0));
        let [xx, yy, zz] = diagonal;
        ([xx, yy, zz, x.y, x.z, y.z], shift_of)
    }

    /// Inverse of `factor * A + diag(diagonal)` for a positive diagonal;
    /// of the diagonal alone if far points made `A` too large.
    pub(crate) fn inverse(&self, factor: f64, diagonal: [f64; 6]) -> [[f32; 6]; 6] {
        let mut motion = self.clone();
        // Thousands of pairs within a few units stay below this.
        let sound = motion.a.iter().all(|x| x.abs() < 1e6);
        motion.a = motion.a.map(|x| if sound { x * factor } else { 0.0 });
        let mut k = 0;
        for (i, x) in diagonal.into_iter().enumerate() {
            motion.a[k + i] += x;
            k += i + 1;
        }
        let columns: [[f32; 6]; 6] = core::array::from_fn(|i| {
            motion.b = [0.0; 6];
            motion.b[i] = 1.0;
            let (rotation_vector, shift) = motion.solve(ROUNDING);
            let ([a, b, c], [d, e, f]) = (rotation_vector.to_array(), shift.to_array());
            [a, b, c, d, e, f]
        });
        // Makes the inverse symmetric to the bit.
        core::array::from_fn(|i| core::array::from_fn(|j| columns[i.max(j)][i.min(j)]))
    }

    /// Solves for the rotation vector and the shift, damped by a share of the trace; zeros if the trace is not positive.
    pub(crate) fn solve(&self, damping: f64) -> (Vec3, Vec3) {
        let mut l = [[0.0f64; 6]; 6];
        let mut k = 0;
        for (i, row) in l.iter_mut().enumerate() {
            row[..=i].copy_from_slice(&self.a[k..=k + i]);
            k += i + 1;
        }
        let trace: f64 = (0..6).map(|i| l[i][i]).sum();
        if trace.is_nan() || trace <= 0.0 {
            return (Vec3::ZERO, Vec3::ZERO);
        }
        let ridge = trace * damping;
        // Cholesky factorisation in place, then both substitutions.
        for i in 0..6 {
            for j in 0..=i {
                let done: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let rest = l[i][j] - done;
                l[i][j] = if i == j {
                    libm::sqrt((rest + ridge).max(ridge))
                } else {
                    rest / l[j][j]
                };
            }
        }
        let mut x = self.b;
        for i in 0..6 {
            let done: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
            x[i] = (x[i] - done) / l[i][i];
        }
        for i in (0..6).rev() {
            let done: f64 = (i + 1..6).map(|k| l[k][i] * x[k]).sum();
            x[i] = (x[i] - done) / l[i][i];
        }
        let [a, b, c, d, e, f] = x.map(|x| x as f32);
        (Vec3::new(a, b, c), Vec3::new(d, e, f))
    }
}

/// A rigid transform `x' = R x + t` whose rotation stays one under rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rigid {
    pub(crate) rotation: Rotation,
    pub(crate) shift: Vec3,
}

impl Rigid {
    pub(crate) fn new(rotation: Mat3, shift: Vec3) -> Rigid {
        Rigid {
            rotation: Rotation::of(&rotation),
            shift,
        }
    }

    pub(crate) fn pose(&self) -> Pose {
        Pose {
            rotation: self.rotation.matrix(),
            translation: self.shift,
        }
    }

    /// The transform followed by a rotation about the target's centre, which is the origin.
    pub(crate) fn turned(&self, by: Rotation) -> Rigid {
        Rigid {
            rotation: by.after(self.rotation),
            shift: by.matrix() * self.shift,
        }
    }

    /// The transform followed by a rotation about a point.
    pub(crate) fn turned_about(&self, point: Vec3, by: Rotation) -> Rigid {
        Rigid {
            rotation: by.after(self.rotation),
            shift: by.matrix() * (self.shift - point) + point,
        }
    }

    /// Where the target's centre lies in the source's frame.
    pub(crate) fn centre(&self) -> Vec3 {
        -(self.rotation.matrix().transpose() * self.shift)
    }

    /// The transform followed by a small rotation (first order, at most half a radian) and shift (at most half a unit).
    pub(crate) fn moved(&self, rotation_vector: Vec3, shift: Vec3) -> Rigid {
        let half = rotation_vector.clamp_length_max(0.5) * 0.5;
        let by = Rotation::new(half, 1.0);
        Rigid {
            rotation: by.after(self.rotation),
            shift: by.matrix() * self.shift + shift.clamp_length_max(0.5),
        }
    }
}
