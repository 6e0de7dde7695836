//! Reports: training runs, evaluations, sweeps and traces as one HTML file, and their charts as images.
//!
//! `input` reads and checks files; `run`, `evaluation`, `calibration`, `sweep` and `views` make sections of tables, charts
//! and registrations of them; `page` writes the HTML file, `chart` the images.

mod calibration;
mod chart;
mod curves;
mod error;
mod evaluation;
mod input;
mod metric;
mod page;
mod reliability;
mod run;
mod section;
mod sweep;
mod table;
mod try_page;
mod value;
mod views;

pub use error::ReportError;
pub use try_page::{PageError, try_page};

use crate::files;
use crate::register::trace::Traced;
use chart::Chart;
use input::{Input, Run, TraceFile};
use section::Section;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A report, ready to be written.
#[derive(Debug)]
pub struct Report {
    sections: Vec<Section>,
    notes: Vec<String>,
}

impl Report {
    /// Reads the inputs: run directories, JSON documents of `eval`, `sweep` and `calibrate`, traces.
    ///
    /// # Errors
    /// The first input that cannot be read, or is not what it should be.
    pub fn read(paths: &[PathBuf]) -> Result<Report, ReportError> {
        let (mut runs, mut evaluations, mut calibrations, mut sweeps, mut traces) = (
            Vec::<Run>::new(),
            Vec::new(),
            Vec::new(),
            Vec::new(),
            Vec::<TraceFile>::new(),
        );
        for (path, name) in paths.iter().zip(names(paths)) {
            match input::read(path, name)? {
                Input::Run(run) => runs.push(run),
                Input::Evaluation(evaluation) => evaluations.push(evaluation),
                Input::Calibration(calibration) => calibrations.push(calibration),
                Input::Sweep(sweep) => sweeps.push(sweep),
                Input::Trace(trace) => traces.push(trace),
            }
        }
        let mut notes: Vec<String> = runs.iter().filter_map(|run| run.note.clone()).collect();
        let mut sections: Vec<Section> = evaluations.iter().map(evaluation::section).collect();
        sections.extend(calibrations.iter().map(calibration::section));
        if !traces.is_empty() {
            let (section, left_out) = views::section(&traces);
            sections.push(section);
            notes.extend(left_out);
        }
        sections.extend(sweeps.iter().map(sweep::section));
        if !runs.is_empty() {
            sections.push(run::section(&runs));
        }
        Ok(Report { sections, notes })
    }

    /// Of registrations, to turn and step through.
    pub fn of_registrations(traced: Vec<Traced>) -> Report {
        let count = traced.len();
        let file = TraceFile {
            name: "registrations".into(),
            traced,
            count,
        };
        let (section, left_out) = views::section(&[file]);
        Report {
            sections: vec![section],
            notes: left_out.into_iter().collect(),
        }
    }

    /// What the reader should know: what was left out, and why.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The report as one HTML document that asks for nothing else.
    ///
    /// # Errors
    /// [`ReportError::Draw`].
    pub fn html(&self) -> Result<String, ReportError> {
        page::html(&self.sections, &self.notes)
    }

    /// Writes every chart into a folder, as `NAME.svg` and `NAME.png`; returns how many there are.
    ///
    /// # Errors
    /// [`ReportError::Draw`], [`ReportError::Write`].
    pub fn write_plots(&self, folder: &Path) -> Result<usize, ReportError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| ReportError::Write { path, source }
        };
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        let charts: Vec<&Chart> = self.sections.iter().flat_map(Section::charts).collect();
        // Names that differ in their signs only must not share a file.
        let mut taken: BTreeMap<&str, usize> = BTreeMap::new();
        for chart in &charts {
            let times = taken.entry(&chart.name).or_default();
            *times += 1;
            let name = match times {
                1 => chart.name.clone(),
                _ => format!("{}_{times}", chart.name),
            };
            let svg = chart::svg(chart)?.into_bytes();
            for (extension, bytes) in [("svg", svg), ("png", chart::png(chart)?)] {
                let path = folder.join(format!("{name}.{extension}"));
                files::write(&path, &bytes).map_err(failed(&path))?;
            }
        }
        Ok(charts.len())
    }
}

/// A name for each input: its file stem, or its path where two inputs of one kind have the same.
fn names(paths: &[PathBuf]) -> Vec<String> {
    let stem = |path: &PathBuf| -> String {
        let path = if path.is_dir() {
            path.clone()
        } else {
            path.with_extension("")
        };
        let last = path.file_name().unwrap_or(path.as_os_str());
        last.to_string_lossy().into_owned()
    };
    let stems: Vec<String> = paths.iter().map(stem).collect();
    let name = |(path, stem): (&PathBuf, &String)| {
        let same = |(p, s): &(&PathBuf, &String)| *s == stem && p.extension() == path.extension();
        if paths.iter().zip(&stems).filter(same).count() == 1 {
            stem.clone()
        } else {
            path.display().to_string()
        }
    };
    paths.iter().zip(&stems).map(name).collect()
}

#[cfg(test)]
mod tests;
