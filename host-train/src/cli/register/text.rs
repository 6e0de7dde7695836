//! What is printed.

use crate::dense::Densely;
use crate::pose64::Pose64;
use crate::refine::Refinement;
use crate::register::Registered;
use reagent_core::polish::Refined;

/// Pose, stages and verdict.
pub(super) fn report(
    found: &Registered,
    dense: Option<&Densely>,
    pose: &Pose64,
    ms: f64,
) -> String {
    let mut text = String::from("target_from_source, rows of [R | t] in the clouds' units:\n");
    for [a, b, c, t] in pose.to_rows() {
        // All digits of a translation, and of a rotation as many as a translation at 5,000 km needs.
        text += &format!("{a:17.14} {b:17.14} {c:17.14} {:>20}\n", shown(t));
    }
    text += &format!(
        "policy: {} after {} steps\n",
        found.policy.0,
        found.trace.len()
    );
    if let Some(refinement) = &found.refinement {
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
    if let Some(refinement) = &found.refinement {
        let percent = 100.0 * refinement.evidence.probability();
        text += &format!("right within 5 degrees and .05 target radii: {percent:.0} %\n");
    }
    text + &format!("{}, {ms:.1} ms\n", found.verdict)
}

/// Ten significant digits, and at least one of a micrometre at 1,000 km.
fn shown(length: f64) -> String {
    let before = length.abs().max(1e-300).log10().floor().max(0.0) as usize;
    format!("{length:.*}", 15usize.saturating_sub(before).min(9).max(1))
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
    match found.hypotheses {
        None => {}
        Some(0) => text += "verify: explained by how the clouds are sampled\n",
        Some(tried) => {
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
    }
    text
}
