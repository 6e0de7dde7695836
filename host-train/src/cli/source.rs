//! The source of a command's models.

use super::bad_usage;
use crate::bop::sample::{BopSampling, BopTraining};
use crate::dataset::pairs::PairSet;
use crate::dataset::{self, Model, Split, modelnet, procedural};
use crate::protocol::{self, Protocol};
use crate::views::{Meshes, Views};
use anyhow::bail;
use clap::ValueEnum;
use clap::builder::RangedI64ValueParser;
use std::path::Path;

pub(super) use crate::train::DataSource;

/// Default number of pairs drawn from the built-in shapes.
const PROCEDURAL_PAIRS: usize = 100;
/// Number of the first built-in shape for evaluation; training counts from 0 and never gets here.
const HELD_OUT: u64 = 1 << 32;

/// An argument from 1 to a million: more than anyone needs, and no more than fits in memory.
pub(super) fn positive() -> RangedI64ValueParser<usize> {
    RangedI64ValueParser::new().range(1..=1_000_000)
}

/// Draws pairs from the test models of a data set under a protocol. Views of meshes have their own.
///
/// Exits with status 2 if a protocol is given for views, or none for other models.
pub(super) fn draw(
    command: &str,
    data: &DataSource,
    protocol: Option<Protocol>,
    count: Option<usize>,
    seed: u64,
) -> anyhow::Result<PairSet> {
    let protocol = match (data, protocol) {
        (DataSource::Views(meshes), None) => return views(meshes, count, seed),
        (DataSource::Views(_), Some(_)) => bad_usage(
            command,
            "views are drawn in one way only: leave --protocol out",
        ),
        (_, Some(protocol)) => protocol,
        (_, None) => bad_usage(
            command,
            "--protocol says how pairs are drawn; only views:DIR goes without",
        ),
    };
    let models = models(data, protocol, count, seed)?;
    let count = count.unwrap_or(models.len());
    Ok(protocol::draw(&models, protocol, count, seed))
}

/// Views of the test split of a directory of meshes, or of built-in shapes that training never sees.
fn views(meshes: &Meshes, count: Option<usize>, seed: u64) -> anyhow::Result<PairSet> {
    let views = match meshes {
        Meshes::Directory(dir) => Views::open(dir, Split::Test, seed)?,
        Meshes::Procedural(shapes) => {
            let drawn = count.unwrap_or(PROCEDURAL_PAIRS).min(*shapes) as u64;
            Views::procedural(seed, HELD_OUT..HELD_OUT + drawn)
        }
    };
    let count = count.unwrap_or(views.objects().len());
    let mut pairs = PairSet::default();
    views.draw(count, BopSampling::default().points, seed, &mut pairs);
    Ok(pairs)
}

/// The test models that a protocol takes of a data set, or as many built-in shapes as pairs are asked for.
pub(super) fn models(
    data: &DataSource,
    protocol: Protocol,
    count: Option<usize>,
    seed: u64,
) -> anyhow::Result<Vec<Model>> {
    match data {
        DataSource::Directory(path) => test_models(path, protocol, seed),
        DataSource::Bop(dir) => bail!(
            "{} holds images in BOP layout: use eval --protocol bop",
            dir.display()
        ),
        DataSource::Views(_) => {
            bail!(
                "{data} is for train, eval, pairs, and calibration of integers: a sweep varies clouds of models"
            )
        }
        DataSource::Procedural(shapes) => {
            let drawn = count.unwrap_or(PROCEDURAL_PAIRS).min(*shapes);
            Ok((0..drawn as u64)
                .map(|i| procedural::model(seed, HELD_OUT + i))
                .collect())
        }
    }
}

/// Draws pairs with a protocol's noise from training models of all labels, or from training images.
pub(super) fn draw_training(
    data: &DataSource,
    protocol: Protocol,
    most: usize,
    seed: u64,
) -> anyhow::Result<PairSet> {
    let models = match data {
        DataSource::Directory(path) => dataset::load(path, Split::Train, seed)?,
        DataSource::Bop(root) => {
            let mut pairs = PairSet::default();
            let objects = BopTraining::open(root, seed, BopSampling::default())?;
            objects.draw(most, seed, &mut pairs)?;
            return Ok(pairs);
        }
        DataSource::Views(meshes) => {
            let mut pairs = PairSet::default();
            Views::load(meshes, seed)?.draw(most, BopSampling::default().points, seed, &mut pairs);
            return Ok(pairs);
        }
        DataSource::Procedural(count) => procedural::models(seed, *count),
    };
    let count = most.min(models.len());
    Ok(protocol::draw(&models, protocol, count, seed))
}

fn test_models(path: &Path, protocol: Protocol, seed: u64) -> anyhow::Result<Vec<Model>> {
    let models = dataset::load(path, Split::Test, seed)?;
    let Some(labels) = protocol.labels() else {
        return Ok(models);
    };
    let [left_out, all] =
        modelnet::left_out(models.iter().map(|model| model.label).collect(), &labels);
    let models = modelnet::categories(models, labels.clone());
    let name = protocol
        .to_possible_value()
        .map_or(String::new(), |v| v.get_name().to_owned());
    if left_out > 0 && !models.is_empty() {
        eprintln!(
            "{}: {left_out} of {all} categories left out: protocol {name} takes labels {} to {}",
            path.display(),
            labels.start,
            labels.end.min(all as u32) - 1,
        );
    }
    if models.is_empty() {
        bail!(
            "{}: no test model has a label from {} on, as protocol {name} asks for; take another protocol",
            path.display(),
            labels.start,
        );
    }
    Ok(models)
}
