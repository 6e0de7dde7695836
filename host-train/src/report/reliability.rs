//! Whether the probabilities that methods give their poses hold: reliability and risk over coverage.

use super::chart::{Axis, Chart, Line, Marks, slug};
use super::input::{Evaluation, Outcomes};
use crate::measure::metrics::is_right;
use crate::measure::quality::Quality;

/// The outcomes of an evaluation's methods that gave probabilities.
pub(super) fn outcomes(evaluation: &Evaluation) -> Vec<(&str, Outcomes)> {
    let of = |(name, probabilities)| {
        let (_, errors) = evaluation
            .errors
            .iter()
            .find(|(method, _)| method == name)?;
        let (rotations, translations) = (errors.get("r_iso_deg")?, errors.get("t_iso")?);
        let errors = rotations.iter().zip(translations);
        let right = errors.map(|(&r_deg, &t)| is_right(r_deg, t));
        let probabilities: &Vec<f64> = probabilities;
        let outcomes = probabilities.iter().copied().zip(right).collect();
        Some((String::as_str(name), outcomes))
    };
    evaluation.probability.iter().filter_map(of).collect()
}

/// Two charts under a name; `colour` is the place of a line's colour in the palette.
pub(super) fn charts(
    of: &str,
    lines: &[(&str, Outcomes)],
    colour: impl Fn(&str) -> usize,
) -> Vec<Chart> {
    let (mut reliability, mut risk) = (Vec::new(), Vec::new());
    for (name, outcomes) in lines {
        // A pair without a probability says nothing of probabilities.
        let given = outcomes.iter().filter(|(p, _)| p.is_finite());
        let outcomes: Outcomes = given.copied().collect();
        if outcomes.is_empty() {
            continue;
        }
        let colour = colour(name);
        let quality = Quality::of(outcomes.clone());
        let bins = quality.bins.iter().filter(|[_, _, count]| *count > 0.0);
        let points = bins.map(|&[p, right, _]| (100.0 * p, 100.0 * right));
        reliability.push(Line::new(*name, colour, points.collect()));
        let area = 100.0 * quality.risk_coverage;
        let curve = risk_coverage(outcomes);
        let mut line = Line::new(format!("{name}: area {area:.2} %"), colour, curve);
        line.dots = false;
        risk.push(line);
    }
    let percent = |label: &str| Axis {
        range: Some((0.0, 102.0)),
        ..Axis::linear(label)
    };
    let reliability = Chart {
        name: slug(&format!("{of}-reliability")),
        title: "Reliability: within 5 degrees and .05".into(),
        x: percent("probability given, %"),
        y: percent("pairs right, %"),
        marks: Marks::Lines(reliability),
    };
    let risk = Chart {
        name: slug(&format!("{of}-risk-coverage")),
        title: "Risk over coverage, the most probable first".into(),
        x: percent("pairs covered, %"),
        y: Axis::linear("wrong among them, %"),
        marks: Marks::Lines(risk),
    };
    vec![reliability, risk]
}

/// Share of wrong poses, in percent, among the most probable share of pairs.
fn risk_coverage(mut outcomes: Outcomes) -> Vec<(f64, f64)> {
    outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let count = outcomes.len() as f64;
    let mut wrong = 0;
    let point = |(k, (_, right)): (usize, (f64, bool))| {
        wrong += usize::from(!right);
        let covered = (k + 1) as f64;
        (
            100.0 * covered / count,
            100.0 * f64::from(wrong as u32) / covered,
        )
    };
    outcomes.into_iter().enumerate().map(point).collect()
}
