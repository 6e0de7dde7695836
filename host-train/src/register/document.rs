//! A registration as `--json` writes it.

use crate::dataset::cloud_file::Note;
use crate::pose64::{Pose64, Position};
use crate::register::best::Other;
use crate::register::dense::DenseRefinement;
use crate::register::prepared::Prepared;
use crate::register::request::Done;
use reagent_core::Pose;
use reagent_core::pipeline::Refinement;
use reagent_core::polish::Refined;
use reagent_core::verify::Undetermined;
use serde::Serialize;

/// A registration: poses in the files' own coordinates, rows of `[R | t]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Document {
    /// The pose given out.
    pub target_from_source: [[f64; 4]; 3],
    /// What can be said about it.
    pub verdict: String,
    /// That the pose is within 5 degrees and .05 target radii of the truth, or not to be told from it
    /// (ADI below .02 diameters).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability: Option<f32>,
    /// What a refinement says, unless there was none.
    #[serde(flatten)]
    pub fit: Option<Fit>,
    /// Which of the starts it came from, from 0, if there were several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<usize>,
    /// The next best poses, the most probable first; none where nobody asks for them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub others: Option<Vec<OtherPose>>,
    /// Steps that the policy took.
    pub steps: usize,
    /// Where the policy's steps led, unless none were taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy: Option<PolicyStage>,
    /// The same, refined.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub polish: Option<RefinedStage>,
    /// The best of the poses that were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verify: Option<RefinedStage>,
    /// The last refinement, on many points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dense: Option<DenseStage>,
    /// Time, milliseconds.
    pub ms: f64,
    /// Points of the source that the policy saw.
    pub source_points: usize,
    /// Points of the target that the policy saw.
    pub target_points: usize,
    /// By which the source was multiplied before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source_scale: Option<f64>,
    /// What the readers noticed, and what the fit tells of the source.
    pub notes: Vec<Noticed>,
}

/// How the clouds fit under the pose given out, and what their shape leaves open.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Share of the source's points that lie on the target's surface.
    pub overlap: f32,
    /// Root of the mean squared distance of those from it, in the clouds' units.
    pub inlier_rmse: f32,
    /// Size of the source over that of the target.
    pub extents_ratio: f32,
    /// Points that differ from all others, in the cloud with fewer of them.
    pub distinct_points: usize,
    /// Shares of the source's and of the target's points that were left out, since they lie far from all others.
    pub left_out: [f32; 2],
    /// Share of the target's points facing the sensor behind which something was seen; left out where there is none.
    #[serde(skip_serializing_if = "is_zero")]
    pub seen_through: f32,
    /// What the shape leaves open, if it was looked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub undetermined: Option<Open>,
    /// How uncertain the pose is, if it is right.
    pub covariance: Covariance,
}

/// Of the core's refinement: [`reagent_core::covariance`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Covariance {
    /// The point about which the pose may be turned, in the target's coordinates.
    pub about: [f64; 3],
    /// Of a turn about it, radians, and of a shift, the clouds' units.
    pub matrix: [[f32; 6]; 6],
}

/// What the shape leaves open.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Open {
    /// The axis about which the turn is open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<OpenAxis>,
    /// Whether the axis may have any direction: a ball.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub any_rotation: bool,
    /// The direction along which the place is open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slide: Option<OpenSlide>,
    /// The rotational symmetry by whose turns the clouds fit as well.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fold: Option<OpenFold>,
    /// Other poses that fit as well, with all that the symmetry makes of them.
    pub poses: Vec<[[f64; 4]; 3]>,
}

/// An axis of the target about which the turn is open.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OpenAxis {
    /// A point of it, in the target's coordinates.
    pub point: [f64; 3],
    /// Its unit vector.
    pub direction: [f32; 3],
    /// Least and largest turn about it that fit as well, by the right hand.
    pub range_deg: [f32; 2],
}

/// A rotational symmetry: turned about this axis of the target by any multiple of a full turn over `order`, the clouds fit as well.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OpenFold {
    /// A point of the axis, in the target's coordinates.
    pub point: [f64; 3],
    /// Its unit vector.
    pub direction: [f32; 3],
    /// How many poses it makes of one.
    pub order: u8,
}

/// A direction along which the place is open.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OpenSlide {
    /// Its unit vector, in the target's coordinates.
    pub direction: [f32; 3],
    /// Least and largest shift along it that fit as well, in the target's unit.
    pub range: [f32; 2],
}

fn is_zero(share: &f32) -> bool {
    *share == 0.0
}

impl Fit {
    fn of(found: &Refinement, rows: impl Fn(Pose) -> [[f64; 4]; 3], origin: Position) -> Fit {
        let refined = &found.refined;
        Fit {
            overlap: refined.overlap,
            inlier_rmse: refined.inlier_rmse,
            extents_ratio: refined.extents_ratio,
            distinct_points: refined.distinct_points,
            left_out: refined.left_out,
            seen_through: refined.seen_through,
            undetermined: Open::of(found, rows, origin),
            covariance: Covariance {
                about: far(found.refined.covariance.about, origin),
                matrix: found.refined.covariance.matrix,
            },
        }
    }
}

impl Open {
    /// Of a refinement, in the target's own coordinates, of which `origin` is the point that it was relative to; nothing where nothing
    /// is open and no poses were compared.
    pub fn of(
        found: &Refinement,
        rows: impl Fn(Pose) -> [[f64; 4]; 3],
        origin: Position,
    ) -> Option<Open> {
        if found.hypotheses.is_none() && found.undetermined.is_nothing() {
            return None;
        }
        let Undetermined {
            axis,
            slide,
            any_rotation,
            fold,
            poses: _,
        } = &found.undetermined;
        Some(Open {
            any_rotation: *any_rotation,
            axis: axis.map(|axis| OpenAxis {
                point: far(axis.point, origin),
                direction: axis.direction.to_array(),
                range_deg: axis.range_rad.map(f32::to_degrees),
            }),
            slide: slide.map(|slide| OpenSlide {
                direction: slide.direction.to_array(),
                range: slide.range,
            }),
            fold: fold.map(|fold| OpenFold {
                point: far(fold.point, origin),
                direction: fold.direction.to_array(),
                order: fold.order,
            }),
            poses: found
                .undetermined
                .copies(found.refined.target_from_source)
                .map(rows)
                .collect(),
        })
    }
}

/// A point of the core's, relative to `origin`, in the file's own coordinates.
fn far(point: glam::Vec3, origin: Position) -> Position {
    [0, 1, 2].map(|k| f64::from(point[k]) + origin[k])
}

/// Where the policy's steps led.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PolicyStage {
    /// The pose.
    pub target_from_source: [[f64; 4]; 3],
    /// How the steps ended.
    pub verdict: String,
}

/// A refined pose.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RefinedStage {
    /// The pose.
    pub target_from_source: [[f64; 4]; 3],
    /// Of the source's points to the target, and of the target's to the source.
    pub residual: [f32; 2],
    /// Steps of closest points.
    pub iterations: usize,
    /// Other poses that were tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hypotheses: Option<usize>,
}

/// A pose that was not given out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OtherPose {
    /// The pose.
    pub target_from_source: [[f64; 4]; 3],
    /// That it is right: what would be said of it alone, and how much less probable it is than the pose given out.
    pub probability: f32,
    /// As of [`RefinedStage`].
    pub residual: [f32; 2],
    /// As of [`Fit`].
    pub overlap: f32,
    /// The same.
    pub inlier_rmse: f32,
}

/// The last refinement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DenseStage {
    /// The pose.
    pub target_from_source: [[f64; 4]; 3],
    /// How it ended.
    #[serde(flatten)]
    pub found: DenseRefinement,
}

/// Something about a cloud that its user should know.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Noticed {
    /// `source` or `target`.
    pub of: &'static str,
    /// What.
    #[serde(flatten)]
    pub note: Note,
    /// The same in words.
    pub text: String,
}

impl Noticed {
    fn new(of: &'static str, note: Note) -> Noticed {
        let text = note.to_string();
        Noticed { of, note, text }
    }
}

impl Document {
    /// Of two clouds, of which the source was multiplied by `scale` before.
    pub fn new([source, target]: [&Prepared<'_>; 2], done: &Done, scale: f64) -> Document {
        let rows = |near: Pose| Pose64::of(near, source.origin, target.origin).to_rows();
        let stage = |refined: &Refined, hypotheses| RefinedStage {
            target_from_source: rows(refined.target_from_source),
            residual: [refined.residual.source, refined.residual.target],
            iterations: refined.iterations,
            hypotheses,
        };
        let other = |other: &Other| OtherPose {
            target_from_source: rows(other.refined.target_from_source),
            probability: other.probability,
            residual: [other.refined.residual.source, other.refined.residual.target],
            overlap: other.refined.overlap,
            inlier_rmse: other.refined.inlier_rmse,
        };
        let answer = &done.found.answer;
        let refinement = answer.refinement.as_ref();
        let notes_of = |of, cloud: &Prepared<'_>| {
            let notes = cloud.notes.iter().cloned();
            notes.map(|note| Noticed::new(of, note)).collect::<Vec<_>>()
        };
        let other_size = done.other_size.map(|times| Note::OtherSize { times });
        let off_target = done.off_target().map(|share| Note::OffTarget { share });
        let seen_through = done.seen_through().map(|share| Note::SeenThrough { share });
        let from_among = done.is_seen_from_among.then_some(Note::SeenFromAmong);
        let not_finer = done.is_dense_dropped.then_some(Note::NotFiner);
        let of_fit = [not_finer, other_size, off_target, seen_through, from_among]
            .into_iter()
            .flatten();
        Document {
            target_from_source: done.pose.to_rows(),
            verdict: answer.verdict.to_string(),
            probability: answer.probability,
            fit: refinement.map(|found| Fit::of(found, rows, target.origin)),
            start: done.start,
            others: Some(done.others.iter().map(other).collect()),
            steps: done.found.trace.len(),
            policy: answer.policy.map(|policy| PolicyStage {
                target_from_source: rows(policy.target_from_source),
                verdict: policy.verdict.to_string(),
            }),
            polish: refinement.map(|r| stage(&r.polished, None)),
            verify: refinement.and_then(|r| {
                r.hypotheses
                    .map(|hypotheses| stage(&r.refined, Some(hypotheses)))
            }),
            dense: done.dense.map(|found| DenseStage {
                target_from_source: rows(found.target_from_source),
                found,
            }),
            ms: done.ms,
            source_points: source.points().len(),
            target_points: target.points().len(),
            source_scale: Some(scale).filter(|&scale| scale != 1.0),
            notes: [
                notes_of("source", source),
                notes_of("target", target),
                of_fit.map(|note| Noticed::new("source", note)).collect(),
            ]
            .concat(),
        }
    }
}
