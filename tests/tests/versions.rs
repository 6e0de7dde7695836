//! Versions that should never have been, the way back, and what publishers are told of both.

mod support;

use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::{Trust, UpdateError};
use host_train::publish::{PublishArgs, PublishError, Publisher, manifest};
use reagent_core::wire::{Manifest, Release, WhyNot};
use std::time::Duration;
use support::{FLEET, Host, Network, int8_policy, key, publisher, storage, until};

const NOW: u64 = 1_795_000_000;

#[tokio::test(flavor = "multi_thread")]
async fn a_version_far_ahead_is_refused_by_both_ends() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let mut publisher = publisher(&network).await;
    let file = int8_policy();
    let far = publisher.publish(u64::MAX, "far", file.clone()).await;
    let Err(PublishError::FarAhead { .. }) = &far else {
        panic!("{far:?}");
    };

    // A publisher that does not check.
    let session = network.join().await;
    let far = manifest(u64::MAX, "far", &file).expect("a good policy");
    let host = Host::of_file(&session, far, file.bytes().to_vec()).await;
    host.announce(&session).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let error = view.last_refusal.expect("there is one");
    assert!(matches!(*error, UpdateError::FarAhead { .. }), "{error}");
    assert_eq!((view.policy, host.asked()), (None, 0));

    let first = publisher.publish(NOW, "first", file.clone()).await;
    let first = first.expect("a good policy");
    until(&node, |view| view.policy.as_ref() == Some(&first)).await;
    // Ten years ahead.
    let years = publisher.publish(NOW + 315_360_000, "far", file).await;
    assert!(
        matches!(years, Err(PublishError::FarAhead { last, .. }) if last == first.release()),
        "{years:?}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_greater_epoch_is_the_way_back() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let mut careless = publisher(&network).await;
    let file = int8_policy();
    // A trainer whose clock was in the future published before there were other versions.
    let future = careless.publish(NOW * 2, "future", file.clone()).await;
    let future = future.expect("a good policy");
    until(&node, |view| view.policy.as_ref() == Some(&future)).await;
    drop(careless);

    // The robots that run a policy make it known even when nobody announces it any more.
    let mut publisher = publisher(&network).await;
    let back = publisher.publish(NOW, "back", file.clone()).await;
    let error = back.expect_err("the robot would not take it").to_string();
    assert!(
        error.contains("robot r1 runs") && error.contains("--epoch 1"),
        "{error}"
    );
    publisher.epoch = 1;
    let back = publisher.publish(7, "back", file.clone()).await;
    let back = back.expect("a new epoch");
    until(&node, |view| view.policy.as_ref() == Some(&back)).await;

    // The time is too far ahead of a version counted by hand, so the next default version follows that one.
    let next = publisher.default_version(NOW).await;
    let next = next.expect("an open session");
    assert_eq!(next, 8);
    let counted = publisher.publish(next, "counted", file.clone()).await;
    let counted = counted.expect("a newer version");
    until(&node, |view| view.policy.as_ref() == Some(&counted)).await;

    // The old epoch is over, whatever the version, and the message says how to go on.
    publisher.epoch = 0;
    let old = publisher.publish(NOW * 2 + 1, "old", file.clone()).await;
    assert!(matches!(old, Err(PublishError::Epoch { .. })), "{old:?}");
    let said = old.expect_err("it is over").to_string();
    assert!(
        said.contains("give --epoch 1 with a greater version"),
        "{said}"
    );
    let session = network.join().await;
    let old = Manifest {
        version: NOW * 2 + 1,
        ..future
    };
    let host = Host::of_file(&session, old, file.bytes().to_vec()).await;
    host.announce(&session).await;
    let view = until(&node, |view| view.updates_refused == 1).await;
    let epoch_1 = Release {
        epoch: 1,
        version: 8,
    };
    let told = view.not_taken.expect("it is told").reason;
    assert_eq!(told, WhyNot::NotNewer(epoch_1));
    publisher.epoch = 5000;
    let far = publisher.publish(1, "far", file).await;
    assert!(matches!(far, Err(PublishError::FarAhead { .. })), "{far:?}");
}

/// A stranger's newer version, whose key no robot trusts, keeps nobody from taking a policy back.
#[tokio::test(flavor = "multi_thread")]
async fn a_policy_is_taken_back_whatever_a_stranger_has_announced() {
    let network = Network::start().await;
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trust: Trust::Keys(vec![key(1).verifying_key()]),
        state: None,
    };
    let node = Node::start(network.join().await, config).await;
    let node = node.expect("good names");
    let mut publisher = publisher(&network).await;
    let file = int8_policy();
    let worse = publisher.publish(2, "worse", file.clone()).await;
    let worse = worse.expect("a good policy");
    until(&node, |view| view.policy.as_ref() == Some(&worse)).await;
    let mut stranger = Publisher::new(network.join().await, FLEET, key(2)).expect("a good name");
    let foreign = stranger.publish(9, "foreign", file.clone()).await;
    foreign.expect("a newer version");
    let refused = publisher.publish(3, "old", file.clone()).await;
    let is_older = matches!(refused, Err(PublishError::Version { .. }));
    assert!(is_older, "{refused:?}");
    let back = publisher.publish_over(worse.release(), "old", file).await;
    let back = back.expect("robots run no newer one");
    assert_eq!(back.version, 3);
    until(&node, |view| view.policy.as_ref() == Some(&back)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_version_the_time_counts_unless_versions_were_counted_by_hand() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    for (epoch, last, time, expected) in [
        (0, None, NOW, NOW),
        (0, Some(3), NOW, 4),
        (1, None, NOW, NOW),
        (1, Some(NOW), NOW + 9, NOW + 9),
        // A clock went back, or another one is ahead: publishing under the time is refused, so that somebody looks.
        (1, Some(NOW + 10), NOW, NOW),
        (2, Some(1), NOW, 2),
        // An epoch that is over.
        (1, None, NOW, NOW),
    ] {
        publisher.epoch = epoch;
        if let Some(version) = last {
            let published = publisher.publish(version, "last", int8_policy()).await;
            published.expect("a newer version");
        }
        let version = publisher.default_version(time).await;
        assert_eq!(
            version.expect("an open session"),
            expected,
            "{epoch}, {last:?}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn publishers_are_told_who_took_a_policy_and_who_did_not_and_why() {
    let network = Network::start().await;
    let robot = async |robot: &str, trusted: u8| {
        let config = NodeConfig {
            fleet: FLEET.into(),
            robot: robot.into(),
            trust: Trust::Keys(vec![key(trusted).verifying_key()]),
            state: None,
        };
        let node = Node::start(network.join().await, config).await;
        node.expect("good names")
    };
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "first", int8_policy()).await;
    let published = published.expect("a good policy");
    let nobody = publisher.reception(&published, Duration::ZERO);
    let nobody = nobody.await.expect("an open session");
    assert!(
        nobody.to_string().starts_with("no robot is there"),
        "{nobody}"
    );

    let _robots = [
        robot("a", 1).await,
        robot("b", 2).await,
        robot("c", 1).await,
    ];
    let published = publisher.publish(2, "second", int8_policy()).await;
    let published = published.expect("a good policy");
    let told = publisher.reception(&published, Duration::from_secs(60));
    let told = told.await.expect("an open session");
    assert_eq!(told.taken, ["a", "c"]);
    assert_eq!(told.refused, [("b".to_owned(), WhyNot::Untrusted)]);
    assert_eq!(told.silent, []);
}

/// A publisher that waits for no robots is told of none, and that is not a failure.
#[tokio::test(flavor = "multi_thread")]
async fn a_policy_is_stored_without_waiting_for_robots() {
    #[derive(clap::Parser)]
    struct Publish {
        #[command(flatten)]
        args: PublishArgs,
    }
    let folder = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| folder.path().join(name).display().to_string();
    host_train::publish::keygen(&folder.path().join("key")).expect("written");
    int8_policy()
        .save(&folder.path().join("policy.rgw"))
        .expect("written");
    let network = Network::start().await;
    let _storage = storage(&network.router).await;
    let trusted = Trust::Keys(vec![key(2).verifying_key()]);
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "a".into(),
        trust: trusted,
        state: None,
    };
    let node = Node::start(network.join().await, config).await;
    let _node = node.expect("good names");
    for (version, wait) in [("1", "0"), ("2", "60")] {
        let (weights, key) = (at("policy.rgw"), at("key"));
        let arguments = [
            "publish",
            "--weights",
            &weights,
            "--key",
            &key,
            "--fleet",
            FLEET,
            "--store",
            "--policy-version",
            version,
            "--wait",
            wait,
            "--connect",
            &network.endpoint,
        ];
        let Publish { args } = clap::Parser::try_parse_from(arguments).expect("good usage");
        let published = host_train::publish::run(args).await;
        let is_told = matches!(published, Err(PublishError::NotTaken { .. }));
        assert_eq!(is_told, wait != "0", "{published:?}");
    }
}

/// Signed with the wrong key, then with the right one: what a robot said of the first is no answer to the second.
#[tokio::test(flavor = "multi_thread")]
async fn a_version_that_was_refused_is_taken_from_who_is_trusted() {
    let network = Network::start().await;
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "a".into(),
        trust: Trust::Keys(vec![key(1).verifying_key()]),
        state: None,
    };
    let node = Node::start(network.join().await, config).await;
    let _node = node.expect("good names");
    let told = async |publisher: &mut Publisher, seconds: u64| {
        let published = publisher.publish(1, "policy", int8_policy()).await;
        let published = published.expect("a good policy");
        let told = publisher.reception(&published, Duration::from_secs(seconds));
        told.await.expect("an open session")
    };
    let mut stranger = Publisher::new(network.join().await, FLEET, key(2)).expect("a good name");
    let untrusted = [("a".to_owned(), WhyNot::Untrusted)];
    assert_eq!(told(&mut stranger, 60).await.refused, untrusted);
    // With the wrong key again, and no time to wait.
    assert_eq!(told(&mut stranger, 0).await.refused, untrusted);
    drop(stranger);
    let mut publisher = publisher(&network).await;
    assert_eq!(told(&mut publisher, 60).await.taken, ["a"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_is_announced_and_asked_for_is_refused_once() {
    let network = Network::start().await;
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trust: Trust::Keys(vec![key(1).verifying_key()]),
        state: None,
    };
    let node = Node::start(network.join().await, config).await;
    let node = node.expect("good names");
    let policy = int8_policy();
    for version in 1..=4 {
        // A new publisher is heard, and then asked.
        let mut stranger = Publisher::new(network.join().await, FLEET, key(2));
        let stranger = stranger.as_mut().expect("a good name");
        let published = stranger.publish(version, "foreign", policy.clone()).await;
        published.expect("a good policy");
        until(&node, |view| view.updates_refused == version).await;
    }
    // This one is taken when everything before it has been considered.
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(5, "own", policy).await;
    published.expect("a good policy");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.updates_refused, 4);
}
