//! Rotations as unit quaternions, in scalar arithmetic. Where glam uses SIMD it sums in another order, so its bits differ from
//! target to target.

use glam::{Mat3, Quat, Vec3};

/// A rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rotation {
    /// Axis times the sine of half the angle.
    vector: Vec3,
    /// Cosine of half the angle.
    scalar: f32,
}

impl Rotation {
    /// Normalises a quaternion; the identity if it is zero or NaN.
    pub(crate) fn new(vector: Vec3, scalar: f32) -> Rotation {
        let squared = vector.length_squared() + scalar * scalar;
        if squared.is_nan() || squared <= 0.0 {
            return Rotation {
                vector: Vec3::ZERO,
                scalar: 1.0,
            };
        }
        let factor = 1.0 / libm::sqrtf(squared);
        Rotation {
            vector: vector * factor,
            scalar: scalar * factor,
        }
    }

    /// The rotation of a rotation matrix.
    pub(crate) fn of(rotation: &Mat3) -> Rotation {
        let [x, y, z, w] = Quat::from_mat3(rotation).to_array();
        Rotation::new(Vec3::new(x, y, z), w)
    }

    /// As a rotation matrix.
    pub(crate) fn matrix(self) -> Mat3 {
        let [x, y, z] = self.vector.to_array();
        Mat3::from_quat(Quat::from_xyzw(x, y, z, self.scalar))
    }

    /// A turn about a unit vector, by the right hand.
    pub(crate) fn about(axis: Vec3, angle_rad: f32) -> Rotation {
        let (sine, cosine) = libm::sincosf(0.5 * angle_rad);
        Rotation::new(axis * sine, cosine)
    }

    /// This rotation after another.
    pub(crate) fn after(self, first: Rotation) -> Rotation {
        let (a, b) = (self.vector, first.vector);
        let vector = b * self.scalar + a * first.scalar + a.cross(b);
        Rotation::new(vector, self.scalar * first.scalar - a.dot(b))
    }

    /// The inverse rotation.
    pub(crate) fn inverse(self) -> Rotation {
        Rotation {
            vector: -self.vector,
            ..self
        }
    }

    /// The screw axis (Chasles) of this rotation followed by `shift`: its unit direction, and its point nearest to the origin.
    /// `None` for the identity rotation.
    pub(crate) fn line(self, shift: Vec3) -> Option<(Vec3, Vec3)> {
        let along = self.vector.try_normalize()?;
        let across = shift - along * along.dot(shift);
        let cotangent = self.scalar / self.vector.length();
        Some((along, (across + along.cross(across) * cotangent) * 0.5))
    }

    /// Cosine of half the angle between two rotations.
    pub(crate) fn likeness(self, other: Rotation) -> f32 {
        (self.vector.dot(other.vector) + self.scalar * other.scalar).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_about_a_line_is_told_by_it() {
        let (along, point) = (Vec3::new(2.0, -1.0, 2.0) / 3.0, Vec3::new(0.5, 0.2, -0.4));
        assert!(along.dot(point).abs() < 1e-6);
        for angle in [0.2f32, -1.0, core::f32::consts::PI] {
            let turn = Rotation::new(along * (0.5 * angle).sin(), (0.5 * angle).cos());
            let shift = point - turn.matrix() * point + along * 0.3;
            let (direction, found) = turn.line(shift).expect("a turn");
            assert!(direction.dot(along).abs() > 1.0 - 1e-6);
            assert!((found - point).length() < 1e-5, "{angle} {found}");
        }
        assert_eq!(Rotation::new(Vec3::ZERO, 1.0).line(Vec3::X), None);
    }

    #[test]
    fn products_are_those_of_matrices() {
        let (a, b) = (
            Rotation::new(Vec3::new(0.3, -0.2, 0.5), 0.9),
            Rotation::new(Vec3::new(-1.0, 2.0, 0.1), 0.2),
        );
        let product = a.after(b).matrix();
        assert!(product.abs_diff_eq(a.matrix() * b.matrix(), 1e-6));
        assert!(Rotation::of(&product).likeness(a.after(b)) > 1.0 - 1e-6);
        let half = Rotation::new(Vec3::X, 1.0);
        assert!(
            (half.likeness(half.after(half)) - core::f32::consts::FRAC_PI_4.cos()).abs() < 1e-6
        );
    }
}
