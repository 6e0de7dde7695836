//! Training runs: what was run, what the best epoch reached, and every number of the log as a curve.

use super::chart::{Axis, Chart, Line, Marks, slug};
use super::input::{Record, Run};
use super::metric::Metric;
use super::section::{Block, Section};
use super::table::{Cell, Table};
use reagent_core::dims::STEP_SIZES;
use reagent_core::steps::STEPS;
use serde_json::Value;

/// Groups of curves: heading, and what the keys of its members begin with. What fits nowhere comes last.
const GROUPS: [(&str, &[&str]); 4] = [
    ("Validation, by epoch", &["validation."]),
    (
        "Behaviour, by update",
        &["agreement", "reward", "action_histogram"],
    ),
    (
        "Loss and its parts, by update",
        &["loss", "clone", "policy", "value", "entropy"],
    ),
    ("Optimisation", &[""]),
];

/// Curves of one chart at most.
const CURVES: usize = 16;

/// The section of all runs, overlaid.
pub(super) fn section(runs: &[Run]) -> Section {
    let mut blocks = vec![Block::Table(table(runs))];
    let mut curves = curves(runs, "update", |run| &run.updates);
    curves.extend(epoch_curves(runs));
    let mut constant: Vec<String> = Vec::new();
    curves.retain(|(_, chart)| match constant_value(chart) {
        Some(value) => {
            constant.push(format!("{} {value}", chart.title));
            false
        }
        None => chart.has_data(),
    });
    let group = |key: &str| {
        let fits = |(_, starts): &(&str, &[&str])| starts.iter().any(|s| key.starts_with(s));
        GROUPS.iter().position(fits).unwrap_or(GROUPS.len() - 1)
    };
    for (i, (heading, _)) in GROUPS.iter().enumerate() {
        let (of_group, rest): (Vec<_>, Vec<_>) =
            curves.into_iter().partition(|(key, _)| group(key) == i);
        curves = rest;
        let charts: Vec<Chart> = of_group.into_iter().map(|(_, chart)| chart).collect();
        if !charts.is_empty() {
            blocks.push(Block::Charts((*heading).into(), charts));
        }
    }
    if !constant.is_empty() {
        let text = format!(
            "The same throughout, and not drawn: {}.",
            constant.join("; ")
        );
        blocks.push(Block::Text(text));
    }
    let listings = runs.iter().flat_map(|run| {
        let text = serde_json::to_string_pretty(&run.config).unwrap_or_default();
        [Block::Text(run.name.clone()), Block::Listing(text)]
    });
    blocks.push(Block::More("Configurations".into(), listings.collect()));
    Section {
        title: if runs.len() == 1 {
            "Training run"
        } else {
            "Training runs"
        }
        .into(),
        blocks,
    }
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
        let line = |run: &'a Run, name: &str, of: &dyn Fn(&[f64]) -> f64| {
            let point = |r: &Record| Some((r.x, metric.factor * of(r.fields.get(key)?)));
            Line::new(name, records(run).iter().filter_map(point).collect())
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
                .filter(|run| have(records(*run), key))
                .map(|run| line(run, &name(run), &first));
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
                .map(|(name, members)| {
                    let sum = |values: &[f64]| members.iter().filter_map(|i| values.get(*i)).sum();
                    line(run, &name, &sum)
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
fn constant_value(chart: &Chart) -> Option<f64> {
    let Marks::Lines(lines) = &chart.marks else {
        return None;
    };
    let mut values = lines.iter().flat_map(Line::finite).map(|p| p.1);
    let first = values.next()?;
    let mut others = values.peekable();
    others.peek()?;
    others.all(|v| v == first).then_some(first)
}

/// What was run, and the errors of the epoch with the lowest modified Chamfer distance, which is the
/// trainer's choice too.
fn table(runs: &[Run]) -> Table {
    const CONFIG: [&str; 4] = ["stage", "epochs", "points", "seed"];
    const REACHED: [&str; 5] = [
        "r_iso_deg",
        "r_iso_median_deg",
        "t_iso",
        "adi_auc_pct",
        "recall_r5_t005",
    ];
    let plain = |name: &str| (name.to_owned(), String::new());
    let mut columns = vec![plain("run")];
    columns.extend(CONFIG.map(plain));
    columns.extend(["updates", "best epoch"].map(plain));
    columns.extend(REACHED.map(|key| {
        let metric = Metric::of(key);
        (
            format!("validation {}", metric.label),
            metric.unit.to_owned(),
        )
    }));
    let row = |run: &Run| {
        let config = |key: &str| match run.config.get(key) {
            Some(Value::String(text)) => text.clone(),
            Some(value) if value.is_number() => value.to_string(),
            _ => "–".into(),
        };
        let validated = |record: &Record, key: &str| {
            let values = record.fields.get(&format!("validation.{key}"));
            values.and_then(|v| v.first().copied()).unwrap_or(f64::NAN)
        };
        let chamfer = |r: &&Record| validated(r, "chamfer_mod");
        let best = run
            .epochs
            .iter()
            .filter(|r| chamfer(r).is_finite())
            .min_by(|a, b| chamfer(a).total_cmp(&chamfer(b)));
        let mut cells = vec![Cell::new(run.name.clone())];
        cells.extend(CONFIG.map(|key| Cell::new(config(key))));
        let updates = run.updates.last().map_or(0.0, |r| r.x + 1.0);
        cells.push(Cell::new(updates.to_string()));
        cells.push(Cell::new(best.map_or("–".into(), |r| r.x.to_string())));
        cells.extend(REACHED.map(|key| {
            let value = best.map_or(f64::NAN, |r| validated(r, key));
            Cell::new(Metric::of(key).print(value))
        }));
        cells
    };
    Table {
        caption: "Runs, and the errors of their best epoch on validation meshes".into(),
        columns,
        labels: 1,
        rows: runs.iter().map(row).collect(),
    }
}
