//! Training runs: what was run, what the best epoch reached, and every number of the log as a curve.

use super::chart::Chart;
use super::curves;
use super::input::{Record, Run};
use super::metric::{Metric, place};
use super::section::{Block, Section};
use super::table::{Cell, Table};
use serde_json::Value;

/// Groups of curves: heading, and what the keys of its members begin with. What fits nowhere comes last.
const GROUPS: [(&str, &[&str]); 4] = [
    ("Validation, by epoch", &["validation."]),
    (
        "Behaviour, by update",
        &["reward", "agreement", "action_histogram"],
    ),
    (
        "Loss and its parts, by update",
        &["loss", "clone", "policy", "value", "entropy"],
    ),
    ("Optimisation", &[""]),
];

/// The section of all runs, overlaid.
pub(super) fn section(runs: &[Run]) -> Section {
    let mut blocks = vec![Block::Table(table(runs))];
    let mut curves = curves::all(runs);
    let mut constant: Vec<String> = Vec::new();
    curves.retain(|(_, chart)| match curves::constant_value(chart) {
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
    for (i, (heading, starts)) in GROUPS.iter().enumerate() {
        let (of_group, rest): (Vec<_>, Vec<_>) =
            curves.into_iter().partition(|(key, _)| group(key) == i);
        curves = rest;
        let mut of_group = of_group;
        let order = |key: &str| {
            let start = starts.iter().position(|start| key.starts_with(start));
            (start, place(key.rsplit('.').next().unwrap_or(key)))
        };
        of_group.sort_by_key(|(key, _)| order(key));
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
