//! The whole path: train, export, publish over Zenoh, fetch on a robot, ask it for a pose.

mod support;

use firmware_sim::client;
use host_train::dataset::procedural;
use host_train::policy::{WeightFile, parameters_of};
use host_train::publish::{Publisher, keygen, read_key};
use host_train::train::{DataSource, RollOut, Stage, TrainConfig, run};
use reagent_core::net::Scratch;
use reagent_core::wire::{CloudView, Mode, RefineRequest};
use reagent_core::{Frame, Pose, Registrar};
use std::sync::atomic::AtomicBool;
use support::{Network, until};

#[tokio::test(flavor = "multi_thread")]
async fn a_trained_policy_reaches_a_robot_and_gives_the_pose_it_gives_here() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let run_directory = directory.path().join("run");
    let data = vec![DataSource::Procedural(12)];
    let mut config = TrainConfig::new(Stage::Pretrain, data, run_directory.clone());
    config.epochs = 1;
    config.points = 64;
    config.roll_out = RollOut {
        problems: 4,
        trajectories: 1,
        steps: 4,
        mini_batch: 8,
    };
    run(&config, false, &AtomicBool::new(false), &|_| {}).expect("a short run");
    let path = directory.path().join("policy.rgw");
    let parameters = parameters_of(&run_directory).expect("the run left a checkpoint");
    let file = WeightFile::from_parameters(&parameters).expect("deployable");
    file.save(&path).expect("a writable directory");
    let policy = WeightFile::load(&path).expect("just written");

    let key_path = directory.path().join("fleet.key");
    let public_key = keygen(&key_path).expect("a new key");
    let key = read_key(&key_path).expect("just written");
    assert_eq!(key.verifying_key(), public_key);
    let network = Network::start().await;
    let node = network.node("e2e", "r1").await;
    let mut publisher = Publisher::new(network.join().await, "e2e", key).expect("a good name");
    let manifest = publisher.publish(1, "trained", policy.clone()).await;
    let manifest = manifest.expect("a good policy");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy, Some(manifest));

    let target = procedural::model(99, 0).points;
    let moved = |p: &[f32; 3]| [30.0 + 2.0 * p[0], -2.0 * p[2], 2.0 * p[1] - 5.0];
    let source: Vec<_> = target.iter().map(moved).collect();
    let request = RefineRequest {
        mode: Mode::Fast,
        ..RefineRequest::new(1, CloudView::of(&source), CloudView::of(&target))
    };
    let client = network.join().await;
    let reply = client::refine(&client, "e2e", "r1", &request).await;
    let reply = reply.expect("a pose");

    let mut scratch = Scratch::new();
    let frame = Frame::of(&target).expect("a good cloud");
    let here = Registrar::new(policy.policy(), &mut scratch)
        .register(&source, &target, frame, Pose::IDENTITY, 10)
        .expect("good clouds");
    assert_eq!(reply.target_from_source, here.target_from_source.to_rows());
    assert_eq!(reply.verdict, here.verdict);
    assert!(here.target_from_source.checked().is_ok());
}
