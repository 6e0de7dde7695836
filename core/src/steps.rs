//! The step table and the discrete action of one refinement step.

use crate::dims::{AXES, STEP_SIZES};
use crate::pose::Pose;
use glam::{Mat3, Vec3};

/// Signed steps by action id: radians about an axis, normalised units along it. Index 5 is "stop".
pub const STEPS: [f32; STEP_SIZES] = [
    -0.27, -0.09, -0.03, -0.01, -0.0033, 0.0, 0.0033, 0.01, 0.03, 0.09, 0.27,
];
/// Action id that leaves an axis as it is.
pub const STOP: u8 = 5;

/// `sin` of each step, correctly rounded, so that a rotation step has the same bits on every target.
const SIN: [f32; STEP_SIZES] = [
    -0.266_731_44,
    -0.089_878_55,
    -0.029_995_5,
    -0.009_999_834,
    -0.003_299_994,
    0.0,
    0.003_299_994,
    0.009_999_834,
    0.029_995_5,
    0.089_878_55,
    0.266_731_44,
];
/// `cos` of each step.
const COS: [f32; STEP_SIZES] = [
    0.963_770_9,
    0.995_952_7,
    0.999_550_04,
    0.999_95,
    0.999_994_56,
    1.0,
    0.999_994_56,
    0.999_95,
    0.999_550_04,
    0.995_952_7,
    0.963_770_9,
];

/// One step: an id of the step table for each axis, translation first (as the network's outputs are).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Action {
    /// Step ids along x, y, z; each below 11.
    pub translation: [u8; AXES],
    /// Step ids about x, y, z; each below 11.
    pub rotation: [u8; AXES],
}

impl Action {
    /// The step that changes nothing.
    pub const STOP: Action = Action {
        translation: [STOP; AXES],
        rotation: [STOP; AXES],
    };

    /// The signed step as an update: `R̂ = Rx(a)·Ry(b)·Rz(c)` and `t̂` in normalised units.
    /// Ids beyond the table count as stop.
    pub fn update(self) -> Pose {
        let translation = Vec3::from_array(self.translation.map(|id| step(id, &STEPS, 0.0)));
        let [(sa, ca), (sb, cb), (sc, cc)] = self
            .rotation
            .map(|id| (step(id, &SIN, 0.0), step(id, &COS, 1.0)));
        Pose {
            rotation: rotation_xyz(sa, ca, sb, cb, sc, cc),
            translation,
        }
    }
}

fn step(id: u8, table: &[f32; STEP_SIZES], stop: f32) -> f32 {
    table.get(usize::from(id)).copied().unwrap_or(stop)
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

    #[test]
    fn tabulated_sines_are_correctly_rounded() {
        for i in 0..STEP_SIZES {
            let x = f64::from(STEPS[i]);
            assert_eq!(SIN[i], libm::sin(x) as f32, "sin of step {i}");
            assert_eq!(COS[i], libm::cos(x) as f32, "cos of step {i}");
        }
    }

    #[test]
    fn stop_is_the_identity_and_unknown_ids_stop() {
        assert_eq!(Action::STOP.update(), Pose::IDENTITY);
        let unknown = Action {
            translation: [200; 3],
            rotation: [11; 3],
        };
        assert_eq!(unknown.update(), Pose::IDENTITY);
    }
}
