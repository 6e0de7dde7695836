//! Parts of `host-train eval --protocol bop`: pairs from estimates, tables per object, results files.

use super::output::write_json;
use crate::bop::evaluate::Refinements;
use crate::bop::recall::AverageRecall;
use crate::bop::table::{self, ObjectRow};
use crate::dataset::bop::write_results;
use crate::measure::document::Document;
use crate::measure::eval::Outcome;
use crate::protocol::Protocol;
use crate::words::count;
use anyhow::Context;
use clap::ValueEnum;
use clap::builder::PossibleValue;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What `--protocol` of `eval` accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EvalProtocol {
    /// Pairs drawn from models.
    Models(Protocol),
    /// Poses of objects in images, refined from estimates.
    Bop,
}

impl ValueEnum for EvalProtocol {
    fn value_variants<'a>() -> &'a [Self] {
        &[
            EvalProtocol::Models(Protocol::M40Clean),
            EvalProtocol::Models(Protocol::M40Models),
            EvalProtocol::Models(Protocol::M40Categories),
            EvalProtocol::Models(Protocol::Scan),
            EvalProtocol::Bop,
        ]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            EvalProtocol::Models(protocol) => protocol.to_possible_value(),
            EvalProtocol::Bop => Some(PossibleValue::new("bop").help(
                "Objects in depth images (LINEMOD and others in BOP layout), refined from --estimates",
            )),
        }
    }
}

/// The document of `eval --json`, with the tables.
#[derive(Serialize)]
struct BopDocument<'a> {
    #[serde(flatten)]
    document: Document<'a>,
    objects: BTreeMap<&'a str, Vec<ObjectRow>>,
    average_recall: BTreeMap<&'a str, AverageRecall>,
}

/// One line on what is evaluated.
pub(super) fn describe(found: &Refinements, root: &Path, estimates: &Path) -> String {
    let (unrefined, missing) = found.unrefined();
    let mut text = format!(
        "{}, initial poses of {}",
        root.display(),
        estimates.display()
    );
    if missing > 0 {
        let missing = count(missing, "listed object has", "listed objects have");
        text += &format!("; {missing} none, which counts as a failure");
    }
    if unrefined > missing {
        let kept = count(unrefined - missing, "object", "objects");
        text += &format!("; initial poses stay of {kept} without depth inside the mask");
    }
    let clouds = found.models.iter().filter(|m| m.mesh.faces.is_empty());
    let clouds = clouds.count();
    if clouds > 0 {
        let clouds = count(clouds, "model has", "models have");
        text += &format!("; {clouds} no faces to be rendered, which VSD counts as wrong");
    }
    text
}

/// Prints a table for each method, and writes the document and the results files that were asked for.
pub(super) fn report(
    found: &Refinements,
    outcomes: &[Outcome],
    document: Document<'_>,
    json: Option<&Path>,
    results: Option<&Path>,
) -> anyhow::Result<()> {
    let (mut objects, mut average_recall) = (BTreeMap::new(), BTreeMap::new());
    for outcome in outcomes {
        let poses = found.estimated(&outcome.target_from_source)?;
        let rows = table::objects(&found.models, &poses).context("models of the data set")?;
        let recall = AverageRecall::of(poses.iter().map(|pose| pose.errors));
        print!("\n{}", table::text(&outcome.name, &rows, &recall));
        objects.insert(outcome.name.as_str(), rows);
        average_recall.insert(outcome.name.as_str(), recall);
        if let Some(path) = results {
            let path = results_file(path, &outcome.name, outcomes.len());
            write_results(&path, &found.results(&outcome.target_from_source))?;
        }
    }
    if let Some(path) = json {
        let document = BopDocument {
            document,
            objects,
            average_recall,
        };
        write_json(path, &document)?;
    }
    Ok(())
}

/// `FILE` for a single method, `FILE-METHOD.csv` for each of several.
fn results_file(path: &Path, method: &str, methods: usize) -> PathBuf {
    if methods == 1 {
        return path.into();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let dot = if extension.is_empty() { "" } else { "." };
    path.with_file_name(format!("{stem}-{method}{dot}{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_methods_have_a_file_each() {
        let path = Path::new("out/lm.csv");
        assert_eq!(results_file(path, "icp", 1), path);
        assert_eq!(results_file(path, "icp", 2), Path::new("out/lm-icp.csv"));
    }
}
