//! What a report is made of, read and checked.

mod evaluation;
mod run;

use super::ReportError;
use super::value::{At, Fields, number};
use crate::register::trace::{self, Traced};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Longest document that is read.
const LIMIT: u64 = 256 << 20;
/// Registrations of one trace that are kept.
pub(super) const TRACED: usize = 24;

/// An input of any kind.
#[derive(Debug)]
pub(crate) enum Input {
    Run(Run),
    Evaluation(Evaluation),
    Sweep(Sweep),
    Calibration(Calibration),
    Trace(TraceFile),
}

/// A training run.
#[derive(Debug)]
pub(crate) struct Run {
    pub name: String,
    /// `config.json`.
    pub config: Map<String, Value>,
    /// Lines of `metrics.jsonl` with an `update`.
    pub updates: Vec<Record>,
    /// The other lines.
    pub epochs: Vec<Record>,
    /// What was left out.
    pub note: Option<String>,
}

/// A line of `metrics.jsonl`.
#[derive(Debug)]
pub(crate) struct Record {
    /// Update or epoch.
    pub x: f64,
    /// Its numbers, and its lists of numbers; nested keys are joined by dots.
    pub fields: BTreeMap<String, Vec<f64>>,
}

/// What `eval --json` writes.
#[derive(Debug)]
pub(crate) struct Evaluation {
    pub name: String,
    /// Top-level numbers and texts.
    pub about: Vec<(String, String)>,
    pub methods: Vec<(String, Fields)>,
    pub per_step: Vec<(String, Vec<Fields>)>,
    pub errors: Vec<(String, BTreeMap<String, Vec<f64>>)>,
    /// Probabilities that methods gave their poses.
    pub probability: BTreeMap<String, Vec<f64>>,
    /// Tables by object: labels of a row, its numbers.
    pub objects: Vec<(Vec<String>, Fields)>,
}

/// What `sweep --json` writes.
#[derive(Debug)]
pub(crate) struct Sweep {
    pub name: String,
    pub varied: Vec<Varied>,
}

/// One quantity varied.
#[derive(Debug)]
pub(crate) struct Varied {
    pub vary: String,
    pub unit: String,
    pub pairs: Option<u64>,
    pub methods: Vec<(String, Vec<Sample>)>,
}

/// One method at one value.
#[derive(Debug)]
pub(crate) struct Sample {
    pub value: f64,
    pub summary: Fields,
    pub errors: BTreeMap<String, Vec<f64>>,
}

/// Probability that each of some poses was given, and whether it was right.
pub(crate) type Outcomes = Vec<(f64, bool)>;

/// What `calibrate --json` writes.
#[derive(Debug)]
pub(crate) struct Calibration {
    pub name: String,
    /// For each kind of pairs: what they are, numbers of quality, outcomes.
    pub lines: Vec<(String, Fields, Outcomes)>,
}

/// A trace file.
#[derive(Debug)]
pub(crate) struct TraceFile {
    pub name: String,
    /// Its first registrations.
    pub traced: Vec<Traced>,
    /// How many it has.
    pub count: usize,
}

/// Reads an input of whatever kind it is.
pub(super) fn read(path: &Path, name: String) -> Result<Input, ReportError> {
    if path.is_dir() {
        return Ok(Input::Run(run::read_run(path, name)?));
    }
    let text = read_text(
        path,
        "write it again with `eval --json`, `sweep --json`, `calibrate --json` or `--trace`",
    )?;
    let first = text
        .lines()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("");
    if let Ok(Value::Object(line)) = serde_json::from_str(first) {
        // A step comes first where the header was lost; the trace's reader says so.
        if line.contains_key("registration") || line.contains_key("target_from_source") {
            let (traced, count) = trace::read(path, TRACED)?;
            return Ok(Input::Trace(TraceFile {
                name,
                traced,
                count,
            }));
        }
        if line.contains_key("update") {
            // The log itself was named, not its folder.
            let folder = path.parent().unwrap_or(Path::new("."));
            let name = folder
                .file_name()
                .map_or(name, |n| n.to_string_lossy().into_owned());
            return Ok(Input::Run(run::read_run(folder, name)?));
        }
    }
    let document: Value = serde_json::from_str(&text).map_err(|error| {
        if first.starts_with(['{', '[']) {
            ReportError::NotJson {
                path: path.into(),
                line: error.line(),
                reason: error.to_string(),
            }
        } else {
            ReportError::UnknownKind { path: path.into() }
        }
    })?;
    let top = At::top(&document, path);
    if let Some(sweep) = top.get("sweep") {
        Ok(Input::Sweep(read_sweep(&sweep, name)?))
    } else if let Some(quality) = top.get("quality") {
        Ok(Input::Calibration(read_calibration(&quality, name)?))
    } else if top.get("methods").is_some() || top.get("objects").is_some() {
        Ok(Input::Evaluation(evaluation::read_evaluation(&top, name)?))
    } else {
        Err(ReportError::UnknownKind { path: path.into() })
    }
}

/// The text of a file; bytes that are no UTF-8 make it a file of another kind.
fn read_text(path: &Path, todo: &'static str) -> Result<String, ReportError> {
    let failed = |source| ReportError::Read {
        path: path.into(),
        source,
    };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(LIMIT + 1)
        .read_to_end(&mut bytes)
        .map_err(failed)?;
    if bytes.len() as u64 > LIMIT {
        return Err(ReportError::TooLong {
            path: path.into(),
            limit: LIMIT,
        });
    }
    if bytes.trim_ascii().is_empty() {
        return Err(ReportError::Empty {
            path: path.into(),
            todo,
        });
    }
    String::from_utf8(bytes).map_err(|_| ReportError::UnknownKind { path: path.into() })
}

fn read_sweep(sweep: &At<'_>, name: String) -> Result<Sweep, ReportError> {
    let mut varied = Vec::new();
    for one in sweep.elements()? {
        let mut methods = Vec::new();
        for (method, at) in one.need("methods")?.entries()? {
            let mut samples = Vec::new();
            for at in at.elements()? {
                let value = at.need("value")?;
                samples.push(Sample {
                    value: number(value.value)
                        .filter(|x| x.is_finite())
                        .ok_or_else(|| value.wrong("a number"))?,
                    summary: at
                        .get("summary")
                        .map_or(Ok(Fields::new()), |at| at.fields())?,
                    errors: at
                        .get("errors")
                        .map_or(Ok(BTreeMap::new()), |at| at.lists())?,
                });
            }
            samples.sort_by(|a, b| a.value.total_cmp(&b.value));
            methods.push((method, samples));
        }
        methods.sort_by_key(|(name, _)| name != "init");
        varied.push(Varied {
            vary: one.need("vary")?.text()?,
            unit: one.get("unit").map_or(Ok(String::new()), |at| at.text())?,
            pairs: one.get("pairs").and_then(|at| at.value.as_u64()),
            methods,
        });
    }
    if varied.is_empty() {
        return Err(sweep.wrong("a list of what was varied"));
    }
    Ok(Sweep { name, varied })
}

fn read_calibration(quality: &At<'_>, name: String) -> Result<Calibration, ReportError> {
    let mut lines = Vec::new();
    for line in quality.elements()? {
        let at = line.need("outcomes")?;
        let lists = at.lists()?;
        let (Some(probabilities), Some(right)) = (lists.get("probability"), lists.get("right"))
        else {
            return Err(at.wrong("lists of probabilities and of what was right"));
        };
        let right = right.iter().map(|&right| right != 0.0);
        let outcomes = probabilities.iter().copied().zip(right).collect();
        let numbers = line.need("built_in")?.fields()?;
        lines.push((line.need("pairs")?.text()?, numbers, outcomes));
    }
    Ok(Calibration { name, lines })
}
