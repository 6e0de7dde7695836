//! Robots, publishers and clients on real Zenoh sessions over loopback.

mod support;

use ed25519_dalek::SigningKey;
use firmware_sim::client::{self, RefineError};
use firmware_sim::node::{Node, NodeConfig, NodeError, QUEUE};
use firmware_sim::policy::UpdateError;
use firmware_sim::session::{SessionArgs, open};
use host_train::export::WeightFile;
use host_train::publish::{PublishError, Publisher, manifest, sign};
use reagent_core::net::Scratch;
use reagent_core::wire::{
    self, Cloud, CloudView, Message, Reason, RefineReply, RefineRequest, Refusal, keys,
};
use reagent_core::{Frame, Pose, Registrar};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use support::{Network, random_cloud, random_policy, until, unused_endpoint};
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

const FLEET: &str = "test";

fn key(seed: u8) -> SigningKey {
    SigningKey::from_bytes(&[seed; 32])
}

async fn publisher(network: &Network) -> Publisher {
    Publisher::new(network.join().await, FLEET, key(1)).expect("a good name")
}

fn request<'a>(source: &'a [[f32; 3]], target: &'a [[f32; 3]]) -> RefineRequest<'a> {
    RefineRequest {
        id: 77,
        max_steps: 10,
        initial: None,
        source: CloudView::of(source),
        target: CloudView::of(target),
    }
}

/// What core computes here for the same clouds.
fn local_pose(policy: &WeightFile, source: &[[f32; 3]], target: &[[f32; 3]], start: Pose) -> Pose {
    let mut scratch = Scratch::new();
    let frame = Frame::of(target).expect("a good cloud");
    Registrar::new(policy.policy(), &mut scratch)
        .register(source, target, frame, start, 10)
        .expect("good clouds")
        .target_from_source
}

async fn refused(session: &Session, request: &RefineRequest<'_>) -> Reason {
    match client::refine(session, FLEET, "r1", request).await {
        Err(RefineError::Refused { refusal, .. }) => {
            assert_eq!(refusal.id, request.id);
            refusal.reason
        }
        other => panic!("not refused: {other:?}"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_published_policy_is_fetched_and_answers_bit_for_bit() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let mut publisher = publisher(&network).await;
    let policy = random_policy(1);
    let shipped = publisher.publish(5, "first", policy.clone());
    let shipped = shipped.await.expect("a good policy");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy, Some(shipped));

    let session = network.join().await;
    let (source, target) = (random_cloud(1, 300), random_cloud(2, 400));
    let initial = Pose::from_rows([[0., -1., 0., 0.5], [1., 0., 0., 0.], [0., 0., 1., -2.]]);
    for initial in [None, Some(initial)] {
        let mut request = request(&source, &target);
        request.initial = initial.map(|pose| pose.to_rows());
        let reply = client::refine(&session, FLEET, "r1", &request).await;
        let reply: RefineReply = reply.expect("a pose");
        let start = initial.unwrap_or(Pose::IDENTITY);
        let expected = local_pose(&policy, &source, &target, start);
        assert_eq!(reply.target_from_source, expected.to_rows());
        assert_ne!(reply.target_from_source, start.to_rows());
        assert_eq!((reply.id, reply.steps, reply.policy_version), (77, 10, 5));
    }
    let view = until(&node, |view| view.served == 2).await;
    assert_eq!((view.refused, view.in_hand), (0, 0));
}

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
    let mut frames: Vec<(Vec<u8>, fn(&UpdateError) -> bool)> = Vec::new();
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

#[tokio::test(flavor = "multi_thread")]
async fn every_bad_request_is_refused_with_its_reason() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let session = network.join().await;
    let good = random_cloud(1, 50);
    assert_eq!(
        refused(&session, &request(&good, &good)).await,
        Reason::NoPolicy
    );

    let mut publisher = publisher(&network).await;
    publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;

    let one = &good[..1];
    let same = [[1.5; 3]; 20];
    let many = random_cloud(2, 4097);
    let mut nan = good.clone();
    nan[17][1] = f32::NAN;
    let cases: [(&[[f32; 3]], &[[f32; 3]], Reason); 8] = [
        (&[], &good, Reason::EmptyCloud(Cloud::Source)),
        (&good, &[], Reason::EmptyCloud(Cloud::Target)),
        (one, &good, Reason::TooFewPoints(Cloud::Source, 1)),
        (&good, &good[..2], Reason::TooFewPoints(Cloud::Target, 2)),
        (&many, &good, Reason::TooManyPoints(Cloud::Source, 4097)),
        (&good, &many, Reason::TooManyPoints(Cloud::Target, 4097)),
        (&nan, &good, Reason::NotFinite(Cloud::Source, 17)),
        (&good, &same, Reason::BadCloud),
    ];
    for (source, target, expected) in cases {
        assert_eq!(refused(&session, &request(source, target)).await, expected);
    }
    let mut skewed = request(&good, &good);
    skewed.initial = Some([[1.0; 4]; 3]);
    assert_eq!(refused(&session, &skewed).await, Reason::BadPose);

    let refine_key = keys::refine(FLEET, "r1").expect("good names");
    let mut status = [0; wire::SMALL_FRAME_BYTES];
    let status = wire::encode(&Message::Status(wire::Status::default()), &mut status);
    let frames: [(&[u8], Reason); 4] = [
        (&[], Reason::Malformed),
        (&[wire::VERSION, 2, 0, 0], Reason::Malformed),
        (status.expect("fits"), Reason::Malformed),
        (
            &[9, 2, 0, 0],
            Reason::WrongVersion {
                spoken: wire::VERSION,
            },
        ),
    ];
    for (frame, reason) in frames {
        match client::ask(&session, &refine_key, "r1", frame.to_vec()).await {
            Err(RefineError::Refused { refusal, .. }) => {
                assert_eq!(refusal, Refusal { id: 0, reason });
            }
            other => panic!("not refused: {other:?}"),
        }
    }
    // After all that it still serves.
    let reply = client::refine(&session, FLEET, "r1", &request(&good, &good)).await;
    assert!(reply.is_ok(), "{reply:?}");
    assert_eq!(until(&node, |view| view.served == 1).await.refused, 14);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_queue_is_refused_and_every_request_answered() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    let node = network.node(FLEET, "r1").await;
    until(&node, |view| view.policy.is_some()).await;
    let session = network.join().await;
    let cloud: Arc<[[f32; 3]]> = random_cloud(1, 4096).into();
    let requests = 4 * QUEUE;
    let mut asking = tokio::task::JoinSet::new();
    for _ in 0..requests {
        let (session, cloud) = (session.clone(), cloud.clone());
        asking.spawn(async move {
            let mut long = request(&cloud, &cloud);
            long.max_steps = 25;
            client::refine(&session, FLEET, "r1", &long)
                .await
                .map(|_| ())
        });
    }
    let (mut poses, mut busy) = (0, 0);
    for answer in asking.join_all().await {
        match answer {
            Ok(()) => poses += 1,
            Err(RefineError::Refused { refusal, .. }) if refusal.reason == Reason::Busy => {
                assert_eq!(refusal.id, 77);
                busy += 1;
            }
            Err(other) => panic!("neither pose nor busy: {other}"),
        }
    }
    assert!(poses > QUEUE && busy > 0, "{poses} poses, {busy} busy");
    assert_eq!(poses + busy, requests);
}

#[tokio::test(flavor = "multi_thread")]
async fn any_robot_is_one_that_is_there_with_the_least_to_do() {
    let network = Network::start().await;
    let session = network.join().await;
    let nobody = client::any_robot(&session, FLEET).await;
    assert!(
        matches!(nobody, Err(RefineError::NoRobot { .. })),
        "{nobody:?}"
    );

    let (first, second) = (
        network.node(FLEET, "a").await,
        network.node(FLEET, "b").await,
    );
    let mut publisher = publisher(&network).await;
    publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    for node in [&first, &second] {
        until(node, |view| view.policy.is_some()).await;
    }
    let cloud = random_cloud(1, 10);
    assert_eq!(client::any_robot(&session, FLEET).await.expect("two"), "a");
    let reply = client::refine(&session, FLEET, "a", &request(&cloud, &cloud)).await;
    assert!(reply.is_ok(), "{reply:?}");
    assert_eq!(client::any_robot(&session, FLEET).await.expect("two"), "b");
    let robots = client::robots(&session, FLEET).await.expect("two");
    let served: Vec<_> = robots.iter().map(|(r, s)| (r.as_str(), s.served)).collect();
    assert_eq!(served, [("a", 1), ("b", 0)]);
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_at_the_key_is_said_at_once() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let session = network.join().await;
    let cloud = random_cloud(1, 10);
    for (fleet, robot) in [(FLEET, "r2"), ("other", "r1")] {
        let asked = std::time::Instant::now();
        let error = client::refine(&session, fleet, robot, &request(&cloud, &cloud)).await;
        let error = error.expect_err("there is no such robot").to_string();
        let key = keys::refine(fleet, robot).expect("good names");
        assert!(
            error.contains(&format!("no robot answered at {key}")),
            "{error}"
        );
        assert!(asked.elapsed() < client::TIMEOUT / 4);
    }
    drop(node);
    let gone = client::refine(&session, FLEET, "r1", &request(&cloud, &cloud)).await;
    assert!(matches!(gone, Err(RefineError::NoRobot { .. })), "{gone:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn no_router_at_the_endpoint_is_an_error_that_names_it() {
    let endpoint = unused_endpoint();
    let args = SessionArgs {
        connect: vec![endpoint.clone()],
        ..SessionArgs::default()
    };
    let error = open(&args)
        .await
        .expect_err("nothing listens there")
        .to_string();
    assert!(error.contains(&endpoint), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn names_that_cannot_be_keys_are_refused() {
    let network = Network::start().await;
    for (fleet, robot) in [("a/b", "r1"), ("f", "*"), ("", "r1"), ("f", "")] {
        let config = NodeConfig {
            fleet: fleet.into(),
            robot: robot.into(),
            trusted: vec![],
            state: None,
        };
        let node = Node::start(network.router.clone(), config).await;
        assert!(
            matches!(node, Err(NodeError::Name { .. })),
            "{fleet} {robot}"
        );
    }
    let config = NodeConfig {
        fleet: "f".into(),
        robot: "any".into(),
        trusted: vec![],
        state: None,
    };
    let node = Node::start(network.router.clone(), config).await;
    assert!(matches!(node, Err(NodeError::Reserved)));
}
