//! What robots answer, and how it is written.

use crate::client::{Client, RefineError};
use crate::node::ANY;
use host_train::pose64::{Pose64, Position};
use reagent_core::Pose;
use reagent_core::wire::{Mode, RefineReply, RefineRequest};
use serde_json::json;
use std::time::Instant;

/// A robot's answer and how long it took from here.
#[derive(Debug)]
pub struct Answer {
    /// Who answered.
    pub robot: String,
    /// What.
    pub reply: RefineReply,
    /// From asking to knowing, milliseconds.
    pub round_trip_ms: f64,
}

impl Answer {
    /// In the files' own coordinates, of which what was sent is relative to two origins.
    pub(super) fn json(&self, [source, target]: [Position; 2]) -> serde_json::Value {
        let fit = self.reply.fit.as_ref().map(|fit| {
            let far = |p: [f32; 3]| -> Position { std::array::from_fn(|k| f64::from(p[k]) + target[k]) };
            let (about, triangle) = fit.covariance;
            let row = |i: usize| -> [f32; 6] {
                std::array::from_fn(|j| triangle[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)])
            };
            let matrix: [_; 6] = std::array::from_fn(row);
            let axis = fit.axis.map(|(point, direction, range)| {
                json!({ "point": far(point), "direction": direction, "range_deg": range.map(f32::to_degrees) })
            });
            let slide = fit.slide.map(|(direction, range)| json!({ "direction": direction, "range": range }));
            let fold = fit.fold.map(|(point, direction, order)| {
                json!({ "point": far(point), "direction": direction, "order": order })
            });
            let open = without_null(json!({
                "axis": axis,
                "any_rotation": fit.any_rotation.then_some(true),
                "slide": slide,
                "fold": fold,
                "others": fit.others,
            }));
            without_null(json!({
                "overlap": fit.overlap,
                "inlier_rmse": fit.inlier_rmse,
                "extents_ratio": fit.extents_ratio,
                "left_out": fit.left_out,
                "seen_through": (fit.seen_through > 0.0).then_some(fit.seen_through),
                "distinct_points": fit.distinct_points,
                // Only where poses are compared.
                "undetermined": (self.reply.mode == Mode::Verify).then_some(open),
                "covariance": { "about": far(about), "matrix": matrix },
            }))
        });
        json!({
            "robot": self.robot,
            "target_from_source": self.pose([source, target]).to_rows(),
            "verdict": self.reply.verdict.to_string(),
            "probability": self.reply.probability,
            "fit": fit,
            "mode": self.reply.mode.to_string(),
            "steps": self.reply.steps,
            "ms_queue": f64::from(self.reply.waited_micros) / 1e3,
            "ms_robot": f64::from(self.reply.micros) / 1e3,
            "ms_round_trip": self.round_trip_ms,
            "policy_version": self.reply.policy_version,
        })
    }

    /// The pose between the files' own coordinates.
    pub(super) fn pose(&self, [source, target]: [Position; 2]) -> Pose64 {
        Pose64::of(
            Pose::from_rows(self.reply.target_from_source),
            source,
            target,
        )
    }
}

/// An object's entries that have a value: what is not known has no key, as in the documents of `register`.
fn without_null(mut object: serde_json::Value) -> serde_json::Value {
    if let Some(entries) = object.as_object_mut() {
        entries.retain(|_, value| !value.is_null());
    }
    object
}

/// Asks one robot, or any, for one pose.
///
/// # Errors
/// As [`Client::refine`] and [`Client::refine_any`].
pub async fn ask(
    client: &Client,
    robot: &str,
    request: &RefineRequest<'_>,
) -> Result<Answer, RefineError> {
    let asked = Instant::now();
    let (robot, reply) = match robot {
        ANY => client.refine_any(request).await?,
        robot => (robot.to_owned(), client.refine(robot, request).await?),
    };
    Ok(Answer {
        robot,
        reply,
        round_trip_ms: asked.elapsed().as_secs_f64() * 1e3,
    })
}
