//! What a report is made of, read and checked.

use super::ReportError;
use super::value::{At, Fields, numbers};
use crate::trace::{self, Traced};
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
        return Ok(Input::Run(read_run(path, name)?));
    }
    let text = read_text(
        path,
        "write it again with `eval --json`, `sweep --json` or `--trace`",
    )?;
    let first = text
        .lines()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("");
    if let Ok(Value::Object(line)) = serde_json::from_str(first) {
        if line.contains_key("registration") {
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
            return Ok(Input::Run(read_run(folder, name)?));
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
    } else if top.get("methods").is_some() || top.get("objects").is_some() {
        Ok(Input::Evaluation(read_evaluation(&top, name)?))
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

fn read_run(folder: &Path, name: String) -> Result<Run, ReportError> {
    let file = |file: &'static str| {
        let path = folder.join(file);
        if path.is_file() {
            Ok(path)
        } else {
            Err(ReportError::NoRun {
                path: folder.into(),
                file,
            })
        }
    };
    let (config_path, metrics_path) = (file("config.json")?, file("metrics.jsonl")?);
    let text = read_text(&config_path, "start the run again")?;
    let config = serde_json::from_str(&text).map_err(|error| ReportError::NotJson {
        path: config_path.clone(),
        line: error.line(),
        reason: error.to_string(),
    })?;
    let text = read_text(&metrics_path, "wait for the run's first update")?;
    let (mut updates, mut epochs, mut note) = (Vec::new(), Vec::new(), None);
    let last = text.lines().count();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let object: Map<String, Value> = match serde_json::from_str(line) {
            Ok(object) => object,
            // A run that is under way, or was cut off, ends within a line.
            Err(_) if i + 1 == last && i > 0 && !text.ends_with('\n') => {
                note = Some(format!(
                    "{}: the last line is incomplete and left out; the run may still be writing",
                    metrics_path.display()
                ));
                break;
            }
            Err(error) => {
                return Err(ReportError::NotJson {
                    path: metrics_path,
                    line: i + 1,
                    reason: error.to_string(),
                });
            }
        };
        let mut fields = BTreeMap::new();
        flatten("", &object, &mut fields);
        let at = |key: &str| fields.get(key).and_then(|v: &Vec<f64>| v.first().copied());
        let (records, x) = match (at("update"), at("epoch")) {
            (Some(update), _) => (&mut updates, update),
            (None, Some(epoch)) => (&mut epochs, epoch),
            (None, None) => {
                let next = epochs.len() as f64;
                (&mut epochs, next)
            }
        };
        for counter in ["update", "updates", "epoch"] {
            fields.remove(counter);
        }
        records.push(Record { x, fields });
    }
    Ok(Run {
        name,
        config,
        updates,
        epochs,
        note,
    })
}

/// Every number and list of numbers of an object, however deep.
fn flatten(prefix: &str, object: &Map<String, Value>, fields: &mut BTreeMap<String, Vec<f64>>) {
    for (key, value) in object {
        let key = format!("{prefix}{key}");
        match value {
            Value::Object(inner) => flatten(&format!("{key}."), inner, fields),
            Value::Null => {
                fields.insert(key, vec![f64::NAN]);
            }
            Value::Number(number) => {
                fields.insert(key, vec![number.as_f64().unwrap_or(f64::NAN)]);
            }
            Value::Array(_) => {
                if let Some(list) = numbers(value) {
                    fields.insert(key, list);
                }
            }
            Value::Bool(_) | Value::String(_) => {}
        }
    }
}

fn read_evaluation(top: &At<'_>, name: String) -> Result<Evaluation, ReportError> {
    let about = top
        .entries()?
        .into_iter()
        .filter_map(|(key, at)| match at.value {
            Value::String(text) => Some((key, text.clone())),
            Value::Number(number) => Some((key, number.to_string())),
            _ => None,
        });
    let mut methods = Vec::new();
    if let Some(at) = top.get("methods") {
        for (method, at) in at.entries()? {
            methods.push((method, at.fields()?));
        }
    }
    let mut per_step = Vec::new();
    if let Some(at) = top.get("per_step") {
        for (method, at) in at.entries()? {
            let rows: Result<Vec<Fields>, ReportError> =
                at.elements()?.iter().map(At::fields).collect();
            per_step.push((method, rows?));
        }
    }
    let mut errors = Vec::new();
    if let Some(at) = top.get("errors") {
        for (method, at) in at.entries()? {
            errors.push((method, at.lists()?));
        }
    }
    let mut objects = Vec::new();
    if let Some(at) = top.get("objects") {
        rows(&at, &mut Vec::new(), &mut objects);
    }
    // What nothing was done to comes first, as in the paper's tables.
    methods.sort_by_key(|(name, _)| name != "init");
    errors.sort_by_key(|(name, _)| name != "init");
    Ok(Evaluation {
        name,
        about: about.collect(),
        methods,
        per_step,
        errors,
        objects,
    })
}

/// Rows of a nested table: the keys on the way down name a row, the innermost objects hold its numbers.
fn rows(at: &At<'_>, names: &mut Vec<String>, found: &mut Vec<(Vec<String>, Fields)>) {
    let children: Vec<(String, At<'_>)> = match at.value {
        Value::Object(_) => at.entries().unwrap_or_default(),
        Value::Array(_) => {
            let elements = at.elements().unwrap_or_default().into_iter().enumerate();
            let name = |i: usize, at: &At<'_>| match at.value.get("name") {
                Some(Value::String(name)) => name.clone(),
                _ => i.to_string(),
            };
            elements.map(|(i, at)| (name(i, &at), at)).collect()
        }
        _ => return,
    };
    let mut numbers = at.fields().unwrap_or_default();
    if at.value.get("name").is_some() {
        // An id beside a name says nothing.
        numbers.remove("object");
    }
    if !numbers.is_empty() {
        found.push((names.clone(), numbers));
    }
    // No table has that many levels.
    if names.len() < 4 {
        for (key, child) in children {
            names.push(key);
            rows(&child, names, found);
            names.pop();
        }
    }
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
                    value: value
                        .value
                        .as_f64()
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
