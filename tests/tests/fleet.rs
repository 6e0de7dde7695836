//! Policies on their way from publishers to robots, on real Zenoh sessions over loopback.

mod support;

use firmware_sim::client;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::UpdateError;
use host_train::publish::{PublishError, manifest, sign};
use reagent_core::Pose;
use reagent_core::wire::{self, keys};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use support::{
    FLEET, Network, key, local_pose, publisher, random_cloud, random_policy, request, until,
};
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

#[tokio::test(flavor = "multi_thread")]
async fn a_late_joiner_fetches_and_a_new_version_replaces_the_old() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    let node = network.node(FLEET, "late").await;
    until(&node, |view| {
        view.policy.as_ref().is_some_and(|p| p.version == 1)
    })
    .await;

    let second = random_policy(2);
    publisher
        .publish(2, "second", second.clone())
        .await
        .expect("a good policy");
    until(&node, |view| {
        view.policy.as_ref().is_some_and(|p| p.version == 2)
    })
    .await;
    let (source, target) = (random_cloud(1, 100), random_cloud(2, 100));
    let session = network.join().await;
    let reply = client::refine(&session, FLEET, "late", &request(&source, &target)).await;
    let expected = local_pose(&second, &source, &target, Pose::IDENTITY).to_rows();
    assert_eq!(reply.expect("a pose").target_from_source, expected);

    let older = publisher.publish(2, "again", random_policy(3)).await;
    assert!(
        matches!(older, Err(PublishError::Version { announced: 2, .. })),
        "{older:?}"
    );
}

/// Announces `signed` and serves `file` for its chunks, as a broken or hostile host might.
async fn announce(
    session: &Session,
    signed: Vec<u8>,
    file: Vec<u8>,
    chunks_of: &wire::Manifest,
) -> (Queryable<()>, Arc<AtomicU32>) {
    let asked = Arc::new(AtomicU32::new(0));
    let count = asked.clone();
    let chunks = keys::chunks(FLEET, &chunks_of.sha256).expect("a good name");
    let served = session
        .declare_queryable(chunks.as_str())
        .callback(move |query| {
            count.fetch_add(1, Ordering::Relaxed);
            let index = keys::chunk_index(query.key_expr().as_str()).expect("a chunk's key");
            let chunk = file.chunks(wire::CHUNK_BYTES).nth(index as usize);
            let chunk = chunk.expect("a chunk of the file").to_vec();
            query
                .reply(query.key_expr().clone(), chunk)
                .wait()
                .expect("an open session");
        })
        .await
        .expect("an open session");
    let manifest = keys::manifest(FLEET).expect("a good name");
    session
        .put(manifest.as_str(), signed)
        .await
        .expect("an open session");
    (served, asked)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_corrupted_file_is_refused_and_the_old_policy_kept() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    let first = publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    let node = network.node(FLEET, "r1").await;
    until(&node, |view| view.policy.is_some()).await;

    let session = network.join().await;
    let good = random_policy(2);
    let flipped = manifest(2, "flipped", &good).expect("a good policy");
    let mut bad = good.bytes().to_vec();
    bad[5_000_000] ^= 1;
    let _serving = announce(&session, sign(&key(1), &flipped), bad, &flipped).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::Sha256 { .. }), "{error}");
    assert_eq!(view.policy.as_ref(), Some(&first));

    let short = good.bytes()[..good.bytes().len() - 100].to_vec();
    let mut cut = flipped.clone();
    (cut.version, cut.sha256) = (3, [3; 32]);
    let _serving = announce(&session, sign(&key(1), &cut), short, &cut).await;
    let view = until(&node, |view| view.updates_refused == 2).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::Chunk { .. }), "{error}");
    assert_eq!(view.policy.as_ref(), Some(&first));
}

#[tokio::test(flavor = "multi_thread")]
async fn only_newer_policies_with_a_trusted_signature_are_fetched() {
    let network = Network::start().await;
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trusted: vec![key(8).verifying_key(), key(1).verifying_key()],
        state: None,
    };
    let node = Node::start(network.join().await, config)
        .await
        .expect("good names");
    let mut publisher = publisher(&network).await;
    publisher
        .publish(10, "first", random_policy(1))
        .await
        .expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;

    let session = network.join().await;
    let file = random_policy(2);
    let newer = manifest(11, "newer", &file).expect("a good policy");
    let strangers = sign(&key(2), &newer);
    let (_serving, asked) = announce(&session, strangers, file.bytes().to_vec(), &newer).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::Untrusted { .. }), "{error}");

    let good = sign(&key(1), &newer);
    let manifest_key = keys::manifest(FLEET).expect("a good name");
    type Expected = fn(&UpdateError) -> bool;
    let mut frames: Vec<(Vec<u8>, Expected)> = Vec::new();
    for at in [4, 40, good.len() - 1] {
        let mut damaged = good.clone();
        damaged[at] ^= 1;
        frames.push((damaged, |e| matches!(e, UpdateError::Signature)));
    }
    frames.push((good[..50].to_vec(), |e| matches!(e, UpdateError::Frame(_))));
    frames.push((vec![], |e| matches!(e, UpdateError::Frame(_))));
    let mut other_version = good.clone();
    other_version[0] = 9;
    frames.push((other_version, |e| {
        matches!(
            e,
            UpdateError::Frame(reagent_core::Error::FrameVersion { found: 9 })
        )
    }));
    for (count, (frame, expected)) in (2..).zip(frames) {
        session
            .put(manifest_key.as_str(), frame)
            .await
            .expect("an open session");
        let view = until(&node, |view| view.updates_refused == count).await;
        let error = view.last_refusal.expect("there is one");
        assert!(expected(&error), "{error}");
    }

    // An older one is not even fetched; the newer one after it shows that it was seen and ignored.
    let older = sign(
        &key(1),
        &wire::Manifest {
            version: 9,
            ..newer.clone()
        },
    );
    session
        .put(manifest_key.as_str(), older)
        .await
        .expect("an open session");
    assert_eq!(asked.load(Ordering::Relaxed), 0);
    session
        .put(manifest_key.as_str(), good)
        .await
        .expect("an open session");
    let view = until(&node, |view| {
        view.policy.as_ref().is_some_and(|p| p.version == 11)
    })
    .await;
    assert_eq!(view.updates_refused, 7);
    assert_eq!(Some(asked.load(Ordering::Relaxed)), newer.chunks());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_restarted_robot_has_its_policy_without_a_host() {
    let state = tempfile::tempdir().expect("a temporary directory");
    let config = || NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trusted: vec![],
        state: Some(state.path().join("made/by/the/node")),
    };
    let network = Network::start().await;
    {
        let node = Node::start(network.join().await, config())
            .await
            .expect("good names");
        let mut publisher = publisher(&network).await;
        for version in [1, 2] {
            let policy = random_policy(version);
            publisher
                .publish(version, "kept", policy)
                .await
                .expect("a good policy");
            let new = move |p: &wire::Manifest| p.version == version;
            until(&node, |view| view.policy.as_ref().is_some_and(new)).await;
        }
    }
    let node = Node::start(network.join().await, config())
        .await
        .expect("good names");
    let view = until(&node, |_| true).await;
    assert_eq!(view.policy.as_ref().map(|p| p.version), Some(2));
    drop(node);

    let files = || std::fs::read_dir(state.path().join("made/by/the/node")).expect("a directory");
    let is_policy = |path: &std::path::PathBuf| path.extension().is_some_and(|e| e == "rgw");
    let mut kept = files()
        .map(|e| e.expect("readable").path())
        .filter(is_policy);
    let file = kept.next().expect("the policy in use");
    assert_eq!(kept.next(), None, "the old policy is gone");
    let mut bytes = std::fs::read(&file).expect("readable");
    bytes[1000] ^= 4;
    std::fs::write(&file, bytes).expect("writable");
    let node = Node::start(network.join().await, config())
        .await
        .expect("it starts all the same");
    let view = until(&node, |_| true).await;
    assert_eq!((view.policy, view.updates_refused), (None, 1));
}
