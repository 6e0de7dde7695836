//! Policies on their way from publishers to robots, over real Zenoh sessions on loopback.

mod support;

use firmware_sim::client;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::{Trust, UpdateError};
use host_train::publish::{PublishError, chunk_table, manifest, sign};
use reagent_core::Pose;
use reagent_core::wire::{self, Release, WhyNot};
use support::{
    FLEET, Host, Network, key, local_pose, publisher, put_manifest, random_cloud, random_policy,
    request, until,
};

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
        matches!(&older, Err(PublishError::Version { announced, .. }) if announced.version == 2),
        "{older:?}"
    );
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

    // One bit of one chunk is flipped on its way: that chunk is asked for again, and the others are kept.
    let session = network.join().await;
    let good = random_policy(2);
    let flipped = manifest(2, "flipped", &good).expect("a good policy");
    let table = chunk_table(good.bytes()).concat();
    let mut bad = good.bytes().to_vec();
    bad[5_000_000] ^= 1;
    let host = Host::serve(&session, flipped, table, move |index| {
        let chunk = bad.chunks(wire::CHUNK_BYTES).nth(index as usize);
        chunk.map(<[u8]>::to_vec)
    });
    let host = host.await;
    host.announce(&session).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one").to_string();
    assert!(
        error.contains("chunk 152 of") && error.contains("SHA-256"),
        "{error}"
    );
    assert_eq!(view.policy.as_ref(), Some(&first));
    let again = host.asked() - host.manifest.chunks().expect("chunks");
    assert!((2..10).contains(&again), "{again} chunks asked for again");
    drop(host);

    // A file whose chunks match its table, but that is not the one in the manifest.
    let mut other = manifest(3, "other", &good).expect("a good policy");
    other.sha256 = [3; 32];
    let host = Host::of_file(&session, other, good.bytes().to_vec()).await;
    host.announce(&session).await;
    let view = until(&node, |view| view.updates_refused == 2).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::Sha256 { .. }), "{error}");
    assert_eq!(view.policy.as_ref(), Some(&first));
}

#[tokio::test(flavor = "multi_thread")]
async fn only_newer_policies_with_a_trusted_signature_are_fetched() {
    let network = Network::start().await;
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trust: Trust::Keys(vec![key(8).verifying_key(), key(1).verifying_key()]),
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
    let host = Host::of_file(&session, newer.clone(), file.bytes().to_vec()).await;
    put_manifest(&session, sign(&key(2), &newer)).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::Untrusted { .. }), "{error}");

    let good = sign(&key(1), &newer);
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
            UpdateError::Frame(reagent_core::Error::FrameVersion { found: 9, .. })
        )
    }));
    for (count, (frame, expected)) in (2..).zip(frames) {
        put_manifest(&session, frame).await;
        let view = until(&node, |view| view.updates_refused == count).await;
        let error = view.last_refusal.expect("there is one");
        assert!(expected(&error), "{error}");
    }

    // An older policy is not even fetched, and the robot says so.
    let older = sign(
        &key(1),
        &wire::Manifest {
            version: 9,
            ..newer.clone()
        },
    );
    put_manifest(&session, older).await;
    let view = until(&node, |view| view.updates_refused == 8).await;
    let last = Release {
        epoch: 0,
        version: 10,
    };
    let told = view.not_taken.expect("it is told").reason;
    assert_eq!(told, WhyNot::NotNewer(last));
    assert_eq!(host.asked(), 0);
    put_manifest(&session, good).await;
    let view = until(&node, |view| {
        view.policy.as_ref().is_some_and(|p| p.version == 11)
    })
    .await;
    assert_eq!((view.updates_refused, view.not_taken), (8, None));
    assert_eq!(Some(host.asked()), newer.chunks());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_restarted_robot_has_its_policy_without_a_host() {
    let state = tempfile::tempdir().expect("a temporary directory");
    let config = || NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
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
        node.stop().await;
    }
    let node = Node::start(network.join().await, config())
        .await
        .expect("good names");
    let view = until(&node, |_| true).await;
    assert_eq!(view.policy.as_ref().map(|p| p.version), Some(2));
    node.stop().await;

    // Every fourth byte of the flash beyond the record is damaged: neither slot holds a policy.
    let file = state.path().join("made/by/the/node/flash.bin");
    let mut bytes = std::fs::read(&file).expect("readable");
    let slots = 8192..bytes.len() - 8192;
    bytes[slots]
        .iter_mut()
        .step_by(4)
        .for_each(|byte| *byte ^= 4);
    std::fs::write(&file, bytes).expect("writable");
    let node = Node::start(network.join().await, config())
        .await
        .expect("it starts all the same");
    let view = until(&node, |_| true).await;
    assert_eq!((view.policy, view.updates_refused), (None, 1));
    let other_name = NodeConfig {
        robot: "r2".into(),
        ..config()
    };
    let second = Node::start(network.join().await, other_name).await;
    let error = second.expect_err("the first holds the flash").to_string();
    assert!(
        error.contains("another robot uses this state directory"),
        "{error}"
    );

    // The policy that it ran before comes again; an older one does not.
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "older", random_policy(1)).await;
    published.expect("a good policy");
    let published = publisher.publish(2, "kept", random_policy(2)).await;
    published.expect("a good policy");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy.as_ref().map(|p| p.version), Some(2));
}
