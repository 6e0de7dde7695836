//! Rigid transforms, and the disentangled form in which the policy accumulates them.
//!
//! This module alone fixes the order of composition. A disentangled pose rotates the source
//! about its own centroid `μ`, `x' = R (x - μ) + μ + t`, so a rotation step does not shift
//! the source and a translation step does not rotate it (paper, eqs. 8, 9 and to-global).

use crate::error::Error;
use glam::{Mat3, Vec3};

/// Largest translation accepted: nothing measured is farther away, and the squares of much larger ones overflow.
const LARGEST_TRANSLATION: f32 = 1e12;

/// A rotation and a translation. The name of the variable says whether they
/// form a plain rigid transform (`x' = R x + t`) or a disentangled one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation matrix, column vectors.
    pub rotation: Mat3,
    /// Translation, in the cloud's units.
    pub translation: Vec3,
}

impl Pose {
    /// The identity transform.
    pub const IDENTITY: Pose = Pose {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
    };

    /// Plain application, `x' = R x + t`.
    pub fn apply(&self, point: Vec3) -> Vec3 {
        self.rotation * point + self.translation
    }

    /// Accumulates one step, equation 8: `R_i = R̂_i R_{i-1}`, `t_i = t̂_i + t_{i-1}` (global disentangled).
    pub fn accumulate(&self, update: Pose) -> Pose {
        Pose {
            rotation: update.rotation * self.rotation,
            translation: update.translation + self.translation,
        }
    }

    /// Plain composition: `self` after `first`.
    pub fn after(&self, first: Pose) -> Pose {
        Pose {
            rotation: self.rotation * first.rotation,
            translation: self.rotation * first.translation + self.translation,
        }
    }

    /// Angle between the rotations of two poses, radians.
    pub fn angle_to(&self, other: &Pose) -> f32 {
        let turn = self.rotation * other.rotation.transpose();
        let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
        libm::acosf((0.5 * (trace - 1.0)).clamp(-1.0, 1.0))
    }

    /// Inverse of a plain rigid transform.
    pub fn inverse(&self) -> Pose {
        let rotation = self.rotation.transpose();
        Pose {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// Converts a plain pose to one disentangled about `centroid`: `t_d = t - μ + R μ`.
    pub fn to_disentangled(&self, centroid: Vec3) -> Pose {
        Pose {
            rotation: self.rotation,
            translation: self.translation - centroid + self.rotation * centroid,
        }
    }

    /// Converts a pose disentangled about `centroid` to a plain one: `t = t_d + μ - R μ`.
    pub fn to_global(&self, centroid: Vec3) -> Pose {
        Pose {
            rotation: self.rotation,
            translation: self.translation + centroid - self.rotation * centroid,
        }
    }

    /// Rows of the 3x4 matrix `[R | t]`.
    pub fn to_rows(&self) -> [[f32; 4]; 3] {
        let (r, t) = (self.rotation.transpose(), self.translation);
        [
            [r.x_axis.x, r.x_axis.y, r.x_axis.z, t.x],
            [r.y_axis.x, r.y_axis.y, r.y_axis.z, t.y],
            [r.z_axis.x, r.z_axis.y, r.z_axis.z, t.z],
        ]
    }

    /// The pose with these rows of a 3x4 matrix `[R | t]`, unchecked.
    pub fn from_rows(rows: [[f32; 4]; 3]) -> Pose {
        let [a, b, c] = rows;
        Pose {
            rotation: Mat3::from_cols(
                Vec3::new(a[0], b[0], c[0]),
                Vec3::new(a[1], b[1], c[1]),
                Vec3::new(a[2], b[2], c[2]),
            ),
            translation: Vec3::new(a[3], b[3], c[3]),
        }
    }

    /// Refuses anything but a rigid transform (`RᵀR = 1` to 1e-3, determinant +1) that keeps measured coordinates finite.
    pub fn checked(self) -> Result<Pose, Error> {
        let gram = self.rotation.transpose() * self.rotation;
        let rigid = gram.abs_diff_eq(Mat3::IDENTITY, 1e-3) && self.rotation.determinant() > 0.0;
        let near = self
            .translation
            .to_array()
            .iter()
            .all(|x| x.abs() <= LARGEST_TRANSLATION);
        if rigid && near {
            Ok(self)
        } else {
            Err(Error::BadPose)
        }
    }
}

/// Mean of the points, summed in f64 in order. Zero for an empty slice.
pub fn centroid(points: &[[f32; 3]]) -> Vec3 {
    mean(points.iter().copied())
}

/// As [`centroid`], over an iterator.
pub(crate) fn mean(points: impl Iterator<Item = [f32; 3]>) -> Vec3 {
    let (mut sum, mut count) = ([0.0f64; 3], 0u32);
    for point in points {
        for (s, x) in sum.iter_mut().zip(point) {
            *s += f64::from(x);
        }
        count += 1;
    }
    let n = f64::from(count.max(1));
    Vec3::from_array(sum.map(|s| (s / n) as f32))
}

/// Rotation from intrinsic XYZ Euler angles in radians, `Rx(a)·Ry(b)·Rz(c)`.
pub fn rotation_from_euler(angles_rad: Vec3) -> Mat3 {
    let [(sa, ca), (sb, cb), (sc, cc)] = angles_rad.to_array().map(libm::sincosf);
    rotation_xyz(sa, ca, sb, cb, sc, cc)
}

/// Intrinsic XYZ Euler angles in radians of `Rx(a)·Ry(b)·Rz(c)`. The sine is clamped to [-1, 1], so
/// that rounding at gimbal lock cannot give NaN (the authors' code does not clamp).
pub fn euler_from_rotation(rotation: &Mat3) -> Vec3 {
    let (x, y, z) = (rotation.x_axis, rotation.y_axis, rotation.z_axis);
    Vec3::new(
        libm::atan2f(-z.y, z.z),
        libm::asinf(z.x.clamp(-1.0, 1.0)),
        libm::atan2f(-y.x, x.x),
    )
}

/// `Rx(a)·Ry(b)·Rz(c)` written out, from sines and cosines.
pub(crate) fn rotation_xyz(sa: f32, ca: f32, sb: f32, cb: f32, sc: f32, cc: f32) -> Mat3 {
    Mat3::from_cols(
        Vec3::new(cb * cc, ca * sc + sa * sb * cc, sa * sc - ca * sb * cc),
        Vec3::new(-cb * sc, ca * cc - sa * sb * sc, sa * cc + ca * sb * sc),
        Vec3::new(sb, -sa * cb, ca * cb),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Pose {
        Pose {
            rotation: rotation_from_euler(Vec3::new(0.3, -0.7, 1.1)),
            translation: Vec3::new(0.2, -0.4, 0.6),
        }
    }

    #[test]
    fn the_angle_between_poses_is_that_of_the_turn_between_them() {
        let pose = sample();
        for angle in [0.0f32, 0.2, 1.5, 3.0] {
            let turn = Mat3::from_axis_angle(Vec3::new(2.0, -1.0, 2.0) / 3.0, angle);
            let turned = Pose {
                rotation: turn * pose.rotation,
                translation: Vec3::ONE,
            };
            assert!((turned.angle_to(&pose) - angle).abs() < 1e-3, "{angle}");
            assert!((pose.angle_to(&turned) - angle).abs() < 1e-3, "{angle}");
        }
    }

    #[test]
    fn disentangled_and_global_agree_on_points() {
        let (pose, mu, x) = (
            sample(),
            Vec3::new(3.0, -2.0, 1.0),
            Vec3::new(0.1, 0.2, 0.3),
        );
        let about = pose.rotation * (x - mu) + mu + pose.translation;
        assert!((pose.to_global(mu).apply(x) - about).length() < 1e-5);
        let back = pose.to_global(mu).to_disentangled(mu);
        assert!((back.translation - pose.translation).length() < 1e-5);
    }

    #[test]
    fn inverse_undoes_and_rows_round_trip() {
        let pose = sample();
        let x = Vec3::new(0.5, 0.6, -0.7);
        assert!((pose.inverse().apply(pose.apply(x)) - x).length() < 1e-6);
        assert_eq!(Pose::from_rows(pose.to_rows()), pose);
    }

    #[test]
    fn a_pose_that_is_not_rigid_is_refused() {
        assert!(sample().checked().is_ok());
        let mut mirrored = sample();
        mirrored.rotation.x_axis *= -1.0;
        assert_eq!(mirrored.checked(), Err(Error::BadPose));
        let mut nan = sample();
        nan.translation.y = f32::NAN;
        assert_eq!(nan.checked(), Err(Error::BadPose));
    }

    #[test]
    fn gimbal_lock_gives_no_nan() {
        let mut m = Mat3::IDENTITY;
        m.z_axis.x = 1.000_000_1;
        assert!(euler_from_rotation(&m).is_finite());
    }
}
