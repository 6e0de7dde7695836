//! Tables of numbers with units and fixed digits.

use super::metric::{Better, Metric, sort};
use super::value::Fields;

/// A table: texts of rows and columns.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    /// What it shows.
    pub caption: String,
    /// Name and unit of each column; the first `labels` columns name the rows.
    pub columns: Vec<(String, String)>,
    /// Columns that name the rows.
    pub labels: usize,
    /// Cells of each row.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Cell {
    /// Its text.
    pub text: String,
    /// Best value of its column.
    pub best: bool,
}

impl Cell {
    pub(crate) fn new(text: impl Into<String>) -> Cell {
        Cell {
            text: text.into(),
            best: false,
        }
    }
}

/// What rows of metrics are called, and whether they compete.
pub(crate) struct Rows<'a> {
    /// Headings of the columns that name a row.
    pub labels: &'a [&'a str],
    /// Names and metrics of each row.
    pub rows: Vec<(Vec<String>, &'a Fields)>,
    /// Mark the best value of each column.
    pub compare: bool,
    /// Metrics that are not shown.
    pub without: &'a [&'a str],
}

impl Table {
    /// A table with one column for each metric that any row has, in the paper's order.
    pub(crate) fn of_metrics(caption: impl Into<String>, rows: &Rows<'_>) -> Table {
        let mut keys: Vec<String> = rows
            .rows
            .iter()
            .flat_map(|(_, m)| m.keys().cloned())
            .collect();
        keys.sort();
        keys.dedup();
        keys.retain(|key| !rows.without.contains(&key.as_str()));
        sort(&mut keys);
        let metrics: Vec<Metric> = keys.iter().map(|key| Metric::of(key)).collect();
        let number = |fields: &Fields, key: &str| fields.get(key).copied().unwrap_or(f64::NAN);
        let best: Vec<Option<String>> = keys
            .iter()
            .zip(&metrics)
            .map(|(key, metric)| {
                let better = match metric.better {
                    Better::Lower => f64::min,
                    Better::Higher => f64::max,
                    Better::Neither => return None,
                };
                // Doing nothing does not compete.
                let finite = rows
                    .rows
                    .iter()
                    .filter(|(names, _)| names.first().is_none_or(|name| name != "init"))
                    .map(|(_, m)| number(m, key))
                    .filter(|v| v.is_finite());
                let best = finite.reduce(better)?;
                (rows.compare && rows.rows.len() > 1).then(|| metric.print(best))
            })
            .collect();
        let cells = |(names, fields): &(Vec<String>, &Fields)| {
            let numbers = keys
                .iter()
                .zip(&metrics)
                .zip(&best)
                .map(|((key, metric), best)| {
                    let text = metric.print(number(fields, key));
                    Cell {
                        best: best.as_ref() == Some(&text),
                        text,
                    }
                });
            names.iter().map(Cell::new).chain(numbers).collect()
        };
        let labels = rows
            .labels
            .iter()
            .map(|label| ((*label).to_owned(), String::new()));
        let columns = metrics.iter().map(|m| (m.label.clone(), m.unit.to_owned()));
        Table {
            caption: caption.into(),
            columns: labels.chain(columns).collect(),
            labels: rows.labels.len(),
            rows: rows.rows.iter().map(cells).collect(),
        }
    }
}
