//! Where a command's models come from.

use crate::dataset::modelnet::{self, Split};
use crate::dataset::pairs::PairSet;
use crate::dataset::{Model, procedural};
use crate::protocol::{self, Protocol};
use anyhow::bail;
use clap::ValueEnum;
use clap::builder::RangedU64ValueParser;
use std::path::Path;

pub(super) use crate::train::DataSource;

/// Pairs drawn from the built-in shapes where no number is given.
const PROCEDURAL_PAIRS: usize = 100;
/// Built-in shapes from this number on are for evaluation: training counts up from 0 and never gets here.
const HELD_OUT: u64 = 1 << 32;
/// File of the ScanObjectNN layout.
const SCAN_FILE: &str = "test_objectdataset.h5";

/// An argument from 1 to a million: more than anyone needs, and no more than memory holds.
pub(super) fn positive() -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(1..=1_000_000)
}

/// Draws pairs from the test models of a data set under a protocol.
pub(super) fn draw(
    data: &DataSource,
    protocol: Protocol,
    count: Option<usize>,
    seed: u64,
) -> anyhow::Result<PairSet> {
    let models = match data {
        DataSource::Directory(dir) => test_models(dir, protocol)?,
        DataSource::Procedural(shapes) => {
            let drawn = count.unwrap_or(PROCEDURAL_PAIRS).min(*shapes);
            (0..drawn as u64)
                .map(|i| procedural::model(seed, HELD_OUT + i))
                .collect()
        }
    };
    Ok(protocol::draw(
        &models,
        protocol,
        count.unwrap_or(models.len()),
        seed,
    ))
}

fn test_models(dir: &Path, protocol: Protocol) -> anyhow::Result<Vec<Model>> {
    let models = match protocol {
        Protocol::Scan => modelnet::load_file(&dir.join(SCAN_FILE))?,
        _ => modelnet::load(dir, Split::Test)?,
    };
    let Some(labels) = protocol.labels() else {
        return Ok(models);
    };
    let models = modelnet::categories(models, labels.clone());
    if models.is_empty() {
        let name = protocol
            .to_possible_value()
            .map_or(String::new(), |v| v.get_name().to_owned());
        bail!(
            "{}: no test model has a label from {} to {}, as protocol {name} asks for",
            dir.display(),
            labels.start,
            labels.end - 1,
        );
    }
    Ok(models)
}
