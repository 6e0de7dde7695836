//! `host-train views`

use super::source::positive;
use crate::train::DataSource;
use crate::views::{Meshes, Views};
use crate::words::count;
use anyhow::Context;
use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

/// Render training views once and write them to a file, for trainers elsewhere
///
/// The file holds one array [M, 2N + 4, 3] of f32 in NumPy's format: N points of the source, N of the target, then the
/// columns of the true rotation and the translation of target_from_source, in normalised units. Shapes are deformed as in
/// training.
#[derive(Debug, Args)]
pub(super) struct ViewsArgs {
    /// Meshes to render: the training split of a tree of loose meshes, or the built-in shapes
    #[arg(long, value_name = "DIR|procedural[:COUNT]", value_parser = meshes)]
    data: Meshes,
    /// Number of views, of the meshes in shuffled order
    #[arg(long, value_name = "M", default_value_t = 10_000, value_parser = positive())]
    count: usize,
    /// Points of each source and of each target
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = positive())]
    points: usize,
    /// Do not deform shapes
    #[arg(long)]
    no_augmentation: bool,
    /// File to write
    #[arg(long, value_name = "FILE.npy")]
    out: PathBuf,
}

impl ViewsArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let views = Views::load(&self.data, seed)?;
        let begun = Instant::now();
        let drawn = views.npy(self.count, self.points, !self.no_augmentation, seed);
        let bytes = drawn.context("nothing is seen of any mesh: do they have faces?")?;
        let rate = self.count as f64 / begun.elapsed().as_secs_f64();
        crate::files::write(&self.out, &bytes)
            .with_context(|| format!("cannot write {}", self.out.display()))?;
        println!(
            "{} of {} in {}, {rate:.0} a second on {}",
            count(self.count, "view", "views"),
            count(views.objects().len(), "mesh", "meshes"),
            self.out.display(),
            count(rayon::current_num_threads(), "thread", "threads")
        );
        Ok(())
    }
}

/// Parses meshes as `train --data views:…` does.
fn meshes(text: &str) -> Result<Meshes, String> {
    match format!("views:{text}").parse()? {
        DataSource::Views(meshes) => Ok(meshes),
        _ => Err("give a directory of meshes, or procedural[:COUNT]".into()),
    }
}
