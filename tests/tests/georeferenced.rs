//! Clouds in national grid coordinates, registered by a robot that computes in f32: poses keep all their digits.

mod support;

use firmware_sim::refine::{CloudFormat, RefineArgs};
use firmware_sim::session::SessionArgs;
use host_train::cli::{Initial, SourceArgs};
use host_train::policy::WeightFile;
use host_train::pose64::Pose64;
use nalgebra::Vector3;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;
use support::{FLEET, Network, publisher, until};

fn case(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cases/utm_precision");
    folder.join(name)
}

/// The pose in a document that a command wrote.
fn pose(path: &Path) -> Pose64 {
    let text = std::fs::read_to_string(path).expect("written");
    let document: Value = serde_json::from_str(&text).expect("JSON");
    let rows = document["target_from_source"].clone();
    Pose64::from_rows(serde_json::from_value(rows).expect("rows"))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_registers_what_lies_far_from_the_origin() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let policy = WeightFile::pretrained();
    // The publisher serves the policy's chunks.
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "p", policy).await;
    published.expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;

    let folder = tempfile::tempdir().expect("a temporary folder");
    let json = folder.path().join("answer.json");
    let args = |init: Option<Initial>| RefineArgs {
        fleet: FLEET.into(),
        robot: "r1".into(),
        pairs: None,
        source: Some(case("source.xyz")),
        target: Some(case("target.xyz")),
        sources: SourceArgs::default(),
        steps: 10,
        mode: None,
        init,
        deadline: Duration::from_secs(60),
        cloud_format: CloudFormat::F32,
        trace: None,
        seed: 42,
        json: Some(json.clone()),
        fail_below: None,
        session: SessionArgs {
            connect: vec![network.endpoint.clone()],
            ..SessionArgs::default()
        },
    };
    let truth = std::fs::read_to_string(case("true_pose.txt")).expect("there");
    let numbers: Vec<f64> = truth
        .split_whitespace()
        .map(|x| x.parse().expect("a number"))
        .collect();
    let (rows, _) = numbers.as_chunks::<4>();
    let truth = Pose64::from_rows(rows.try_into().expect("three rows"));
    let middle = Vector3::new(483_221.0, 5_456_871.0, 310.0);
    let off = |found: &Pose64| {
        let turn = found.rotation.transpose() * truth.rotation;
        let angle = ((turn.trace() - 1.0) / 2.0)
            .clamp(-1.0, 1.0)
            .acos()
            .to_degrees();
        let place = |pose: &Pose64| Vector3::from(pose.apply(middle.into()));
        (angle, (place(found) - place(&truth)).norm())
    };
    // From the identity, and from the pose that was written.
    for init in [None, Some(Initial::File(json.clone()))] {
        args(init).run().await.expect("a pose");
        let (angle, distance) = off(&pose(&json));
        assert!(
            angle < 0.3 && distance < 5e-3,
            "{angle} degrees, {distance} m"
        );
    }
    // Starting from anywhere works, too.
    let anywhere = "none".parse().expect("a word");
    args(Some(anywhere)).run().await.expect("a pose");
    let (angle, distance) = off(&pose(&json));
    assert!(
        angle < 0.3 && distance < 5e-3,
        "{angle} degrees, {distance} m"
    );
}
