//! What `--json` writes.

use super::input::Input;
use crate::dataset::cloud_file::Note;
use crate::pose64::{Pose64, Position};
use crate::register::Registered;
use crate::register::dense::Densely;
use reagent_core::Pose;
use reagent_core::pipeline::Refinement;
use reagent_core::polish::Refined;
use reagent_core::verify::Undetermined;
use serde::Serialize;

/// A registration: poses in the files' own coordinates, rows of `[R | t]`.
#[derive(Serialize)]
pub(super) struct Document {
    target_from_source: [[f64; 4]; 3],
    verdict: String,
    /// That the pose is within 5 degrees and .05 target radii.
    #[serde(skip_serializing_if = "Option::is_none")]
    probability: Option<f32>,
    #[serde(flatten)]
    fit: Option<Fit>,
    steps: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    policy: Option<PolicyStage>,
    #[serde(skip_serializing_if = "Option::is_none")]
    polish: Option<RefinedStage>,
    #[serde(skip_serializing_if = "Option::is_none")]
    verify: Option<RefinedStage>,
    /// The last refinement, on all points.
    #[serde(skip_serializing_if = "Option::is_none")]
    dense: Option<DenseStage>,
    ms: f64,
    source_points: usize,
    target_points: usize,
    /// By which the source was multiplied before.
    #[serde(skip_serializing_if = "Option::is_none")]
    source_scale: Option<f64>,
    /// What the readers noticed.
    notes: Vec<Noticed>,
}

/// How the clouds fit under the pose given out, and what their shape leaves open.
#[derive(Serialize)]
struct Fit {
    /// Share of the source's points that lie on the target's surface.
    overlap: f32,
    /// Root of the mean squared distance of those from it, in the clouds' units.
    inlier_rmse: f32,
    /// Size of the source over that of the target.
    extents_ratio: f32,
    /// Points that differ from all others, in the cloud with fewer of them.
    distinct_points: usize,
    /// Shares of the source's and of the target's points that were left out, since they lie far from all others.
    left_out: [f32; 2],
    undetermined: Open,
    covariance: Covariance,
}

/// Of the core's refinement: [`reagent_core::covariance`].
#[derive(Serialize)]
struct Covariance {
    about: [f64; 3],
    matrix: [[f32; 6]; 6],
}

#[derive(Serialize)]
struct Open {
    #[serde(skip_serializing_if = "Option::is_none")]
    axis: Option<OpenAxis>,
    /// Other poses that fit as well.
    poses: Vec<[[f64; 4]; 3]>,
}

#[derive(Serialize)]
struct OpenAxis {
    point: [f64; 3],
    direction: [f32; 3],
    half_angle_deg: f32,
}

impl Fit {
    fn of(found: &Refinement, rows: impl Fn(Pose) -> [[f64; 4]; 3], origin: Position) -> Fit {
        let refined = &found.refined;
        let Undetermined { axis, poses } = &found.undetermined;
        let far = |p: glam::Vec3| std::array::from_fn(|k| f64::from(p[k]) + origin[k]);
        Fit {
            overlap: refined.overlap,
            inlier_rmse: refined.inlier_rmse,
            extents_ratio: refined.extents_ratio,
            distinct_points: refined.distinct_points,
            left_out: refined.left_out,
            undetermined: Open {
                axis: axis.map(|axis| OpenAxis {
                    point: far(axis.point),
                    direction: axis.direction.to_array(),
                    half_angle_deg: axis.half_angle_rad.to_degrees(),
                }),
                poses: poses.iter().flatten().map(|&pose| rows(pose)).collect(),
            },
            covariance: Covariance {
                about: far(found.covariance.about),
                matrix: found.covariance.matrix,
            },
        }
    }
}

#[derive(Serialize)]
struct PolicyStage {
    target_from_source: [[f64; 4]; 3],
    verdict: String,
}

#[derive(Serialize)]
struct RefinedStage {
    target_from_source: [[f64; 4]; 3],
    /// Of the source's points to the target, and of the target's to the source.
    residual: [f32; 2],
    iterations: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    hypotheses: Option<usize>,
}

#[derive(Serialize)]
struct DenseStage {
    target_from_source: [[f64; 4]; 3],
    #[serde(flatten)]
    found: Densely,
}

#[derive(Serialize)]
struct Noticed {
    /// `source` or `target`.
    of: &'static str,
    #[serde(flatten)]
    note: Note,
    text: String,
}

impl Document {
    pub(super) fn new(
        [source, target]: &[Input; 2],
        found: &Registered,
        dense: Option<&Densely>,
        pose: &Pose64,
        scale: f64,
        ms: f64,
    ) -> Document {
        let rows = |near: Pose| Pose64::of(near, source.origin, target.origin).to_rows();
        let stage = |refined: &Refined, hypotheses| RefinedStage {
            target_from_source: rows(refined.target_from_source),
            residual: [refined.residual.source, refined.residual.target],
            iterations: refined.iterations,
            hypotheses,
        };
        let answer = &found.answer;
        let refinement = answer.refinement.as_ref();
        let notes = [("source", source), ("target", target)].into_iter();
        Document {
            target_from_source: pose.to_rows(),
            verdict: answer.verdict.to_string(),
            probability: refinement.map(|r| r.evidence.probability()),
            fit: refinement.map(|found| Fit::of(found, rows, target.origin)),
            steps: found.trace.len(),
            policy: answer.policy.map(|policy| PolicyStage {
                target_from_source: rows(policy.target_from_source),
                verdict: policy.verdict.to_string(),
            }),
            polish: refinement.map(|r| stage(&r.polished, None)),
            verify: refinement.and_then(|r| {
                r.hypotheses
                    .map(|hypotheses| stage(&r.refined, Some(hypotheses)))
            }),
            dense: dense.map(|&found| DenseStage {
                target_from_source: rows(found.target_from_source),
                found,
            }),
            ms,
            source_points: source.points.len(),
            target_points: target.points.len(),
            source_scale: Some(scale).filter(|&scale| scale != 1.0),
            notes: notes
                .flat_map(|(of, input)| {
                    input.file.notes.iter().map(move |note| Noticed {
                        of,
                        note: note.clone(),
                        text: note.to_string(),
                    })
                })
                .collect(),
        }
    }
}
