//! Evaluations: the paper's tables, box plots, recall curves, errors by step and time.

use super::chart::{Axis, BoxStats, Boxes, Chart, Line, Marks, palette, slug};
use super::input::Evaluation;
use super::metric::{Metric, sort};
use super::reliability;
use super::section::{Block, Section};
use super::table::{Rows, Table};
use super::value::Fields;
use std::collections::BTreeMap;

/// Metrics whose course over the steps is drawn.
const STEP_CHARTS: [&str; 6] = [
    "r_iso_deg",
    "r_iso_median_deg",
    "t_iso",
    "adi_auc_pct",
    "chamfer_mod",
    "recall_r5_t005",
];
/// Points of a recall curve.
const THRESHOLDS: usize = 100;

/// The section of one evaluation.
pub(super) fn section(evaluation: &Evaluation) -> Section {
    let mut blocks = Vec::new();
    if !evaluation.about.is_empty() {
        let about: Vec<String> = evaluation
            .about
            .iter()
            .map(|(k, v)| format!("{k}: {v}"))
            .collect();
        blocks.push(Block::Text(about.join(" · ")));
    }
    if !evaluation.methods.is_empty() {
        let rows = Rows {
            labels: &["method"],
            rows: evaluation
                .methods
                .iter()
                .map(|(name, m)| (vec![name.clone()], m))
                .collect(),
            compare: true,
            without: &[],
        };
        let caption = "Methods on the same pairs. Lengths are in the clouds' units (normalised in the paper's protocols); the best of each column is bold. Recall counts pairs below 5 degrees and .05 units.";
        blocks.push(Block::Table(Table::of_metrics(caption, &rows)));
    }
    if !evaluation.objects.is_empty() {
        blocks.push(Block::Table(objects(evaluation)));
    }
    let mut errors = recall_curves(evaluation);
    errors.extend(box_plots(evaluation));
    charts(&mut blocks, "Errors over the pairs", errors);
    let outcomes = reliability::outcomes(evaluation);
    let verdicts =
        reliability::charts(&evaluation.name, &outcomes, |name| colour(evaluation, name));
    charts(&mut blocks, "How far verdicts can be trusted", verdicts);
    let mut steps = step_charts(evaluation);
    steps.extend(time_chart(evaluation));
    charts(&mut blocks, "Errors by step and time", steps);
    let tables: Vec<Block> = evaluation.per_step.iter().map(step_table).collect();
    if !tables.is_empty() {
        blocks.push(Block::More("Tables step by step".into(), tables));
    }
    Section {
        title: format!("Evaluation: {}", evaluation.name),
        blocks,
    }
}

/// Place of a method's colour in the palette.
fn colour(evaluation: &Evaluation, method: &str) -> usize {
    let methods = || evaluation.methods.iter().map(|(name, _)| name.as_str());
    let place = methods().position(|name| name == method);
    place.map_or(0, |place| palette(methods())[place])
}

pub(super) fn charts(blocks: &mut Vec<Block>, heading: &str, charts: Vec<Chart>) {
    let charts: Vec<Chart> = charts.into_iter().filter(Chart::has_data).collect();
    if !charts.is_empty() {
        blocks.push(Block::Charts(heading.into(), charts));
    }
}

/// A row for each object and method, in whatever order they are nested.
fn objects(evaluation: &Evaluation) -> Table {
    let found = &evaluation.objects;
    let deepest = found
        .iter()
        .map(|(names, _)| names.len())
        .max()
        .unwrap_or(0);
    let is_method = |name: &String| evaluation.methods.iter().any(|(method, _)| method == name);
    let outer_method = found
        .iter()
        .all(|(names, _)| names.first().is_some_and(is_method));
    let labels = if outer_method {
        ["method", "object", "", ""]
    } else {
        ["object", "method", "", ""]
    };
    let labels: Vec<&str> = labels.into_iter().take(deepest).collect();
    let named = |names: &[String]| {
        let mut names = names.to_vec();
        names.resize(deepest, String::new());
        names
    };
    let rows = Rows {
        labels: &labels,
        rows: found.iter().map(|(names, m)| (named(names), m)).collect(),
        compare: false,
        without: &[],
    };
    Table::of_metrics("By object", &rows)
}

fn step_table((name, rows): &(String, Vec<Fields>)) -> Block {
    let label = |row: &Fields| match row.get("step") {
        Some(step) if *step == 0.0 => "init".into(),
        Some(step) => step.to_string(),
        None => String::new(),
    };
    let rows = Rows {
        labels: &["step"],
        rows: rows.iter().map(|row| (vec![label(row)], row)).collect(),
        compare: true,
        without: &["step"],
    };
    Block::Table(Table::of_metrics(
        format!("{name}, step by step; times are cumulative"),
        &rows,
    ))
}

/// Metrics that any method has errors of.
fn metrics<'a>(errors: impl Iterator<Item = &'a BTreeMap<String, Vec<f64>>>) -> Vec<String> {
    let mut keys: Vec<String> = errors.flat_map(|e| e.keys().cloned()).collect();
    keys.sort();
    keys.dedup();
    sort(&mut keys);
    keys
}

fn box_plots(evaluation: &Evaluation) -> Vec<Chart> {
    let keys = metrics(evaluation.errors.iter().map(|(_, e)| e));
    let chart = |key: &String| {
        let metric = Metric::of(key);
        let stats = |errors: &BTreeMap<String, Vec<f64>>| {
            let scaled: Vec<f64> = errors.get(key)?.iter().map(|e| e * metric.factor).collect();
            BoxStats::of(&scaled)
        };
        Chart {
            name: slug(&format!("{}-box-{key}", evaluation.name)),
            title: metric.label.clone(),
            x: Axis {
                label: metric.unit.into(),
                log: true,
                range: None,
            },
            y: Axis::default(),
            marks: Marks::Boxes {
                categories: evaluation
                    .errors
                    .iter()
                    .map(|(name, _)| name.clone())
                    .collect(),
                groups: vec![Boxes {
                    name: String::new(),
                    colours: evaluation
                        .errors
                        .iter()
                        .map(|(name, _)| colour(evaluation, name))
                        .collect(),
                    boxes: evaluation.errors.iter().map(|(_, e)| stats(e)).collect(),
                }],
                horizontal: true,
            },
        }
    };
    keys.iter().map(chart).collect()
}

/// Share of pairs below a threshold, over the threshold: ADI and ADD up to a tenth of the diameter, rotation
/// to 20 degrees.
fn recall_curves(evaluation: &Evaluation) -> Vec<Chart> {
    let curves = [
        ("adi", 0.1, "ADI recall", "ADI threshold, % of diameter"),
        ("add", 0.1, "ADD recall", "ADD threshold, % of diameter"),
        ("r_iso_deg", 20.0, "Rotation recall", "ISO R threshold, deg"),
    ];
    let chart = |(key, last, title, label): &(&str, f64, &str, &str)| {
        let factor = Metric::of(key).factor;
        let line = |(name, errors): &(String, BTreeMap<String, Vec<f64>>)| {
            let errors = errors.get(*key)?;
            let point = |i: usize| {
                let threshold = last * i as f64 / THRESHOLDS as f64;
                let below = errors.iter().filter(|e| **e <= threshold).count();
                (
                    threshold * factor,
                    100.0 * below as f64 / errors.len() as f64,
                )
            };
            let mut line = Line::new(
                name.clone(),
                colour(evaluation, name),
                (0..=THRESHOLDS).map(point).collect(),
            );
            line.dots = false;
            Some(line)
        };
        Chart {
            name: slug(&format!("{}-recall-{key}", evaluation.name)),
            title: (*title).into(),
            x: Axis {
                range: Some((0.0, last * factor)),
                ..Axis::linear(*label)
            },
            y: Axis {
                range: Some((0.0, 102.0)),
                ..Axis::linear("pairs, %")
            },
            marks: Marks::Lines(evaluation.errors.iter().filter_map(line).collect()),
        }
    };
    curves.iter().map(chart).collect()
}

fn step_charts(evaluation: &Evaluation) -> Vec<Chart> {
    let chart = |key: &&str| {
        let metric = Metric::of(key);
        let line = |(name, rows): &(String, Vec<Fields>)| {
            let point = |(i, row): (usize, &Fields)| {
                let step = row.get("step").copied().unwrap_or(i as f64);
                (step, row.get(*key).map_or(f64::NAN, |v| v * metric.factor))
            };
            Line::new(
                name.clone(),
                colour(evaluation, name),
                rows.iter().enumerate().map(point).collect(),
            )
        };
        Chart {
            name: slug(&format!("{}-step-{key}", evaluation.name)),
            title: metric.titled(),
            x: Axis::linear("step"),
            y: Axis {
                log: metric.log,
                ..Axis::default()
            },
            marks: Marks::Lines(evaluation.per_step.iter().map(line).collect()),
        }
    };
    STEP_CHARTS.iter().map(chart).collect()
}

/// Median rotation error over time: a curve for a policy step by step, a point for any other method.
fn time_chart(evaluation: &Evaluation) -> Option<Chart> {
    let point = |row: &Fields| {
        let (ms, error) = (row.get("ms_median")?, row.get("r_iso_median_deg")?);
        (*ms > 0.0).then_some((*ms, *error))
    };
    let line = |(name, row): &(String, Fields)| {
        let steps = evaluation
            .per_step
            .iter()
            .find(|(method, _)| method == name);
        let points: Vec<(f64, f64)> = match steps {
            Some((_, rows)) => rows.iter().filter_map(point).collect(),
            None => point(row).into_iter().collect(),
        };
        (!points.is_empty()).then(|| Line::new(name.clone(), colour(evaluation, name), points))
    };
    let lines: Vec<Line> = evaluation.methods.iter().filter_map(line).collect();
    let log = |label: &str| Axis {
        log: true,
        ..Axis::linear(label)
    };
    (!lines.is_empty()).then(|| Chart {
        name: slug(&format!("{}-time", evaluation.name)),
        title: "Accuracy against time".into(),
        x: log("time of one registration, ms"),
        y: log("ISO R median, deg"),
        marks: Marks::Lines(lines),
    })
}
