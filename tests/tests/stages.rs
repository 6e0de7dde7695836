//! A policy in stages through a fleet of 200: one that is worse, and does not say so, is caught at the first stage.

mod support;

use firmware_sim::client::Client;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use host_train::dataset::procedural;
use host_train::protocol::{self, Protocol};
use host_train::publish::{Halt, Stages};
use reagent_core::wire::WhyNot;
use std::time::Duration;
use support::rollout::{ask_on_and_on, gate, good_policy, negated};
use support::{FLEET, Network, key, publisher, until};

const ROBOTS: usize = 200;
/// Number of robots that share a session.
const TOGETHER: usize = 25;
/// Number of poses by which a stage is judged.
const POSES: u64 = 100;

#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_is_silently_worse_is_caught_at_the_first_stage_of_a_fleet_of_200() {
    let network = Network::start().await;
    let mut nodes = Vec::new();
    for first in (0..ROBOTS).step_by(TOGETHER) {
        let session = network.join().await;
        for robot in first..first + TOGETHER {
            let config = NodeConfig {
                fleet: FLEET.into(),
                robot: format!("r{robot:03}"),
                trust: Trust::AnyKey,
                state: None,
            };
            let node = Node::start(session.clone(), config).await;
            nodes.push(node.expect("good names"));
        }
    }
    let all_run = async |version: u64| {
        for node in &nodes {
            let runs = |v: u64| {
                move |view: &firmware_sim::view::View| {
                    view.policy
                        .as_ref()
                        .is_some_and(|policy| policy.version == v)
                }
            };
            until(node, runs(version)).await;
        }
    };
    let mut publisher = publisher(&network).await;
    let shipped = publisher.publish(1, "good", good_policy()).await;
    shipped.expect("a good policy");
    all_run(1).await;

    let models = procedural::models(3, 16);
    let pairs = protocol::draw(&models, Protocol::M40Models, 32, 3);
    let client = Client::new(network.join().await, FLEET).await;
    let load = tokio::spawn(ask_on_and_on(client.expect("a good name"), pairs));
    let stages: Stages = "1,10%,100%".parse().expect("stages");
    let gate = gate(POSES);
    let worse = negated(7);
    let manifest = publisher.prepare(2, "worse", &worse).await;
    let manifest = manifest.expect("a sound policy");
    let told = |line| println!("{line}");
    let outcome = publisher
        .roll_out(&manifest, &worse, &stages, &gate, told)
        .await;
    let halt = outcome.expect("an open session");
    let halt = halt.expect_err("it is worse");
    assert!(matches!(halt, Halt::Worse(_)), "{halt}");
    let have_it = nodes.iter().filter(|node| {
        let policy = node.watch().borrow().policy.clone();
        policy.is_some_and(|policy| policy.version == 2)
    });
    assert_eq!(have_it.count(), 1, "of {ROBOTS} robots");

    // A policy that is no worse passes all stages, and the robots that took the other one take it, too.
    let manifest = publisher.prepare(3, "as good", &good_policy()).await;
    let manifest = manifest.expect("a sound policy");
    let outcome = publisher
        .roll_out(&manifest, &good_policy(), &stages, &gate, told)
        .await;
    let outcome = outcome.expect("an open session");
    assert_eq!(outcome.map(drop), Ok(()));
    all_run(3).await;
    assert!(!load.is_finished(), "requests were answered all the time");
    load.abort();
}

/// A robot's "not yet" at the stage before is not its answer to this stage.
#[tokio::test(flavor = "multi_thread")]
async fn a_stage_has_its_robots_before_it_is_judged() {
    let network = Network::start().await;
    let _nodes = [
        network.node(FLEET, "a").await,
        network.node(FLEET, "b").await,
        network.node(FLEET, "c").await,
    ];
    let mut publisher = publisher(&network).await;
    let manifest = publisher.prepare(1, "first", &good_policy()).await;
    let gate = gate(0);
    let stages: Stages = "1,2,100%".parse().expect("stages");
    let mut told = Vec::new();
    let outcome = publisher
        .roll_out(
            &manifest.expect("a sound policy"),
            &good_policy(),
            &stages,
            &gate,
            |line| told.push(line),
        )
        .await;
    assert_eq!(outcome.expect("an open session").map(drop), Ok(()));
    told.retain(|line| line.starts_with("stage"));
    let taken = ["1 robot", "2 robots", "3 robots"];
    assert_eq!(
        told,
        taken.map(|robots| format!("stage of {robots}: taken"))
    );
}

/// What the other robots say is no silence.
#[tokio::test(flavor = "multi_thread")]
async fn a_roll_out_may_end_before_all_robots_are_reached() {
    let network = Network::start().await;
    let _nodes = [
        network.node(FLEET, "a").await,
        network.node(FLEET, "b").await,
        network.node(FLEET, "c").await,
    ];
    let mut publisher = publisher(&network).await;
    let file = good_policy();
    let manifest = publisher.prepare(1, "first", &file).await.expect("sound");
    let (stages, told): (Stages, _) = ("2".parse().expect("stages"), |line| println!("{line}"));
    let gate = gate(0);
    let outcome = publisher.roll_out(&manifest, &file, &stages, &gate, told);
    let announced = outcome
        .await
        .expect("an open session")
        .expect("all is well");
    let reception = publisher.reception(&announced, Duration::from_secs(60));
    let reception = reception.await.expect("an open session");
    assert_eq!(reception.taken.len(), 2, "{reception}");
    let reasons: Vec<_> = reception.refused.iter().map(|(_, why)| *why).collect();
    assert_eq!(reasons, [WhyNot::NotYet]);
}

/// One robot that cannot take a policy stops a roll-out, and the error says how to go on without it.
#[tokio::test(flavor = "multi_thread")]
async fn a_roll_out_goes_on_without_a_robot_that_is_excepted() {
    let network = Network::start().await;
    let distrustful = NodeConfig {
        fleet: FLEET.into(),
        robot: "b".into(),
        trust: Trust::Keys(vec![key(8).verifying_key()]),
        state: None,
    };
    let b = Node::start(network.join().await, distrustful).await;
    let _nodes = [network.node(FLEET, "a").await, b.expect("good names")];
    let mut publisher = publisher(&network).await;
    let stages: Stages = "100%".parse().expect("stages");
    let mut gate = gate(0);
    let (file, told) = (good_policy(), |line| println!("{line}"));
    let manifest = publisher.prepare(1, "first", &file).await.expect("sound");
    let outcome = publisher.roll_out(&manifest, &file, &stages, &gate, told);
    let halt = outcome.await.expect("an open session").expect_err("not b");
    assert!(halt.to_string().ends_with("--except b"), "{halt}");
    gate.except = vec!["b".into(), "nosuch".into()];
    let manifest = publisher.prepare(2, "second", &file).await.expect("sound");
    let mut lines = Vec::new();
    let told = |line| lines.push(line);
    let outcome = publisher.roll_out(&manifest, &file, &stages, &gate, told);
    assert_eq!(outcome.await.expect("an open session").map(drop), Ok(()));
    assert_eq!(lines[0], "no robot nosuch is there, which --except names");
}
