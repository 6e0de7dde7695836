//! Sweeps: errors over what was varied, as box plots, means and tables.

use super::chart::{Axis, BoxStats, Boxes, Chart, Line, Marks, palette, slug};
use super::input::{Sample, Sweep, Varied};
use super::metric::{Metric, sort};
use super::section::{Block, Section};
use super::table::{Rows, Table};

/// Metrics of which the mean or median is drawn as a curve.
const CURVES: [&str; 4] = ["r_iso_deg", "t_iso", "adi_auc_pct", "recall_r5_t005"];

/// The section of one sweep.
pub(super) fn section(sweep: &Sweep) -> Section {
    let mut blocks = Vec::new();
    for varied in &sweep.varied {
        let mut charts = box_plots(&sweep.name, varied);
        charts.extend(CURVES.iter().map(|key| curve(&sweep.name, varied, key)));
        charts.retain(Chart::has_data);
        let pairs = varied
            .pairs
            .map_or(String::new(), |n| format!(", {n} pairs a value"));
        blocks.push(Block::Charts(
            format!("Varied: {}{pairs}", titled(varied)),
            charts,
        ));
        blocks.push(Block::More(
            format!("Table: {}", varied.vary.replace('_', " ")),
            vec![Block::Table(table(varied))],
        ));
    }
    Section {
        title: format!("Sweep: {}", sweep.name),
        blocks,
    }
}

fn titled(varied: &Varied) -> String {
    let name = varied.vary.replace('_', " ");
    match varied.unit.as_str() {
        unit if unit.is_empty() || unit == name => name,
        unit => format!("{name}, {unit}"),
    }
}

/// The values at which any method was measured.
fn values(varied: &Varied) -> Vec<f64> {
    let mut values: Vec<f64> = varied
        .methods
        .iter()
        .flat_map(|(_, samples)| samples.iter().map(|s| s.value))
        .collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

/// Whether values, such as numbers of points, grow by factors rather than by differences.
fn spans_decades(values: &[f64]) -> bool {
    match values {
        [first, .., last] => *first > 0.0 && last / first > 12.0,
        _ => false,
    }
}

fn colours(varied: &Varied) -> Vec<usize> {
    palette(varied.methods.iter().map(|(name, _)| name.as_str()))
}

fn box_plots(name: &str, varied: &Varied) -> Vec<Chart> {
    let samples = varied.methods.iter().flat_map(|(_, samples)| samples);
    let mut keys: Vec<String> = samples.flat_map(|s| s.errors.keys().cloned()).collect();
    keys.sort();
    keys.dedup();
    sort(&mut keys);
    let values = values(varied);
    let colours = colours(varied);
    let chart = |key: &String| {
        let metric = Metric::of(key);
        let stats = |sample: &Sample| {
            let scaled: Vec<f64> = sample
                .errors
                .get(key)?
                .iter()
                .map(|e| e * metric.factor)
                .collect();
            BoxStats::of(&scaled)
        };
        let group = |(colour, (method, samples)): (&usize, &(String, Vec<Sample>))| Boxes {
            name: method.clone(),
            colours: vec![*colour; values.len()],
            boxes: values
                .iter()
                .map(|value| samples.iter().find(|s| s.value == *value).and_then(stats))
                .collect(),
        };
        Chart {
            name: slug(&format!("{name}-{}-box-{key}", varied.vary)),
            title: metric.titled(),
            x: Axis::linear(titled(varied)),
            y: Axis {
                log: true,
                ..Axis::default()
            },
            marks: Marks::Boxes {
                categories: values.iter().map(f64::to_string).collect(),
                groups: colours.iter().zip(&varied.methods).map(group).collect(),
                horizontal: false,
            },
        }
    };
    keys.iter().map(chart).collect()
}

fn curve(name: &str, varied: &Varied, key: &str) -> Chart {
    let metric = Metric::of(key);
    let line = |(colour, (method, samples)): (&usize, &(String, Vec<Sample>))| {
        let point = |s: &Sample| {
            let y = s.summary.get(key).map_or(f64::NAN, |v| v * metric.factor);
            (s.value, y)
        };
        Line::new(method.clone(), *colour, samples.iter().map(point).collect())
    };
    let mean = if metric.log { "mean " } else { "" };
    Chart {
        name: slug(&format!("{name}-{}-{key}", varied.vary)),
        title: format!("{mean}{}", metric.titled()),
        x: Axis {
            log: spans_decades(&values(varied)),
            ..Axis::linear(titled(varied))
        },
        y: Axis {
            log: metric.log,
            ..Axis::default()
        },
        marks: Marks::Lines(
            colours(varied)
                .iter()
                .zip(&varied.methods)
                .map(line)
                .collect(),
        ),
    }
}

fn table(varied: &Varied) -> Table {
    let rows = varied.methods.iter().flat_map(|(method, samples)| {
        samples
            .iter()
            .map(|s| (vec![method.clone(), s.value.to_string()], &s.summary))
    });
    let value = titled(varied);
    let rows = Rows {
        labels: &["method", &value],
        rows: rows.collect(),
        compare: false,
        without: &[],
    };
    Table::of_metrics(format!("Over {value}"), &rows)
}
