//! Trains a policy on a folder of your own meshes and writes it for robots:
//! `cargo run --release -p host-train --example train_on_meshes -- MESHES RUN policy.rgw`.
//!
//! Two epochs of imitation, starting from the bundled policy: a minute for a hundred meshes on 2 cores. For the paper's
//! whole schedule use `host-train train`, which calls the same functions.

use anyhow::bail;
use host_train::policy::{WeightFile, parameters_of};
use host_train::train::{self, Categories, DataSource, Stage, TrainConfig};
use reagent_core::Decision;
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [meshes, run, policy] = &arguments[..] else {
        bail!("usage: train_on_meshes MESHES RUN POLICY.rgw");
    };
    // Any data set that `--data` takes; for loose files, folders are categories.
    let data: DataSource = meshes.parse().map_err(anyhow::Error::msg)?;
    let start = Path::new(run).with_extension("start.rgw");
    WeightFile::pretrained().save(&start)?;

    // The paper's settings, except for those set here.
    let mut config = TrainConfig::new(Stage::Il, vec![data], run.into());
    config.categories = Categories::All;
    config.init = Some(start);
    config.epochs = 2;
    let stop = AtomicBool::new(false); // set it from anywhere to stop after an update, with a checkpoint
    train::run(&config, false, &stop, &|_| ())?;

    // The best checkpoint on meshes that were held back.
    let best = WeightFile::from_parameters(&parameters_of(Path::new(run))?)?;
    best.deciding(Decision::default()).save(Path::new(policy))?;
    println!("{policy} is ready for `host-train publish` and for reagent_core");
    Ok(())
}
