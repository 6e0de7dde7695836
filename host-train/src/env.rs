//! The environment: clouds to register, and the pose that actions accumulate (paper, eqs. 5, 8, 9).

use crate::dataset::Point;
use crate::dataset::pairs::Sample;
use reagent_core::net::View;
use reagent_core::pose::centroid;
use reagent_core::{Action, Pose};

/// One pair of clouds to register, fixed over the trajectories that start from it.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Observed source, `[N, 3]`.
    pub source: Vec<Point>,
    /// Target, `[N, 3]`.
    pub target: Vec<Point>,
    /// Centroid of the source, about which poses turn it.
    pub centroid: glam::Vec3,
    /// The disentangled pose that registers the source.
    pub registering: Pose,
}

impl From<Sample> for Problem {
    fn from(sample: Sample) -> Self {
        let centroid = centroid(&sample.source);
        Problem {
            registering: sample.target_from_source.to_disentangled(centroid),
            centroid,
            source: sample.source,
            target: sample.target,
        }
    }
}

impl Problem {
    /// How the source is seen under an accumulated pose: always from the original cloud.
    pub fn view(&self, pose: &Pose) -> View {
        View {
            origin: self.centroid,
            map: Pose {
                rotation: pose.rotation,
                translation: self.centroid + pose.translation,
            },
        }
    }
}

/// The next accumulated pose.
pub fn step(pose: &Pose, action: Action) -> Pose {
    pose.accumulate(action.update())
}
