//! Where a registration starts, and how far from the truth the start may be.

use crate::pose::Pose;
use crate::solve::Rigid;
use glam::Vec3;

/// A prior estimate of `target_from_source`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// This pose, and its uncertainty.
    Pose(Pose, Uncertainty),
    /// No estimate: every rotation is equally probable.
    Anywhere,
}

impl Start {
    /// The pose, with the default uncertainty of an estimator or an operator.
    pub const fn at(pose: Pose) -> Start {
        Start::Pose(pose, Uncertainty::DEFAULT)
    }

    /// The pose to begin with.
    pub fn pose(&self) -> Pose {
        match *self {
            Start::Pose(pose, _) => pose,
            Start::Anywhere => Pose::IDENTITY,
        }
    }
}

/// Standard deviations of a start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of the rotation about the object's centre, in radians.
    pub rotation_rad: f32,
    /// Of the object's centre along the viewing axis, in target radii.
    pub along: f32,
    /// Of the centre across that axis, in target radii. Without a view point, the larger of the two holds in all directions.
    pub across: f32,
}

impl Uncertainty {
    /// The default where none is stated: 0.6 rad (34 degrees), a third of a target radius.
    pub const DEFAULT: Uncertainty = Uncertainty {
        rotation_rad: 0.6,
        along: 0.35,
        across: 0.35,
    };

    /// Whether these are standard deviations: not negative, infinite for the unknown.
    pub(crate) fn is_sound(&self) -> bool {
        [self.rotation_rad, self.along, self.across]
            .into_iter()
            .all(|deviation| deviation >= 0.0)
    }
}

/// A start as evidence for or against a pose, in a refiner's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    start: Rigid,
    /// Direction in which the sensor looks, in the source's frame.
    ahead: Option<Vec3>,
    uncertainty: Uncertainty,
}

/// Cap on the squared distance from the start: poses beyond four standard deviations are equally improbable.
const CAP: f32 = 16.0;

impl Prior {
    pub(crate) fn new(start: Rigid, ahead: Option<Vec3>, uncertainty: Uncertainty) -> Prior {
        Prior {
            start,
            ahead,
            uncertainty,
        }
    }

    /// Half the squared distance of a pose from the start, in standard deviations and capped: a negative log-probability.
    pub(crate) fn surprise(&self, at: Rigid) -> f32 {
        let half = libm::acosf(at.rotation.likeness(self.start.rotation).min(1.0));
        let turned = 2.0 * half / self.uncertainty.rotation_rad.max(1e-6);
        let moved = at.centre() - self.start.centre();
        let Uncertainty { along, across, .. } = self.uncertainty;
        let (along, across) = (along.max(1e-6), across.max(1e-6));
        let shifted = match self.ahead {
            Some(ahead) => {
                let forward = moved.dot(ahead);
                let sideways = (moved.length_squared() - forward * forward).max(0.0);
                forward * forward / (along * along) + sideways / (across * across)
            }
            None => moved.length_squared() / (along * along).max(across * across),
        };
        0.5 * (turned * turned + shifted).min(CAP)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::tests::{error, pose};
    use crate::polish::{Refiner, Workspace};
    use crate::verify::tests::brick;

    #[test]
    fn a_start_settles_which_way_a_seen_box_is_turned() {
        // The top rises so little to one side that only many points together tell it.
        let tilted =
            |p: [f32; 3], by: f32| [p[0], p[1], if p[2] > 0.0 { p[2] + by * p[0] } else { p[2] }];
        let half = [0.7, 0.5, 0.25];
        let target: Vec<_> = brick(half, 2000, 31)
            .into_iter()
            .map(|p| tilted(p, 0.014))
            .collect();
        let eye = Vec3::new(1.5, -1.2, 3.0);
        let faces_eye = |p: &[f32; 3]| p[2] > 0.2 || p[0] == 0.7 || p[1] == -0.5;
        let seen = brick(half, 2400, 32).into_iter().filter(faces_eye);
        // As the target looks when it is turned by half a turn.
        let source: Vec<_> = seen.map(|p| tilted(p, -0.014)).collect();
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
        refiner.set_sensor(eye, &[]);
        let start = Start::at(pose([0.0, 0.0, 0.1], [0.0; 3]));
        let found = refiner.verify(start.pose(), &start).expect("a rigid pose");
        let (angle, _) = error(found.best.target_from_source, Pose::IDENTITY);
        let turned = Pose {
            rotation: pose([0.0, 0.0, core::f32::consts::PI], [0.0; 3]).rotation,
            ..Pose::IDENTITY
        };
        let fits = [Pose::IDENTITY, turned].map(|pose| refiner.residual(pose).expect("rigid"));
        assert!(fits[1].source < fits[0].source - 0.05, "{fits:?}");
        assert!(angle < 5.0, "{angle} {fits:?}");
    }
}
