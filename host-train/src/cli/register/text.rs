//! The text that is printed.

use crate::pose64::Pose64;
use crate::register::request::Done;
use crate::register::sentences::{Names, Remark, fit, outcome, probability, uncertainty};
use crate::words::count;
use reagent_core::pipeline::Refinement;
use reagent_core::polish::Refined;
use reagent_core::verdict::{Percent, Verdict};

/// The clouds' names are those of the arguments.
const NAMES: Names<'_> = ["source", "target"];

/// Pose, stages and verdict, with advice if the clouds' sizes differ; `best` poses were asked for.
pub(super) fn report(done: &Done, size_advice: &str, best: usize) -> String {
    let Done {
        found,
        dense,
        is_dense_dropped,
        pose,
        ms,
        ..
    } = done;
    let mut text = String::from("target_from_source, rows of [R | t] in the clouds' units:\n");
    text += &format!("{pose}\n");
    let answer = &found.answer;
    if let Some(policy) = answer.policy {
        let steps = count(policy.steps, "step", "steps");
        let ended = match policy.verdict {
            Verdict::Converged => "settled".into(),
            verdict => verdict.to_string(),
        };
        text += &format!("policy: {ended} after {steps}\n");
    }
    if let Some(refinement) = &answer.refinement {
        text += &stages(refinement);
    }
    if let Some(dense) = dense {
        text += &format!(
            "dense: {} and {} points, {:.0} % of the source within {:.2e}, RMSE {:.3e}\n",
            dense.points[0],
            dense.points[1],
            100.0 * dense.overlap,
            dense.within,
            dense.rmse
        );
    }
    if *is_dense_dropped {
        text += "dense: no better pose on many points, dropped\n";
    }
    for remark in Remark::all(done) {
        let advice = advice(&remark, size_advice);
        text += &format!("{}{advice}\n", remark.sentence(NAMES));
    }
    text += &match &answer.refinement {
        Some(refinement) => probability(refinement, NAMES),
        None => "the policy alone cannot say how likely the pose is to be right: see --mode verify"
            .into(),
    };
    text += "\n";
    if let Some(start) = done.start {
        text += &format!("from start number {}\n", start + 1);
    }
    if done.others.is_empty() && best > 1 {
        text += &format!("--best {best}: no other pose was found\n");
    }
    if !done.others.is_empty() {
        text += "next best poses, which --json has; each percentage says how likely that pose is to be right, and they need not add up to 100 %:\n";
    }
    for other in &done.others {
        let residual = other.refined.residual.mean();
        text += &format!("  residual {residual:.3}, {}\n", Percent(other.probability));
    }
    let ended = outcome(answer.verdict, answer.probability);
    text + &format!("{ended}, {ms:.1} ms\n")
}

/// The matrix `[R | t; 0 0 0 1]`, one row a line, in the fewest digits that read back the same.
pub(super) fn matrix(pose: &Pose64) -> String {
    let rows = pose.to_rows().into_iter().chain([[0.0, 0.0, 0.0, 1.0]]);
    let line = |row: [f64; 4]| row.map(|x| x.to_string()).join(" ") + "\n";
    rows.map(line).collect()
}

/// A line for each stage, with the fit of the clouds.
fn stages(found: &Refinement) -> String {
    let residual = |r: &Refined| {
        format!(
            "residual {:.3} (source {:.3}, target {:.3})",
            r.residual.mean(),
            r.residual.source,
            r.residual.target
        )
    };
    let mut text = format!(
        "polish: {} after {}\n",
        residual(&found.polished),
        count(found.polished.iterations, "iteration", "iterations")
    );
    if let Some(tried) = found.hypotheses {
        let kept = if found.refined == found.polished {
            "kept"
        } else {
            "replaced"
        };
        text += &format!(
            "verify: {kept} against {}, {}\n",
            count(tried, "other pose", "other poses"),
            residual(&found.refined)
        );
    }
    for line in [fit, uncertainty] {
        text += &format!("{}\n", line(&found.refined, NAMES));
    }
    text
}

/// The option that helps with a remark.
fn advice(remark: &Remark, size_advice: &str) -> String {
    match remark {
        Remark::OtherPoses(_) => "; --json lists them".into(),
        Remark::SizesDiffer(_) => format!(" {size_advice}"),
        Remark::OtherSize(_) => "; see --scale".into(),
        Remark::OffTarget(_) => ". Crop it, give a depth image's --mask, or check the model".into(),
        Remark::OpenAxis(_)
        | Remark::AnyRotation
        | Remark::OpenSlide(_)
        | Remark::LeftOut(_)
        | Remark::Mirrored
        | Remark::SeenThrough(_)
        | Remark::Fold(..) => String::new(),
    }
}
