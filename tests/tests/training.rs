//! Training runs: exact resumption, and runs that cannot start.

use host_train::checkpoint::{Checkpoint, LAST};
use host_train::train::{DataSource, RollOut, Stage, TrainConfig, TrainError, run};
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn config(out: &Path, epochs: u32) -> TrainConfig {
    TrainConfig {
        epochs,
        points: 64,
        roll_out: RollOut {
            problems: 4,
            trajectories: 2,
            steps: 3,
            mini_batch: 8,
        },
        validation_pairs: 1,
        ..TrainConfig::new(Stage::Il, vec![DataSource::Procedural(9)], out.into())
    }
}

fn train(config: &TrainConfig, resume: bool) -> Result<(), TrainError> {
    run(config, resume, &AtomicBool::new(false))
}

#[test]
fn a_resumed_run_has_the_bits_of_an_uninterrupted_one() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    train(&config(&whole, 2), false).expect("two epochs");
    train(&config(&parts, 1), false).expect("one epoch");
    train(&config(&parts, 2), true).expect("one more");
    let [whole, parts] =
        [whole, parts].map(|out| Checkpoint::load(&out.join(LAST)).expect("the run's checkpoint"));
    assert_eq!(whole, parts);
}

#[test]
fn a_run_asked_to_stop_leaves_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    run(&config(folder.path(), 2), false, &AtomicBool::new(true)).expect("stopped at once");
    let checkpoint = Checkpoint::load(&folder.path().join(LAST)).expect("a checkpoint");
    assert_eq!(checkpoint.progress.updates, 0);
}

#[test]
fn what_cannot_start_says_why() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    train(&config(folder.path(), 1), false).expect("one epoch");
    let error = train(&config(folder.path(), 1), false).expect_err("a run is there already");
    assert!(error.to_string().contains("--resume"), "{error}");

    let file = folder.path().join("config.json");
    let error = train(&config(&file, 1), false).expect_err("a file is no directory");
    assert!(matches!(error, TrainError::Directory { .. }), "{error}");

    let mut few = config(&folder.path().join("few"), 1);
    few.data = vec![DataSource::Procedural(2)];
    let error = train(&few, false).expect_err("too few clouds");
    assert!(error.to_string().contains("at least 3"), "{error}");

    let mut lost = config(&folder.path().join("lost"), 1);
    lost.data = vec![DataSource::Directory("no/such/data".into())];
    let error = train(&lost, false).expect_err("no data");
    assert!(error.to_string().contains("no/such/data"), "{error}");

    let mut bad = config(&folder.path().join("bad"), 1);
    bad.init = Some("no/such/run".into());
    let error = train(&bad, false).expect_err("no initial weights");
    assert!(error.to_string().contains("no/such/run"), "{error}");
}
