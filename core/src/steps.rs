//! The step table and the discrete action of one refinement step.

use crate::dims::{AXES, STEP_SIZES};
use crate::pose::{Pose, rotation_xyz};
use glam::Vec3;

/// Signed steps by action id, in radians about an axis or normalised units along it. Id 5 is "stop".
pub const STEPS: [f32; STEP_SIZES] = [
    -0.27, -0.09, -0.03, -0.01, -0.0033, 0.0, 0.0033, 0.01, 0.03, 0.09, 0.27,
];
/// Action id that leaves an axis as it is.
pub const STOP: u8 = 5;

/// `sin` of each step, correctly rounded, so that a rotation step has the same bits on every target.
const SIN: [f32; STEP_SIZES] = [
    -0.26673144,
    -0.08987855,
    -0.0299955,
    -0.009999833,
    -0.003299994,
    0.0,
    0.003299994,
    0.009999833,
    0.0299955,
    0.08987855,
    0.26673144,
];
/// `cos` of each step, likewise.
const COS: [f32; STEP_SIZES] = [
    0.96377087, 0.9959527, 0.99955004, 0.99995, 0.9999946, 1.0, 0.9999946, 0.99995, 0.99955004,
    0.9959527, 0.96377087,
];

/// One step: ids into the step table for each axis, translation first as in the network's outputs.
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

    /// The signed steps: translations in normalised units, then rotations in radians. Ids beyond the table count as stop.
    pub fn signed(self) -> [[f32; AXES]; 2] {
        [self.translation, self.rotation].map(|ids| ids.map(|id| step(id, &STEPS, 0.0)))
    }

    /// The signed step as an update: `R̂ = Rx(a)·Ry(b)·Rz(c)` and `t̂` in normalised units.
    /// Ids beyond the table count as stop.
    pub fn update(self) -> Pose {
        let [translation, _] = self.signed();
        let [(sa, ca), (sb, cb), (sc, cc)] = self
            .rotation
            .map(|id| (step(id, &SIN, 0.0), step(id, &COS, 1.0)));
        Pose {
            rotation: rotation_xyz(sa, ca, sb, cb, sc, cc),
            translation: Vec3::from_array(translation),
        }
    }
}

fn step(id: u8, table: &[f32; STEP_SIZES], stop: f32) -> f32 {
    table.get(usize::from(id)).copied().unwrap_or(stop)
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
