//! Whether the probabilities that methods give their poses hold: reliability and risk over coverage.

use super::chart::{Axis, Chart, Line, Marks, slug};
use super::input::Evaluation;
use crate::calibrate::Quality;

/// What recall counts: rotation errors in degrees and translation errors below these.
const RIGHT: (f64, f64) = (5.0, 0.05);

/// Two charts; `colour` is the place of a method's colour in the palette.
pub(super) fn charts(evaluation: &Evaluation, colour: impl Fn(&str) -> usize) -> Vec<Chart> {
    let (mut reliability, mut risk) = (Vec::new(), Vec::new());
    for (name, probabilities) in &evaluation.probability {
        let errors = evaluation.errors.iter().find(|(method, _)| method == name);
        let lists = errors.and_then(|(_, e)| Some((e.get("r_iso_deg")?, e.get("t_iso")?)));
        let Some((rotations, translations)) = lists else {
            continue;
        };
        let right = rotations
            .iter()
            .zip(translations)
            .map(|(r, t)| *r < RIGHT.0 && *t < RIGHT.1);
        let outcomes: Vec<(f64, bool)> = probabilities.iter().copied().zip(right).collect();
        if outcomes.is_empty() {
            continue;
        }
        let curve = risk_coverage(outcomes.clone());
        let quality = Quality::of(outcomes);
        let bins = quality.bins.iter().filter(|[_, _, count]| *count > 0.0);
        let points = bins.map(|&[p, right, _]| (100.0 * p, 100.0 * right));
        reliability.push(Line::new(name.clone(), colour(name), points.collect()));
        let area = 100.0 * quality.risk_coverage;
        let mut line = Line::new(format!("{name}: area {area:.2} %"), colour(name), curve);
        line.dots = false;
        risk.push(line);
    }
    let percent = |label: &str| Axis {
        range: Some((0.0, 102.0)),
        ..Axis::linear(label)
    };
    let reliability = Chart {
        name: slug(&format!("{}-reliability", evaluation.name)),
        title: "Reliability: within 5 degrees and .05".into(),
        x: percent("probability given, %"),
        y: percent("pairs right, %"),
        marks: Marks::Lines(reliability),
    };
    let risk = Chart {
        name: slug(&format!("{}-risk-coverage", evaluation.name)),
        title: "Risk over coverage, the most probable first".into(),
        x: percent("pairs covered, %"),
        y: Axis::linear("wrong among them, %"),
        marks: Marks::Lines(risk),
    };
    vec![reliability, risk]
}

/// Share of wrong poses, in percent, among the most probable share of pairs.
fn risk_coverage(mut outcomes: Vec<(f64, bool)>) -> Vec<(f64, f64)> {
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
