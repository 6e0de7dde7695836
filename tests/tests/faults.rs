//! Networks that fail: routers, links and publishers go and come back.

mod support;

use firmware_sim::client::{Client, Heard, MARGIN, RefineError};
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::session::{SessionArgs, open};
use futures::future::join_all;
use host_train::policy::WeightFile;
use host_train::publish::{PublishError, Publisher, chunk_table, manifest};
use reagent_core::wire::{self, Manifest, RefineReply, RefineRequest, keys};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use support::link::{Faults, Link};
use support::{
    FLEET, Host, Network, int8_policy, key, publisher, random_cloud, random_policy, request,
    served, until,
};
use tokio::sync::Notify;
use zenoh::Session;
use zenoh::Wait;
use zenoh::bytes::ZBytes;

async fn join(endpoint: &str) -> Session {
    let args = SessionArgs {
        connect: vec![endpoint.into()],
        ..SessionArgs::default()
    };
    open(&args).await.expect("the router listens")
}

fn config(robot: &str) -> NodeConfig {
    NodeConfig {
        fleet: FLEET.into(),
        robot: robot.into(),
        trust: Trust::Keys(vec![key(1).verifying_key(), key(2).verifying_key()]),
        state: None,
    }
}

/// Sends a request, and checks that the answer or its absence comes in time.
async fn ask_in_time(
    client: &Client,
    request: &RefineRequest<'_>,
) -> Result<RefineReply, RefineError> {
    let asked = Instant::now();
    let answer = client.refine("r1", request).await;
    let allowed = Duration::from_millis(request.budget_ms.into()) + 2 * MARGIN;
    assert!(
        asked.elapsed() < allowed,
        "{answer:?} after {:?}",
        asked.elapsed()
    );
    answer
}

#[tokio::test(flavor = "multi_thread")]
async fn a_router_that_is_killed_and_back_costs_no_request_beyond_its_deadline() {
    let network = Network::start().await;
    let node = Node::start(network.join().await, config("r1")).await;
    let node = node.expect("good names");
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "first", random_policy(1)).await;
    published.expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;
    let client = Client::new(network.join().await, FLEET).await;
    let client = client.expect("a good name");
    let (small, large) = (random_cloud(1, 20), random_cloud(1, 4096));
    let mut quick = request(&small, &small);
    quick.budget_ms = 2000;
    let long = RefineRequest {
        max_steps: 255,
        budget_ms: 3000,
        ..request(&large, &large)
    };
    ask_in_time(&client, &quick).await.expect("a pose");

    // In the middle of a request.
    let (answer, ()) = tokio::join!(ask_in_time(&client, &long), async {
        until(&node, |view| view.in_hand == 1).await;
        network.router.close().await.expect("it was open");
    });
    assert!(answer.is_err(), "{answer:?}");
    let while_away = ask_in_time(&client, &quick).await;
    assert!(while_away.is_err(), "{while_away:?}");

    // Everybody finds the new router, and the fleet goes on with requests and updates.
    let args = SessionArgs {
        listen: vec![network.endpoint.clone()],
        ..SessionArgs::default()
    };
    let _router = open(&args).await.expect("the port is free again");
    let refine = keys::refine(FLEET, "r1").expect("good names");
    served(client.session(), &refine).await;
    ask_in_time(&client, &quick).await.expect("a pose");
    let published = publisher.publish(2, "second", random_policy(2)).await;
    let second = published.expect("a good policy");
    until(&node, |view| view.policy.as_ref() == Some(&second)).await;
}

/// Waits until the robots that a client has heard are as wanted.
async fn until_heard(client: &Client, wanted: impl Fn(&[Heard]) -> bool) {
    let mut changes = client.changes();
    let seen = async {
        while !wanted(&client.heard()) {
            changes.changed().await.expect("the client is there");
        }
    };
    let seen = tokio::time::timeout(Duration::from_secs(60), seen).await;
    assert!(seen.is_ok(), "{:?}", client.heard());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_stays_sees_idle_robots_again_when_the_router_is_back() {
    let network = Network::start().await;
    let node = Node::start(network.join().await, config("r1")).await;
    let node = node.expect("good names");
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "first", int8_policy()).await;
    published.expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;
    let client = Client::new(network.join().await, FLEET).await;
    let client = client.expect("a good name");
    client.follow_robots().await.expect("an open session");
    let is_there = |robots: &[Heard]| robots.iter().any(|r| r.offline_since.is_none());
    until_heard(&client, is_there).await;

    network.router.close().await.expect("it was open");
    until_heard(&client, |robots| !is_there(robots)).await;
    let left = client.heard();
    assert_eq!(left.len(), 1, "it is known still: {left:?}");
    let args = SessionArgs {
        listen: vec![network.endpoint.clone()],
        ..SessionArgs::default()
    };
    let _router = open(&args).await.expect("the port is free again");
    // No request reaches the robot meanwhile.
    until_heard(&client, is_there).await;
    let cloud = random_cloud(1, 20);
    let (robot, _) = client
        .refine_any(&request(&cloud, &cloud))
        .await
        .expect("a pose");
    assert_eq!(robot, "r1");
    drop(node);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bad_link_makes_updates_and_answers_late_and_never_wrong() {
    let network = Network::start().await;
    let bad = Faults {
        delay: Duration::from_millis(200),
        loss: 0.3,
        again: Duration::from_millis(200),
    };
    let link = Link::to(&network.endpoint, bad, 1).await;
    let node = Node::start(join(&link.endpoint).await, config("r1")).await;
    let node = node.expect("good names");
    let session = network.join().await;
    let policy = int8_policy();
    let new = manifest(1, "first", &policy).expect("a good policy");
    // The link is cut twice during the transfer.
    let answered = Arc::new(AtomicU32::new(0));
    let (file, cutting, count) = (
        policy.bytes().to_vec(),
        Arc::new(Notify::new()),
        answered.clone(),
    );
    let cut = cutting.clone();
    let host = Host::serve(
        &session,
        new.clone(),
        chunk_table(policy.bytes()).concat(),
        move |index| {
            if [20, 50].contains(&count.fetch_add(1, Ordering::Relaxed)) {
                cut.notify_one();
            }
            let chunk = file.chunks(wire::CHUNK_BYTES).nth(index as usize);
            chunk.map(<[u8]>::to_vec)
        },
    );
    let host = host.await;
    host.announce(&session).await;
    // When its link is back it asks again, and somebody answers.
    let announced = keys::manifest(FLEET).expect("a good name");
    let (answer, reply_key) = (ZBytes::from(host.signed.clone()), announced.clone());
    let answering = session.declare_queryable(announced.as_str()).complete(true);
    let answering = answering.callback(move |query| {
        query
            .reply(reply_key.as_str(), answer.clone())
            .wait()
            .expect("an open session");
    });
    let _answering = answering.await.expect("an open session");
    for _ in 0..2 {
        cutting.notified().await;
        link.cut();
    }
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy, Some(new));

    let client = Client::new(session, FLEET).await.expect("a good name");
    let cloud = random_cloud(1, 1024);
    let request = RefineRequest {
        budget_ms: 3000,
        ..request(&cloud, &cloud)
    };
    let asked = (0..8).map(|id| {
        let (client, request) = (&client, RefineRequest { id, ..request });
        async move { ask_in_time(client, &request).await }
    });
    let mut poses = 0;
    for answer in join_all(asked).await {
        match answer {
            Ok(_) => poses += 1,
            Err(RefineError::Deadline { .. } | RefineError::Refused { .. }) => {}
            Err(other) => panic!("{other}"),
        }
    }
    assert!(poses > 0, "the first of them has time");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_publisher_that_goes_half_way_leaves_the_old_policy_and_the_half() {
    let network = Network::start().await;
    let node = Node::start(network.join().await, config("r1")).await;
    let node = node.expect("good names");
    let mut first = publisher(&network).await;
    let published = first.publish(1, "first", random_policy(1)).await;
    let old = published.expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;

    let session = network.join().await;
    let policy = random_policy(2);
    let new = manifest(2, "second", &policy).expect("a good policy");
    let (half_way, file) = (Arc::new(Notify::new()), policy.bytes().to_vec());
    let (reached, table) = (half_way.clone(), chunk_table(&file).concat());
    let going = Host::serve(&session, new.clone(), table, move |index| {
        if index == 100 {
            reached.notify_one();
        }
        let chunk = file.chunks(wire::CHUNK_BYTES).nth(index as usize);
        (index < 100).then_some(chunk?.to_vec())
    });
    let going = going.await;
    going.announce(&session).await;
    half_way.notified().await;
    drop(going);
    let view = until(&node, |view| view.updates_refused == 1).await;
    assert_eq!(view.policy, Some(old));

    let back = Host::of_file(&session, new.clone(), policy.bytes().to_vec()).await;
    back.announce(&session).await;
    until(&node, |view| view.policy.as_ref() == Some(&new)).await;
    let rest = new.chunks().expect("chunks") - 100;
    assert_eq!(back.asked(), rest);
}

#[tokio::test(flavor = "multi_thread")]
async fn of_two_publishers_that_race_every_robot_takes_the_same() {
    let network = Network::start().await;
    let mut nodes = Vec::new();
    for robot in ["r1", "r2", "r3"] {
        let node = Node::start(network.join().await, config(robot)).await;
        nodes.push(node.expect("good names"));
    }
    let mut one = publisher(&network).await;
    let mut other = Publisher::new(network.join().await, FLEET, key(2)).expect("a good name");
    // Both use one version: neither may know of the other in time, but the robots agree.
    let (a, b) = tokio::join!(
        one.publish(5, "one", random_policy(1)),
        other.publish(5, "other", random_policy(2)),
    );
    let order = |manifest: &Manifest| (manifest.version, manifest.sha256);
    let announced: Vec<Manifest> = [a, b].into_iter().flatten().collect();
    let last = announced.into_iter().max_by_key(order);
    let last = last.expect("at least one was published");
    for node in &nodes {
        until(node, |view| view.policy.as_ref() == Some(&last)).await;
    }
    // Now one after the other: the later publisher is refused.
    let published = one.publish(7, "seven", random_policy(3)).await;
    published.expect("a good policy");
    for version in [6, 7] {
        let late = other.publish(version, "late", random_policy(4)).await;
        assert!(
            matches!(&late, Err(PublishError::Version { announced, .. }) if announced.version == 7),
            "{late:?}"
        );
    }
    // The same policy under the same version is not a conflict, but a second source of it.
    let again: WeightFile = random_policy(3);
    let again = other.publish(7, "seven", again).await;
    assert!(again.is_ok(), "{again:?}");
}
