//! Several publishers of one fleet: a robot that comes late gets the newest policy that anybody serves.

mod support;

use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use host_train::publish::{Publisher, manifest};
use reagent_core::wire::keys;
use std::time::Duration;
use support::{FLEET, Host, Network, int8_policy, key, publisher, storage, until};
use tokio::sync::mpsc;
use tokio::time::timeout;
use zenoh::Wait;

/// A robot that trusts the first key.
async fn late(network: &Network, robot: &str) -> Node {
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: robot.into(),
        trust: Trust::Keys(vec![key(1).verifying_key()]),
        state: None,
    };
    let node = Node::start(network.join().await, config).await;
    node.expect("good names")
}

async fn runs(node: &Node, version: u64) {
    let in_use = until(node, |view| view.policy.is_some()).await.policy;
    assert_eq!(in_use.map(|policy| policy.version), Some(version));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_late_robot_takes_the_newest_that_anybody_serves() {
    let network = Network::start().await;
    let mut serving = Vec::new();
    for version in [10, 11] {
        let mut publisher = publisher(&network).await;
        let published = publisher.publish(version, "policy", int8_policy()).await;
        published.expect("a newer version");
        serving.push(publisher);
    }
    // The newest of all is signed by a stranger.
    let mut stranger = Publisher::new(network.join().await, FLEET, key(2)).expect("a good name");
    let published = stranger.publish(12, "foreign", int8_policy()).await;
    published.expect("a newer version");
    for robot in ["late-a", "late-b", "late-c"] {
        runs(&late(&network, robot).await, 11).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_newest_is_found_beside_a_storage() {
    let network = Network::start().await;
    let _storage = storage(&network.router).await;
    let mut first = publisher(&network).await;
    let published = first.publish(10, "served", int8_policy()).await;
    published.expect("a good policy");
    runs(&late(&network, "late-a").await, 10).await;
    let mut second = publisher(&network).await;
    let stored = second.store(11, "stored", &int8_policy()).await;
    stored.expect("it is kept");
    drop(second);
    runs(&late(&network, "late-b").await, 11).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_announcement_that_was_lost_is_asked_for() {
    let network = Network::start().await;
    let mut first = publisher(&network).await;
    let published = first.publish(10, "first", int8_policy()).await;
    published.expect("a good policy");
    let node = late(&network, "r1").await;
    runs(&node, 10).await;

    // It answers, but its announcement is not heard.
    let session = network.join().await;
    let policy = int8_policy();
    let second = manifest(11, "second", &policy).expect("a good policy");
    let host = Host::of_file(&session, second.clone(), policy.bytes().to_vec()).await;
    let frame = host.signed.clone();
    let at = keys::manifest(FLEET).expect("a good name");
    let answering = session.declare_queryable(at.as_str()).complete(true);
    let answering = answering.callback(move |query| {
        let answered = query.reply(query.key_expr().clone(), frame.clone());
        answered.wait().expect("an open session");
    });
    let _answering = answering.await.expect("an open session");
    until(&node, |view| view.policy.as_ref() == Some(&second)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn one_that_never_answers_keeps_no_robot_from_what_another_announces() {
    let network = Network::start().await;
    let session = network.join().await;
    let at = keys::manifest(FLEET).expect("a good name");
    let (asked, mut questions) = mpsc::unbounded_channel();
    let hanging = session.declare_queryable(at.as_str()).complete(true);
    let hanging = hanging.callback(move |query| asked.send(query).expect("the test runs"));
    let _hanging = hanging.await.expect("an open session");
    let node = late(&network, "r1").await;
    let _kept = questions.recv().await.expect("the robot asks");
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(10, "policy", int8_policy()).await;
    published.expect("a good policy");
    // Zenoh itself waits ten seconds for an answer.
    let taken = timeout(Duration::from_secs(6), runs(&node, 10)).await;
    taken.expect("the robot does not wait for the one that never answers");
}
