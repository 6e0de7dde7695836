//! Calibrations: how well the built-in probability tells right poses from wrong ones, by kind of pairs.

use super::chart::palette;
use super::evaluation::charts;
use super::input::{Calibration, Outcomes};
use super::reliability;
use super::section::{Block, Section};
use super::table::{Cell, Table};
use std::collections::BTreeSet;

/// Numbers of a line: key, heading, digits.
const NUMBERS: [(&str, &str, usize); 5] = [
    ("count", "pairs", 0),
    ("right", "share right", 3),
    ("auc", "area under ROC", 4),
    ("brier", "Brier score", 4),
    ("risk_coverage", "risk over coverage", 4),
];

/// The section of one calibration.
pub(super) fn section(calibration: &Calibration) -> Section {
    let mut columns = vec![("mode, pairs".into(), String::new())];
    columns.extend(NUMBERS.map(|(_, heading, _)| (heading.into(), String::new())));
    let row = |(pairs, numbers, _): &(String, _, _)| {
        let numbers: &super::value::Fields = numbers;
        let cell = |(key, _, digits): (&str, &str, usize)| {
            let number = numbers.get(key).filter(|x| x.is_finite());
            Cell::new(number.map_or(String::new(), |x| format!("{x:.digits$}")))
        };
        let mut cells = vec![Cell::new(pairs)];
        cells.extend(NUMBERS.map(cell));
        cells
    };
    let mut blocks = vec![Block::Table(Table {
        caption: "The probability that a verdict gives, on meshes held back. Right is within 5 degrees and .05 target radii of the truth, or not to be told from it (ADI below .02 diameters); a target of another mesh never is.".into(),
        columns,
        labels: 1,
        rows: calibration.lines.iter().map(row).collect(),
    })];
    // The mode is the first word of a line.
    let split = |pairs: &'_ String| {
        pairs
            .split_once(' ')
            .map(|(m, k)| (m.to_owned(), k.to_owned()))
    };
    let lines = calibration.lines.iter();
    let modes: BTreeSet<String> = lines
        .filter_map(|(pairs, ..)| Some(split(pairs)?.0))
        .collect();
    for mode in modes {
        let of = |(pairs, _, outcomes): &'_ (String, _, Outcomes)| {
            let (of, kind) = split(pairs)?;
            (of == mode).then(|| (kind, outcomes.clone()))
        };
        let found: Vec<(String, Outcomes)> = calibration.lines.iter().filter_map(of).collect();
        let lines: Vec<(&str, Outcomes)> = found
            .iter()
            .map(|(kind, outcomes)| (kind.as_str(), outcomes.clone()))
            .collect();
        let colours = palette(lines.iter().map(|(kind, _)| *kind));
        let colour = |kind: &str| {
            let place = lines.iter().position(|(name, _)| *name == kind);
            place.map_or(0, |place| colours[place])
        };
        let name = format!("{}-{mode}", calibration.name);
        let drawn = reliability::charts(&name, &lines, colour);
        charts(&mut blocks, &format!("{mode}, by kind of pairs"), drawn);
    }
    Section {
        title: format!("Calibration: {}", calibration.name),
        blocks,
    }
}
