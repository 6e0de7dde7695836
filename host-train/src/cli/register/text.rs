//! What is printed.

use crate::pose64::Pose64;
use crate::register::request::Done;
use reagent_core::pipeline::Refinement;
use reagent_core::polish::Refined;
use reagent_core::verdict::{Percent, Verdict};

/// Pose, stages and verdict.
pub(super) fn report(done: &Done) -> String {
    let Done {
        found,
        dense,
        pose,
        ms,
        ..
    } = done;
    let mut text = String::from("target_from_source, rows of [R | t] in the clouds' units:\n");
    text += &format!("{pose}\n");
    let answer = &found.answer;
    if let Some(policy) = answer.policy {
        let (verdict, steps) = (policy.verdict, policy.steps);
        text += &format!("policy: {verdict} after {steps} steps\n");
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
    if let Some(refinement) = &answer.refinement {
        text += &left_out(&refinement.refined);
        if answer.verdict == Verdict::SizesDiffer {
            text += &sizes(refinement.refined.extents_ratio);
        }
        if answer.verdict == Verdict::Mirrored {
            text += "the mirror image of the source fits better: a left-hand part for a right-hand one, an axis the other way around, or a wrong pose of a symmetric shape\n";
        }
        let percent = Percent(refinement.evidence.probability());
        let open = &refinement.undetermined;
        let up_to = match open.axis.is_some() || open.poses.iter().any(Option::is_some) {
            true => ", up to what is undetermined",
            false => "",
        };
        text += &format!("right within 5 degrees and .05 target radii{up_to}: {percent}\n");
    } else {
        text += "how probably it is right is not known of the policy alone: see --mode verify\n";
    }
    if let Some(start) = done.start {
        text += &format!("from start number {}\n", start + 1);
    }
    for other in &done.others {
        text += &format!(
            "next best: residual {:.3}, right within 5 degrees and .05 target radii, had it been given out: {}\n",
            other.refined.residual.mean(),
            Percent(other.probability)
        );
    }
    text + &format!("{}, {ms:.1} ms\n", answer.verdict)
}

/// The matrix `[R | t; 0 0 0 1]`, a row a line, in the shortest digits that read back the same.
pub(super) fn matrix(pose: &Pose64) -> String {
    let rows = pose.to_rows().into_iter().chain([[0.0, 0.0, 0.0, 1.0]]);
    let line = |row: [f64; 4]| row.map(|x| x.to_string()).join(" ") + "\n";
    rows.map(line).collect()
}

/// A line a stage.
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
        "polish: {} after {} iterations\n",
        residual(&found.polished),
        found.polished.iterations
    );
    if let Some(tried) = found.hypotheses {
        let kept = if found.refined == found.polished {
            "kept"
        } else {
            "replaced"
        };
        text += &format!(
            "verify: {kept} against {tried} other poses, {}\n",
            residual(&found.refined)
        );
    }
    text += &format!(
        "{:.0} % of the source lies on the target, {:.3e} off it (root mean square)\n",
        100.0 * found.refined.overlap,
        found.refined.inlier_rmse
    );
    let matrix = &found.refined.covariance.matrix;
    let deviation = |i: usize| f64::from(matrix[i][i]).sqrt();
    let [a, b, c] = [0, 1, 2].map(|i| deviation(i).to_degrees());
    let [x, y, z] = [3, 4, 5].map(deviation);
    text += &format!(
        "if right, off by {a:.2}, {b:.2}, {c:.2} degrees about the target's axes and {x:.1e}, {y:.1e}, {z:.1e} along them (standard deviations)\n"
    );
    let open = &found.undetermined;
    if let Some(axis) = open.axis {
        let [x, y, z] = axis.direction.to_array();
        let angle = axis.half_angle_rad.to_degrees();
        text += &format!(
            "undetermined: the turn about the target's axis ({x:.3}, {y:.3}, {z:.3}), by up to {angle:.0} degrees\n"
        );
    }
    let others = open.poses.iter().flatten().count();
    if others > 0 {
        text += &format!("undetermined: {others} other pose(s) fit as well; --json lists them\n");
    }
    text
}

/// That some points were not looked at.
fn left_out(refined: &Refined) -> String {
    let clouds = ["source", "target"].into_iter().zip(refined.left_out);
    let some = clouds.filter(|&(_, share)| share > 0.0);
    let line = |(of, share)| {
        let percent = 100.0 * share;
        format!("left out: {percent:.1} % of the {of}'s points, far from all others\n")
    };
    some.map(line).collect()
}

/// That one cloud is several times as large as the other.
fn sizes(ratio: f32) -> String {
    let factor = ratio.max(1.0 / ratio.max(f32::MIN_POSITIVE));
    let which = if ratio > 1.0 { "source" } else { "target" };
    format!(
        "sizes differ: the {which} is about {factor:.1} times as large as the other cloud; inch (25.4), cm (10) or m (1000) against mm? See --unit and --scale\n"
    )
}
