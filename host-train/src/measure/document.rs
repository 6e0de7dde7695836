//! What `eval --json` writes.

use super::agreement::Agreement;
use super::eval::{Outcome, Row, StepRow};
use super::metrics::Errors;
use serde::Serialize;
use std::collections::BTreeMap;

/// The number of pairs; every method's rows, step by step if asked for, and its final errors pair by pair; the
/// probabilities of methods with a verdict; and, if asked for, the agreement of policies.
#[derive(Debug, Serialize)]
pub struct Document<'a> {
    pairs: usize,
    methods: BTreeMap<&'a str, &'a Row>,
    per_step: BTreeMap<&'a str, &'a [StepRow]>,
    errors: BTreeMap<&'a str, &'a Errors>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    probability: BTreeMap<&'a str, &'a [f32]>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    agreement: BTreeMap<String, Agreement>,
}

impl<'a> Document<'a> {
    /// The document for the outcomes on `pairs` pairs and the result of [`agreement`](super::agreement::agreement).
    pub fn new(
        pairs: usize,
        outcomes: &'a [Outcome],
        agreement: BTreeMap<String, Agreement>,
    ) -> Document<'a> {
        Document {
            agreement,
            pairs,
            methods: outcomes.iter().map(|o| (o.name.as_str(), &o.row)).collect(),
            per_step: outcomes
                .iter()
                .filter(|o| !o.per_step.is_empty())
                .map(|o| (o.name.as_str(), o.per_step.as_slice()))
                .collect(),
            errors: outcomes
                .iter()
                .map(|o| (o.name.as_str(), &o.errors))
                .collect(),
            probability: outcomes
                .iter()
                .filter(|o| !o.probability.is_empty())
                .map(|o| (o.name.as_str(), o.probability.as_slice()))
                .collect(),
        }
    }
}
