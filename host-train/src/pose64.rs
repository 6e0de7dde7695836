//! Poses and coordinates in the files' own units, in f64.
//!
//! The core computes in f32, which resolves only half a metre at 5,000 km. Clouds far from the origin of their
//! coordinates are therefore registered relative to an origin of their own, which is subtracted and added back in f64.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use reagent_core::{Error, Pose};
use std::fmt;

/// A point in a file's own units.
pub type Position = [f64; 3];

/// A plain rigid transform, `x' = R x + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose64 {
    /// Rotation matrix.
    pub rotation: Matrix3<f64>,
    /// Translation, in the cloud's units.
    pub translation: Vector3<f64>,
}

impl Pose64 {
    /// The transform that changes nothing.
    pub const IDENTITY: Pose64 = Pose64 {
        rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        translation: Vector3::new(0.0, 0.0, 0.0),
    };

    /// From the rows of a 3x4 matrix `[R | t]`, unchecked.
    pub fn from_rows([a, b, c]: [[f64; 4]; 3]) -> Pose64 {
        Pose64 {
            rotation: Matrix3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]),
            translation: Vector3::new(a[3], b[3], c[3]),
        }
    }

    /// Rows of the 3x4 matrix `[R | t]`.
    pub fn to_rows(&self) -> [[f64; 4]; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        [0, 1, 2].map(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]])
    }

    /// Refuses anything but a finite rigid transform (`RᵀR = 1` to 1e-3, determinant +1), as the core does.
    ///
    /// # Errors
    /// [`Error::BadPose`].
    pub fn checked(self) -> Result<Pose64, Error> {
        let gram = self.rotation.transpose() * self.rotation - Matrix3::identity();
        let rigid = gram.amax() <= 1e-3 && self.rotation.determinant() > 0.0;
        if rigid && self.translation.iter().all(|x| x.is_finite()) {
            Ok(self)
        } else {
            Err(Error::BadPose)
        }
    }

    /// The point after the transform.
    pub fn apply(&self, point: Position) -> Position {
        (self.rotation * Vector3::from(point) + self.translation).into()
    }

    /// The pose between the files' coordinates, given the pose between coordinates relative to two origins: `t = t' +
    /// o_target - R o_source`. The rotation is made orthonormal in f64.
    pub fn of(
        target_from_source: Pose,
        source_origin: Position,
        target_origin: Position,
    ) -> Pose64 {
        let rows = target_from_source.to_rows().map(|row| row.map(f64::from));
        let near = Pose64::from_rows(rows);
        near.about(source_origin, target_origin)
    }

    /// As [`Pose64::of`], for a pose in f64.
    pub fn about(&self, source_origin: Position, target_origin: Position) -> Pose64 {
        let turn = Rotation3::from_matrix_unchecked(self.rotation);
        let turn = UnitQuaternion::from_rotation_matrix(&turn).into_inner();
        let rotation = UnitQuaternion::new_normalize(turn)
            .to_rotation_matrix()
            .into_inner();
        Pose64 {
            rotation,
            translation: self.translation + Vector3::from(target_origin)
                - rotation * Vector3::from(source_origin),
        }
    }

    /// The pose between coordinates relative to two origins, in f32: the inverse of [`Pose64::of`].
    pub fn near(&self, source_origin: Position, target_origin: Position) -> Pose {
        let translation = self.translation - Vector3::from(target_origin)
            + self.rotation * Vector3::from(source_origin);
        let near = Pose64 {
            translation,
            ..*self
        };
        Pose::from_rows(near.to_rows().map(|row| row.map(|x| x as f32)))
    }
}

/// Rows of `[R | t]`, with as many digits as a translation at 5,000 km needs.
impl fmt::Display for Pose64 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, [a, b, c, t]) in self.to_rows().into_iter().enumerate() {
            let end = if i < 2 { "\n" } else { "" };
            write!(f, "{a:17.14} {b:17.14} {c:17.14} {:>20}{end}", shown(t))?;
        }
        Ok(())
    }
}

/// Formats a length with fifteen significant digits, but none beyond a billionth.
fn shown(length: f64) -> String {
    let before = length.abs().max(1e-300).log10().floor().max(0.0) as usize;
    format!("{length:.*}", 15usize.saturating_sub(before).clamp(1, 9))
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::pose::rotation_from_euler;

    #[test]
    fn a_shift_is_taken_off_and_put_back() {
        let near = Pose {
            rotation: rotation_from_euler([0.3, -0.2, 0.5].into()),
            translation: [0.1, -0.2, 0.05].into(),
        };
        let (source, target) = ([483_221.0, 5_456_871.0, 310.0], [-1e6, 2e6, 0.0]);
        let far = Pose64::of(near, source, target);
        let back = far.near(source, target);
        assert!((back.translation - near.translation).length() < 1e-6);
        // A point near one origin lands where the small pose puts it, to a micrometre.
        let moved = far.apply([source[0] + 0.5, source[1] - 0.25, source[2] + 1.0]);
        let expected = near.apply([0.5, -0.25, 1.0].into());
        for axis in 0..3 {
            assert!((moved[axis] - target[axis] - f64::from(expected[axis])).abs() < 1e-6);
        }
        let gram = far.rotation.transpose() * far.rotation - Matrix3::identity();
        assert!(gram.amax() < 1e-14);
        assert_eq!(
            Pose64::of(Pose::IDENTITY, [0.0; 3], [0.0; 3]),
            Pose64::IDENTITY
        );
    }

    #[test]
    fn what_is_not_rigid_is_refused() {
        let mut rows = Pose64::IDENTITY.to_rows();
        assert!(Pose64::from_rows(rows).checked().is_ok());
        rows[0][0] = 1.01;
        assert!(Pose64::from_rows(rows).checked().is_err());
        rows[0][0] = -1.0;
        assert!(Pose64::from_rows(rows).checked().is_err());
        rows[0] = [1.0, 0.0, 0.0, f64::INFINITY];
        assert!(Pose64::from_rows(rows).checked().is_err());
    }
}
