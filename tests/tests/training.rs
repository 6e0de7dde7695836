//! Training runs: exact resumption, runs that cannot start, runs that diverge, and every option.

use host_train::learn::env::Accumulation;
use host_train::learn::expert::Expert;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::checkpoint::{Checkpoint, LAST, PREVIOUS};
use host_train::policy::parameters_of;
use host_train::train::{
    Anneal, DataSource, Follow, Method, Network, RollOut, Stage, TrainConfig, TrainError, run,
};
use reagent_core::sight::Sight;
use serde_json::Value;
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
    run(config, resume, &AtomicBool::new(false), &|_| {})
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

/// The lines of a run's metrics, without what depends on the clock.
fn metrics(out: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(out.join("metrics.jsonl")).expect("the run's metrics");
    let lines = text.lines().map(|line| {
        let mut line: Value = serde_json::from_str(line).expect("JSON");
        line.as_object_mut()
            .expect("an object")
            .remove("samples_per_s");
        line
    });
    lines.collect()
}

/// A run that was killed in the middle of an epoch, between two checkpoints: some metrics are newer than the
/// checkpoint, and a buffer spans the end of an epoch.
#[test]
fn a_killed_run_goes_on_as_if_nothing_had_happened() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let mut config = config(folder.path(), 2);
    config.stage = Stage::Ilrl;
    config.method = Method::new(2.0);
    config.method.average = Some(0.9);
    config.learning_rate.anneal = Anneal::Cosine;
    config.roll_out.problems = 3;
    config.checkpoint_minutes = 0.0;
    train(&config, false).expect("two epochs");
    let last = config.out.join(LAST);
    let whole = (
        Checkpoint::load(&last).expect("whole"),
        metrics(&config.out),
    );
    let before = Checkpoint::load(&config.out.join(PREVIOUS)).expect("kept");
    assert_eq!(before.progress.updates + 1, whole.0.progress.updates);
    assert!(
        before.progress.epoch.updates > 0,
        "in the middle of an epoch"
    );
    assert!(whole.0.averaged.is_some());

    for damage in [true, false] {
        if damage {
            std::fs::write(&last, b"torn").expect("written");
        } else {
            std::fs::remove_file(&last).expect("removed");
        }
        std::fs::write(config.out.join(".tmpkilled"), b"half").expect("written");
        train(&config, true).expect("the rest");
        assert!(!config.out.join(".tmpkilled").exists());
        let resumed = (
            Checkpoint::load(&last).expect("whole"),
            metrics(&config.out),
        );
        assert_eq!(resumed.0, whole.0);
        assert_eq!(resumed.1, whole.1);
    }
}

#[test]
fn a_run_asked_to_stop_leaves_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    run(
        &config(folder.path(), 2),
        false,
        &AtomicBool::new(true),
        &|_| {},
    )
    .expect("stopped at once");
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
    assert!(
        error.to_string().starts_with("2 training clouds"),
        "{error}"
    );
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

#[test]
fn a_resumed_run_is_the_same_run() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let config = config(folder.path(), 1);
    let missing = train(&config, true).expect_err("nothing to resume");
    assert!(missing.to_string().contains("config.json"), "{missing}");
    train(&config, false).expect("one epoch");
    let mut other = config.clone();
    other.method.expert = Expert::Greedy;
    other.data = vec![DataSource::Procedural(10)];
    let error = train(&other, true).expect_err("another run").to_string();
    for word in ["method.expert", "steady", "greedy", "data_sha256"] {
        assert!(error.contains(word), "no {word} in: {error}");
    }
    let mut deep = config.clone();
    deep.network = Network::Deep;
    deep.out = folder.path().join("deep");
    deep.init = Some(folder.path().into());
    let error = train(&deep, false).expect_err("another shape");
    assert!(matches!(error, TrainError::Shape { .. }), "{error}");
    let mut local = config.clone();
    local.method.accumulation = Accumulation::Local;
    (local.out, local.init) = (folder.path().join("local"), deep.init.take());
    let error = train(&local, false).expect_err("another accumulation");
    assert!(matches!(error, TrainError::Accumulation { .. }), "{error}");
    deep.method.ppo.alpha = 1.0;
    deep.method.follow = Follow::Expert;
    let error = train(&deep, false).expect_err("reinforcement off policy");
    assert!(matches!(error, TrainError::Contradiction(_)), "{error}");
}

#[test]
fn a_loss_that_is_no_number_is_saved_and_ruins_nothing() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let mut parameters = Parameters::random(Shape::PAPER, 3);
    parameters.layer_mut(5).1[7] = f32::NAN;
    let start = folder.path().join("start.safetensors");
    let checkpoint = Checkpoint::start(parameters, Accumulation::Global, Sight::ALL);
    checkpoint.save(&start).expect("written");
    let mut config = config(&folder.path().join("run"), 1);
    config.init = Some(start);
    let error = train(&config, false).expect_err("NaN");
    let text = error.to_string();
    assert!(
        text.contains("update 0") && text.contains("diverged.json"),
        "{text}"
    );
    let saved = std::fs::read(config.out.join("diverged.json")).expect("saved");
    let saved: Value = serde_json::from_slice(&saved).expect("JSON");
    assert_eq!(saved["observations"].as_array().map(Vec::len), Some(8));
    assert_eq!(
        saved["problems"][0]["source"].as_array().map(Vec::len),
        Some(64)
    );
    let state = Checkpoint::load(&config.out.join("diverged.safetensors")).expect("saved");
    assert_eq!(
        state.adam, checkpoint.adam,
        "the state before the mini-batch"
    );
    assert!(!config.out.join(LAST).exists());
}

/// Turns an option on.
type Change = fn(&mut TrainConfig);

/// Every row of the paper's design table and every option trains, validates and can be resumed.
#[test]
fn every_option_runs() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let changes: [(&str, Change); 12] = [
        ("follow-expert", |c| c.method.follow = Follow::Expert),
        ("follow-argmax", |c| c.method.follow = Follow::Argmax),
        ("no-augmentation", |c| c.augmentation = false),
        ("greedy", |c| c.method.expert = Expert::Greedy),
        ("deep", |c| c.network = Network::Deep),
        ("basic", |c| c.method.accumulation = Accumulation::Basic),
        ("local", |c| c.method.accumulation = Accumulation::Local),
        ("normalise", |c| c.method.ppo.normalise_advantages = true),
        ("clip-values", |c| c.method.ppo.clip_values = true),
        ("bootstrap", |c| c.method.ppo.bootstrap = true),
        ("clip-gradient", |c| c.method.clip_gradient = Some(0.5)),
        ("average", |c| c.method.average = Some(0.9)),
    ];
    let mut results = Vec::new();
    for (name, change) in changes {
        let mut config = config(&folder.path().join(name), 1);
        change(&mut config);
        if config.method.follow == Follow::Stochastic {
            config.stage = Stage::Ilrl;
            config.method.ppo.alpha = 2.0;
        }
        train(&config, false).unwrap_or_else(|error| panic!("{name}: {error}"));
        config.epochs = 2;
        train(&config, true).unwrap_or_else(|error| panic!("{name}: {error}"));
        let lines = metrics(&config.out);
        assert_eq!(lines.len(), 6, "{name}");
        assert!(lines[5]["validation"]["r_iso_deg"].is_f64(), "{name}");
        results.push(lines);
    }
    for i in 0..results.len() {
        let same = results[..i].iter().filter(|r| **r == results[i]).count();
        assert_eq!(same, 0, "{} changes nothing", changes[i].0);
    }
}

#[test]
fn the_average_is_what_is_exported() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let mut checkpoint = Checkpoint::start(
        Parameters::random(Shape::PAPER, 1),
        Accumulation::Global,
        Sight::ALL,
    );
    let averaged = Parameters::random(Shape::PAPER, 2);
    checkpoint.averaged = Some(averaged.values.clone());
    let path = folder.path().join("c");
    checkpoint.save(&path).expect("written");
    assert_eq!(parameters_of(&path).expect("just written"), averaged);
    // Parameters that the robot would accumulate differently are refused.
    checkpoint.accumulation = Accumulation::Local;
    checkpoint.save(&path).expect("written");
    let refused = parameters_of(&path).expect_err("not deployable");
    assert!(refused.to_string().contains("local"), "{refused}");
}
