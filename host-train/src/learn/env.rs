//! The environment: clouds to register, and the pose that actions accumulate to (paper, eqs. 5, 8, 9).

use crate::dataset::Point;
use crate::dataset::pairs::Sample;
use glam::Vec3;
use reagent_core::cut::Reach;
use reagent_core::focus::Focus;
use reagent_core::sight::Sight;
use reagent_core::view::View;
use reagent_core::{Action, Cloud, Frame, Pose};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;

/// One pair of clouds to register; all trajectories that start from it share it.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Observed source, `[N, 3]`.
    pub source: Vec<Point>,
    /// Target, `[N, 3]`.
    pub target: Vec<Point>,
    /// The target's points that the policy looks at.
    pub chosen: Vec<Point>,
    /// What the policy looks at of both clouds.
    pub sight: Sight,
    /// Centroid about which disentangled poses turn the source, without the points cut off under the first estimate.
    pub centroid: Vec3,
    /// The disentangled pose that registers the source.
    pub true_pose: Pose,
}

impl From<Sample> for Problem {
    fn from(sample: Sample) -> Self {
        Problem::new(sample.source, sample.target, sample.target_from_source)
    }
}

impl Problem {
    /// A pair of clouds and the plain transform that registers them.
    pub fn new(source: Vec<Point>, target: Vec<Point>, target_from_source: Pose) -> Self {
        let sample = Sample {
            source,
            target,
            target_from_source,
        };
        Problem::seen(Sight::ALL, sample)
    }

    /// The same for a policy that does not look at everything.
    pub fn seen(sight: Sight, sample: Sample) -> Self {
        let Sample {
            source,
            target,
            target_from_source,
        } = sample;
        let centroid = sight
            .cut
            .centroid(Cloud::F32(&source), &Frame::IDENTITY, &Pose::IDENTITY);
        let mut problem = Problem {
            sight,
            true_pose: target_from_source.to_disentangled(centroid),
            centroid,
            source,
            chosen: Vec::new(),
            target,
        };
        problem.chosen = problem.focused(Accumulation::Global, &Pose::IDENTITY);
        problem
    }

    /// The target's points that the policy looks at from this pose on.
    fn focused(&self, accumulation: Accumulation, pose: &Pose) -> Vec<Point> {
        if self.sight.focus == 0 {
            return self.target.clone();
        }
        let view = accumulation.view(self.centroid, pose);
        let (source, target) = (Cloud::F32(&self.source), Cloud::F32(&self.target));
        let reach = self.sight.cut.of(source, &view);
        let focus = Focus::on((source, &view, reach), (target, &View::IDENTITY));
        let kept = self
            .target
            .iter()
            .filter(|&&p| focus.keeps(&View::IDENTITY, p));
        kept.copied().collect()
    }

    /// The same problem from this pose on, with the target's points chosen anew.
    pub fn refocused(&self, accumulation: Accumulation, pose: &Pose) -> Problem {
        Problem {
            chosen: self.focused(accumulation, pose),
            ..self.clone()
        }
    }

    /// The source's points that the policy looks at under a view.
    pub fn looked_at(&self, view: &View) -> Cow<'_, [Point]> {
        match self.sight.cut.of(Cloud::F32(&self.source), view) {
            Reach::ALL => Cow::Borrowed(&self.source),
            reach => {
                let kept = self.source.iter().filter(|&&p| reach.keeps(view, p));
                Cow::Owned(kept.copied().collect())
            }
        }
    }

    /// The source's points that rewards are measured on: those that the policy looks at under the true pose.
    pub fn rewarded(&self) -> Cow<'_, [Point]> {
        self.looked_at(&Accumulation::Global.view(self.centroid, &self.true_pose))
    }

    /// The same points under the true pose: the reference that rewards are measured against.
    pub fn truth(&self) -> Vec<Point> {
        let view = Accumulation::Global.view(self.centroid, &self.true_pose);
        self.rewarded().iter().map(|&p| view.see(p)).collect()
    }
}

/// How an action changes the accumulated pose, and what the pose means (paper, design table).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Accumulation {
    /// Disentangled, `R_i = R̂_i R_{i-1}`, `t_i = t̂_i + t_{i-1}` (equations 8 and 9; the only one that
    /// can be exported)
    #[default]
    Global,
    /// Disentangled with rotations about the turned axes, `R_i = R_{i-1} R̂_i`
    Local,
    /// Homogeneous 4x4 matrices about the origin, `T_i = T̂_i T_{i-1}` (equations 5 to 7)
    Basic,
}

impl fmt::Display for Accumulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Accumulation::Global => "global",
            Accumulation::Local => "local",
            Accumulation::Basic => "basic",
        })
    }
}

impl Accumulation {
    /// The pose after an action.
    pub fn step(self, pose: &Pose, action: Action) -> Pose {
        let update = action.update();
        match self {
            Accumulation::Global => pose.accumulate(update),
            Accumulation::Local => Pose {
                rotation: pose.rotation * update.rotation,
                translation: update.translation + pose.translation,
            },
            Accumulation::Basic => update.after(*pose),
        }
    }

    /// The view of a source with the given centroid under a pose, always applied to the original cloud.
    pub fn view(self, centroid: Vec3, pose: &Pose) -> View {
        match self {
            Accumulation::Global | Accumulation::Local => View {
                origin: centroid,
                map: Pose {
                    rotation: pose.rotation,
                    translation: centroid + pose.translation,
                },
            },
            Accumulation::Basic => View {
                origin: Vec3::ZERO,
                map: *pose,
            },
        }
    }

    /// The update that would register the source of a problem from a pose in one go: what the expert approximates
    /// by its steps (paper, eqs. 10, 11). The paper gives no equation for the basic form; there it is the whole
    /// remaining transform `T* T⁻¹`, including the translation that the rotation induces.
    pub fn remaining(self, pose: &Pose, problem: &Problem) -> Pose {
        let true_pose = &problem.true_pose;
        match self {
            Accumulation::Global => Pose {
                rotation: true_pose.rotation * pose.rotation.transpose(),
                translation: true_pose.translation - pose.translation,
            },
            Accumulation::Local => Pose {
                rotation: pose.rotation.transpose() * true_pose.rotation,
                translation: true_pose.translation - pose.translation,
            },
            Accumulation::Basic => true_pose.to_global(problem.centroid).after(pose.inverse()),
        }
    }

    /// Converts a pose to a plain transform of the source.
    pub fn target_from_source(self, centroid: Vec3, pose: &Pose) -> Pose {
        match self {
            Accumulation::Global | Accumulation::Local => pose.to_global(centroid),
            Accumulation::Basic => *pose,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::expert::Expert;
    use crate::random::{Purpose, stream};

    /// The steady expert comes within its smallest steps under every form.
    #[test]
    fn the_expert_registers_under_every_accumulation() {
        let model = crate::dataset::procedural::model(3, 1);
        for index in 0..20 {
            let mut rng = stream(5, Purpose::Augment, index);
            let sample = crate::augment::clean_sample(&mut rng, &model.points, 200);
            let expected = sample.target_from_source;
            let problem = Problem::from(sample);
            for form in [
                Accumulation::Global,
                Accumulation::Local,
                Accumulation::Basic,
            ] {
                let mut pose = Pose::IDENTITY;
                for _ in 0..14 {
                    let action = Expert::Steady.action(&form.remaining(&pose, &problem));
                    pose = form.step(&pose, action);
                }
                let plain = form.target_from_source(problem.centroid, &pose);
                let view = form.view(problem.centroid, &pose);
                for &p in &problem.source {
                    let (at, truth) = (view.see(p), expected.apply(Vec3::from_array(p)));
                    assert!(
                        Vec3::from_array(at).abs_diff_eq(truth, 0.03),
                        "{form:?} {index}"
                    );
                    assert!(
                        plain
                            .apply(Vec3::from_array(p))
                            .abs_diff_eq(Vec3::from_array(at), 1e-5)
                    );
                }
            }
        }
    }
}
