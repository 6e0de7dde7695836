//! Rotations as unit quaternions, in scalar arithmetic: glam's have another order of sums where they use SIMD, and
//! so other bits from target to target.

use glam::{Mat3, Quat, Vec3};

/// A rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn {
    /// Axis times the sine of half the angle.
    vector: Vec3,
    /// Cosine of half the angle.
    scalar: f32,
}

impl Turn {
    /// The rotation with a multiple of these parts; none for zeros.
    pub(crate) fn new(vector: Vec3, scalar: f32) -> Turn {
        let squared = vector.length_squared() + scalar * scalar;
        if squared.is_nan() || squared <= 0.0 {
            return Turn {
                vector: Vec3::ZERO,
                scalar: 1.0,
            };
        }
        let factor = 1.0 / libm::sqrtf(squared);
        Turn {
            vector: vector * factor,
            scalar: scalar * factor,
        }
    }

    /// Of a rotation matrix.
    pub(crate) fn of(rotation: &Mat3) -> Turn {
        let [x, y, z, w] = Quat::from_mat3(rotation).to_array();
        Turn::new(Vec3::new(x, y, z), w)
    }

    /// As a rotation matrix.
    pub(crate) fn matrix(self) -> Mat3 {
        let [x, y, z] = self.vector.to_array();
        Mat3::from_quat(Quat::from_xyzw(x, y, z, self.scalar))
    }

    /// This rotation after another.
    pub(crate) fn after(self, first: Turn) -> Turn {
        let (a, b) = (self.vector, first.vector);
        let vector = b * self.scalar + a * first.scalar + a.cross(b);
        Turn::new(vector, self.scalar * first.scalar - a.dot(b))
    }

    /// Cosine of half the angle between two rotations.
    pub(crate) fn likeness(self, other: Turn) -> f32 {
        (self.vector.dot(other.vector) + self.scalar * other.scalar).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_matrices() {
        let (a, b) = (
            Turn::new(Vec3::new(0.3, -0.2, 0.5), 0.9),
            Turn::new(Vec3::new(-1.0, 2.0, 0.1), 0.2),
        );
        let product = a.after(b).matrix();
        assert!(product.abs_diff_eq(a.matrix() * b.matrix(), 1e-6));
        assert!(Turn::of(&product).likeness(a.after(b)) > 1.0 - 1e-6);
        let half = Turn::new(Vec3::X, 1.0);
        assert!(
            (half.likeness(half.after(half)) - core::f32::consts::FRAC_PI_4.cos()).abs() < 1e-6
        );
    }
}
