//! Updates that are cut short, partly changed, or do not do what they should.

mod support;

use firmware_sim::node::Node;
use firmware_sim::policy::UpdateError;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::publish::{PublishError, chunk_table, manifest};
use reagent_core::wire::{self, keys};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use support::{FLEET, Host, Network, config, publisher, random_policy, storage, until};
use tokio::sync::Notify;
use zenoh::Wait;

#[tokio::test(flavor = "multi_thread")]
async fn a_node_killed_half_way_goes_on_where_it_was() {
    let state = tempfile::tempdir().expect("a temporary directory");
    let network = Network::start().await;
    let session = network.join().await;
    let policy = random_policy(4);
    let new = manifest(1, "new", &policy).expect("a good policy");
    let table = chunk_table(policy.bytes()).concat();

    // The host answers for a hundred chunks and then falls silent.
    let (answered, half_way) = (AtomicU32::new(0), Arc::new(Notify::new()));
    let (file, reached) = (policy.bytes().to_vec(), half_way.clone());
    let stingy = Host::serve(&session, new.clone(), table, move |index| {
        if answered.fetch_add(1, Ordering::Relaxed) >= 100 {
            reached.notify_one();
            return None;
        }
        let chunk = file.chunks(wire::CHUNK_BYTES).nth(index as usize);
        chunk.map(<[u8]>::to_vec)
    });
    let stingy = stingy.await;
    let node = Node::start(network.join().await, config(state.path())).await;
    let node = node.expect("good names");
    stingy.announce(&session).await;
    half_way.notified().await;
    node.stop().await;
    drop(stingy);

    let host = Host::of_file(&session, new.clone(), policy.bytes().to_vec()).await;
    let node = Node::start(network.join().await, config(state.path())).await;
    let node = node.expect("good names");
    host.announce(&session).await;
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy.as_ref(), Some(&new));
    let rest = new.chunks().expect("chunks") - 100;
    // Of the eight in flight when the node was killed, some had arrived.
    assert!(
        (rest..=rest + 8).contains(&host.asked()),
        "{} of {rest}",
        host.asked()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_could_not_be_fetched_is_tried_again_as_long_as_it_is_served() {
    let network = Network::start().await;
    let session = network.join().await;
    let policy = random_policy(6);
    let first = manifest(1, "first", &policy).expect("a good policy");
    let table = chunk_table(policy.bytes()).concat();
    let (file, are_there) = (policy.bytes().to_vec(), Arc::new(AtomicBool::new(false)));
    let there = are_there.clone();
    let host = Host::serve(&session, first.clone(), table, move |index| {
        let chunk = file.chunks(wire::CHUNK_BYTES).nth(index as usize);
        chunk
            .filter(|_| there.load(Ordering::Relaxed))
            .map(<[u8]>::to_vec)
    });
    let host = host.await;
    let (at, frame) = (
        keys::manifest(FLEET).expect("a good name"),
        host.signed.clone(),
    );
    let answering = session.declare_queryable(at.as_str()).complete(true);
    let questions = AtomicU32::new(0);
    let answering = answering.callback(move |query| {
        // A robot asks at first, and as it finds a publisher; later it asks from time to time.
        if questions.fetch_add(1, Ordering::Relaxed) == 2 {
            are_there.store(true, Ordering::Relaxed);
        }
        let answered = query.reply(query.key_expr().clone(), frame.clone());
        answered.wait().expect("an open session");
    });
    let _answering = answering.await.expect("an open session");
    let node = network.node(FLEET, "r1").await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::Chunk { .. }), "{error}");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy, Some(first));
}

#[tokio::test(flavor = "multi_thread")]
async fn only_what_changed_is_fetched() {
    let network = Network::start().await;
    let session = network.join().await;
    let node = network.node(FLEET, "r1").await;
    let mut publisher = publisher(&network).await;
    let first = publisher.publish(1, "first", random_policy(5)).await;
    let chunks = first.expect("a good policy").chunks().expect("chunks");
    until(&node, |view| view.policy.is_some()).await;

    // The same but for one weight: its chunk changes, and the last one with the checksum.
    let mut parameters = Parameters::random(Shape::PAPER, 5);
    parameters.values[0] += 1.0;
    let policy = WeightFile::from_parameters(&parameters).expect("deployable");
    let second = manifest(2, "second", &policy).expect("a good policy");
    let host = Host::of_file(&session, second, policy.bytes().to_vec()).await;
    host.announce(&session).await;
    let updated = until(&node, |view| {
        view.policy.as_ref().is_some_and(|p| p.version == 2)
    });
    updated.await;
    assert_eq!(host.asked(), 2, "of {chunks} chunks");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_acts_otherwise_than_it_should_is_not_taken() {
    let network = Network::start().await;
    let session = network.join().await;
    let node = network.node(FLEET, "r1").await;
    let mut publisher = publisher(&network).await;
    let bundled = || WeightFile::load_or_pretrained(None).expect("linked in");
    let first = publisher.publish(1, "first", bundled()).await;
    let first = first.expect("a good policy");
    assert!(!first.golden.is_empty());
    until(&node, |view| view.policy.is_some()).await;

    let mut wrong = manifest(2, "wrong", &bundled()).expect("a good policy");
    wrong.golden[0].rotation[1] ^= 1;
    let host = Host::of_file(&session, wrong, bundled().bytes().to_vec()).await;
    host.announce(&session).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::SelfTest), "{error}");
    assert_eq!(view.policy.as_ref(), Some(&first));

    let mut foreign = manifest(3, "foreign", &bundled()).expect("a good policy");
    foreign.shape[0] = 32;
    let host = Host::of_file(&session, foreign, bundled().bytes().to_vec()).await;
    host.announce(&session).await;
    let view = until(&node, |view| view.updates_refused == 2).await;
    let error = view.last_refusal.expect("there is one");
    assert!(
        matches!(*error, UpdateError::Incompatible { .. }),
        "{error}"
    );
    assert_eq!(host.asked(), 0, "what cannot run is not fetched");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stored_policy_needs_no_publisher() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    let unkept = publisher.store(1, "first", &random_policy(1)).await;
    assert!(
        matches!(unkept, Err(PublishError::NotStored { stored: 0, .. })),
        "{unkept:?}"
    );

    let _storage = storage(&network.router).await;
    let stored = publisher.store(1, "first", &random_policy(1)).await;
    let stored = stored.expect("it is kept");
    drop(publisher);
    let node = network.node(FLEET, "late").await;
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy, Some(stored));

    // A later publisher is told what is there.
    let mut next = support::publisher(&network).await;
    for version in [0, 1] {
        let older = next.store(version, "older", &random_policy(2)).await;
        assert!(
            matches!(&older, Err(PublishError::Version { announced, .. }) if announced.version == 1),
            "{older:?}"
        );
    }
}
