//! Documents of `eval --json`.

use super::Evaluation;
use crate::report::ReportError;
use crate::report::value::{At, Fields};
use serde_json::Value;

/// Reads what is there of methods, steps, errors and objects.
pub(super) fn read_evaluation(top: &At<'_>, name: String) -> Result<Evaluation, ReportError> {
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
    let probability = top.get("probability").map(|at| at.lists()).transpose()?;
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
        probability: probability.unwrap_or_default(),
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
