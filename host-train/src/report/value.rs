//! Numbers out of JSON documents. A NaN is `null` there.

use super::ReportError;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

/// Named numbers.
pub(crate) type Fields = BTreeMap<String, f64>;

/// No measurement is larger; sums and differences of such numbers stay finite.
const HUGE: f64 = 1e100;

/// A number, or NaN for `null` and for what no measurement can be.
pub(crate) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Null => Some(f64::NAN),
        _ => value
            .as_f64()
            .map(|x| if x.abs() < HUGE { x } else { f64::NAN }),
    }
}

/// A list of numbers.
pub(crate) fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(number).collect()
}

/// The numbers among the entries of an object.
pub(crate) fn fields(object: &Map<String, Value>) -> Fields {
    object
        .iter()
        .filter_map(|(key, value)| Some((key.clone(), number(value)?)))
        .collect()
}

/// A place in a document: its file and the keys down to it, for errors.
#[derive(Clone, Debug)]
pub(crate) struct At<'a> {
    pub value: &'a Value,
    pub key: String,
    pub path: &'a Path,
}

impl<'a> At<'a> {
    /// The top of a document.
    pub(crate) fn top(value: &'a Value, path: &'a Path) -> At<'a> {
        At {
            value,
            key: String::new(),
            path,
        }
    }

    fn below(&self, key: &str, value: &'a Value) -> At<'a> {
        let key = if self.key.is_empty() {
            key.into()
        } else {
            format!("{}.{key}", self.key)
        };
        At {
            value,
            key,
            path: self.path,
        }
    }

    /// The entry `key`, if it is there and not null.
    pub(crate) fn get(&self, key: &str) -> Option<At<'a>> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        Some(self.below(key, value))
    }

    /// The entry `key`.
    pub(crate) fn need(&self, key: &str) -> Result<At<'a>, ReportError> {
        let missing = self.below(key, &Value::Null);
        self.get(key).ok_or_else(|| missing.wrong("there"))
    }

    /// The refusal of this place.
    pub(crate) fn wrong(&self, expected: &'static str) -> ReportError {
        ReportError::Malformed {
            path: self.path.into(),
            key: self.key.clone(),
            expected,
        }
    }

    /// The entries of an object.
    pub(crate) fn entries(&self) -> Result<Vec<(String, At<'a>)>, ReportError> {
        let object = self
            .value
            .as_object()
            .ok_or_else(|| self.wrong("an object"))?;
        let entry = |(key, value): (&'a String, &'a Value)| (key.clone(), self.below(key, value));
        Ok(object.iter().map(entry).collect())
    }

    /// The elements of a list.
    pub(crate) fn elements(&self) -> Result<Vec<At<'a>>, ReportError> {
        let list = self.value.as_array().ok_or_else(|| self.wrong("a list"))?;
        let element = |(i, value): (usize, &'a Value)| self.below(&i.to_string(), value);
        Ok(list.iter().enumerate().map(element).collect())
    }

    /// The numbers of an object.
    pub(crate) fn fields(&self) -> Result<Fields, ReportError> {
        let object = self
            .value
            .as_object()
            .ok_or_else(|| self.wrong("an object"))?;
        Ok(fields(object))
    }

    /// Lists of numbers by name; what is no list is passed over.
    pub(crate) fn lists(&self) -> Result<BTreeMap<String, Vec<f64>>, ReportError> {
        let mut lists = BTreeMap::new();
        for (key, at) in self.entries()? {
            if at.value.is_array() {
                let list = numbers(at.value).ok_or_else(|| at.wrong("a list of numbers"))?;
                lists.insert(key, list);
            }
        }
        Ok(lists)
    }

    /// A text.
    pub(crate) fn text(&self) -> Result<String, ReportError> {
        let text = self.value.as_str().ok_or_else(|| self.wrong("a text"))?;
        Ok(text.into())
    }
}
