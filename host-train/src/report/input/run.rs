//! Run directories of `train`.

use super::{Record, Run, read_text};
use crate::report::ReportError;
use crate::report::value::{number, numbers};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads `config.json` and `metrics.jsonl`.
pub(super) fn read_run(folder: &Path, name: String) -> Result<Run, ReportError> {
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
            Value::Null | Value::Number(_) => {
                fields.insert(key, vec![number(value).unwrap_or(f64::NAN)]);
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
