//! Every number of training logs as a curve.

use super::chart::{Axis, Chart, Line, Marks, slug};
use super::input::{Record, Run};
use super::metric::Metric;
use reagent_core::dims::STEP_SIZES;
use reagent_core::steps::STEPS;

/// Curves of one chart at most.
const CURVES: usize = 16;

/// Charts over updates, then those over epochs, each with the key of what it shows.
pub(super) fn all(runs: &[Run]) -> Vec<(String, Chart)> {
    let mut all = curves(runs, "update", |run| &run.updates);
    all.extend(epoch_curves(runs));
    all
}

/// Epoch lines repeat means of what the updates have; only what they add is drawn.
fn epoch_curves(runs: &[Run]) -> Vec<(String, Chart)> {
    let by_update = |key: &str| {
        runs.iter()
            .any(|r| r.updates.iter().any(|u| u.fields.contains_key(key)))
    };
    let mut curves = curves(runs, "epoch", |run| &run.epochs);
    curves.retain(|(key, _)| !by_update(key));
    curves
}

/// A chart for each key of the records, all runs in it; of a list, a chart for each run.
fn curves<'a>(
    runs: &'a [Run],
    x: &str,
    records: impl Fn(&'a Run) -> &'a [Record],
) -> Vec<(String, Chart)> {
    let all = || runs.iter().flat_map(&records);
    let mut keys: Vec<&String> = all().flat_map(|r| r.fields.keys()).collect();
    keys.sort();
    keys.dedup();
    let mut charts = Vec::new();
    for key in keys {
        let longest = all().filter_map(|r| r.fields.get(key)).map(Vec::len).max();
        let (validation, last) = match key.rsplit_once('.') {
            Some((above, last)) => (format!("{}: ", above.replace('_', " ")), last),
            None => (String::new(), key.as_str()),
        };
        let metric = Metric::of(last);
        let chart = |name: String, title: String, lines: Vec<Line>| Chart {
            name: slug(&name),
            title,
            x: Axis::linear(x),
            y: Axis {
                log: metric.log,
                ..Axis::default()
            },
            marks: Marks::Lines(lines),
        };
        let title = format!("{validation}{}", metric.titled());
        // The value of a record, made of those of its list.
        let line = |run: &'a Run, name: &str, colour: usize, of: &dyn Fn(&[f64]) -> f64| {
            let point = |r: &Record| Some((r.x, metric.factor * of(r.fields.get(key)?)));
            Line::new(
                name,
                colour,
                records(run).iter().filter_map(point).collect(),
            )
        };
        if longest == Some(1) {
            let name = |run: &Run| {
                if runs.len() == 1 {
                    String::new()
                } else {
                    run.name.clone()
                }
            };
            let first = |values: &[f64]| values.first().copied().unwrap_or(f64::NAN);
            let lines = runs
                .iter()
                .enumerate()
                .filter(|&(_, run)| have(records(run), key))
                .map(|(i, run)| line(run, &name(run), i, &first));
            charts.push((
                key.clone(),
                chart(format!("train-{x}-{key}"), title, lines.collect()),
            ));
            continue;
        }
        for run in runs {
            let width = records(run)
                .iter()
                .filter_map(|r| r.fields.get(key))
                .map(Vec::len)
                .max();
            // A longer list is no set of curves.
            let Some(width @ 1..=CURVES) = width else {
                continue;
            };
            let lines = parts(width)
                .into_iter()
                .enumerate()
                .map(|(i, (name, members))| {
                    let sum = |values: &[f64]| members.iter().filter_map(|i| values.get(*i)).sum();
                    line(run, &name, i, &sum)
                })
                .collect();
            let (name, title) = if runs.len() == 1 {
                (format!("train-{x}-{key}"), title.clone())
            } else {
                (
                    format!("train-{}-{x}-{key}", run.name),
                    format!("{title}, {}", run.name),
                )
            };
            charts.push((key.clone(), chart(name, title, lines)));
        }
    }
    charts
}

fn have(records: &[Record], key: &str) -> bool {
    records.iter().any(|r| r.fields.contains_key(key))
}

/// Names of the curves of a list, and the elements that each sums: axes of the action, step sizes without
/// their sign, else the elements one by one.
fn parts(width: usize) -> Vec<(String, Vec<usize>)> {
    match width {
        6 => ["t x", "t y", "t z", "R x", "R y", "R z"]
            .into_iter()
            .enumerate()
            .map(|(i, name)| (name.into(), vec![i]))
            .collect(),
        STEP_SIZES => (0..=STEP_SIZES / 2)
            .rev()
            .map(|i| {
                let mirrored = STEP_SIZES - 1 - i;
                let both = if i == mirrored {
                    vec![i]
                } else {
                    vec![i, mirrored]
                };
                (format!("{}", STEPS[mirrored]), both)
            })
            .collect(),
        _ => (0..width).map(|i| (i.to_string(), vec![i])).collect(),
    }
}

/// The value of a chart whose curves never leave it.
pub(super) fn constant_value(chart: &Chart) -> Option<f64> {
    let Marks::Lines(lines) = &chart.marks else {
        return None;
    };
    let mut values = lines.iter().flat_map(Line::finite).map(|p| p.1);
    let first = values.next()?;
    let mut others = values.peekable();
    others.peek()?;
    others.all(|v| v == first).then_some(first)
}
