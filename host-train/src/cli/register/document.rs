//! What `--json` writes.

use super::input::Input;
use crate::dataset::cloud_file::Note;
use crate::dense::Densely;
use crate::pose64::Pose64;
use crate::register::Registered;
use reagent_core::Pose;
use reagent_core::polish::Refined;
use serde::Serialize;

/// A registration: poses in the files' own coordinates, rows of `[R | t]`.
#[derive(Serialize)]
pub(super) struct Document {
    target_from_source: [[f64; 4]; 3],
    verdict: String,
    /// That the pose is within 5 degrees and .05 target radii.
    #[serde(skip_serializing_if = "Option::is_none")]
    probability: Option<f32>,
    steps: usize,
    policy: PolicyStage,
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
        let refinement = found.refinement.as_ref();
        let (verdict, policy) = found.policy;
        let notes = [("source", source), ("target", target)].into_iter();
        Document {
            target_from_source: pose.to_rows(),
            verdict: found.verdict.to_string(),
            probability: refinement.map(|r| r.evidence.probability()),
            steps: found.trace.len(),
            policy: PolicyStage {
                target_from_source: rows(policy),
                verdict: verdict.to_string(),
            },
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
