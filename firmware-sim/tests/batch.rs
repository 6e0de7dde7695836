//! Many pairs for a fleet in which a robot dies, or the router is away for a while.
#![cfg(feature = "demo")]

use ed25519_dalek::SigningKey;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::view::View;
use host_train::dataset::pairs::PairSet;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::publish::Publisher;
use reagent_core::wire::{self, Message, Mode, PolicyId, RefineReply, Status, keys};
use reagent_core::{Pose, Verdict};
use reagent_link::session::{SessionArgs, open};
use reagent_tests::network::network;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;
use zenoh::{Session, Wait};

const FLEET: &str = "f";

fn write_pairs(path: &Path, count: usize) {
    let cloud: Vec<_> = (0..60u8)
        .map(|i| [i % 5, i % 7, i % 11].map(|x| 0.1 * f32::from(x) - 0.3))
        .collect();
    let pairs = PairSet {
        source: vec![cloud.clone(); count],
        target: vec![cloud.clone(); count],
        target_from_source: vec![Pose::IDENTITY; count],
        raw: None,
        label: vec![0; count],
        symmetries: None,
        seen: vec![None; count],
    };
    pairs.save(path).expect("a writable directory");
}

fn frame(message: &Message<'_>) -> Vec<u8> {
    let mut buffer = [0; wire::SMALL_FRAME_BYTES];
    let frame = wire::encode(message, &mut buffer).expect("it fits");
    frame.to_vec()
}

/// Robot `a`. It has a policy and nothing to do, answers one request, and dies during the second.
async fn short_lived(endpoint: &str) -> JoinHandle<()> {
    let session = join(endpoint).await;
    let status = keys::status(FLEET, "a").expect("good names");
    let refine = keys::refine(FLEET, "a").expect("good names");
    let idle = frame(&Message::Status(Status {
        policy: Some(PolicyId::default()),
        ..Status::default()
    }));
    let answered = status.clone();
    let statuses = session
        .declare_queryable(status.as_str())
        .callback(move |query| {
            let told = query.reply(answered.as_str(), idle.clone()).wait();
            told.expect("an open session");
        });
    let statuses = statuses.await.expect("an open session");
    let requests = session.declare_queryable(refine.as_str()).await;
    let requests = requests.expect("an open session");
    tokio::spawn(async move {
        let first = requests.recv_async().await.expect("an open session");
        let pose = frame(&Message::RefineReply(RefineReply {
            id: 1,
            target_from_source: Pose::IDENTITY.to_rows(),
            steps: 1,
            mode: Mode::Fast,
            verdict: Verdict::Converged,
            probability: None,
            fit: None,
            waited_micros: 0,
            micros: 0,
            policy_version: 0,
        }));
        let told = first.reply(refine.as_str(), pose).await;
        told.expect("an open session");
        drop(first);
        let _second = requests.recv_async().await.expect("an open session");
        session.close().await.expect("an open session");
        drop(statuses);
    })
}

/// A robot with a policy, on a session of its own.
async fn robot(name: &str, endpoint: &str, publisher: &mut Publisher, version: u64) -> Node {
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: name.into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let policy = WeightFile::from_parameters(&Parameters::random(Shape::COMPACT, 1));
    let published = publisher.publish(version, "p", policy.expect("deployable"));
    published.await.expect("a good policy");
    // Asks for policies when it starts: an announcement may come before its subscription is known.
    let node = Node::start(join(endpoint).await, config).await;
    let node = node.expect("good names");
    until(&node, |view| view.policy.is_some()).await;
    node
}

async fn until(node: &Node, wanted: impl FnMut(&View) -> bool) {
    let mut view = node.watch();
    let reached = tokio::time::timeout(Duration::from_secs(60), view.wait_for(wanted)).await;
    reached.expect("within a minute").expect("the node runs");
}

async fn join(endpoint: &str) -> Session {
    let args = SessionArgs {
        connect: vec![endpoint.into()],
        ..SessionArgs::default()
    };
    open(&args).await.expect("the router listens")
}

/// Asks `robot` for all pairs, and says who answered each of them.
async fn refine(
    robot: &str,
    endpoint: &str,
    deadline: &str,
    folder: &Path,
) -> (Output, Vec<Option<String>>) {
    let json: PathBuf = folder.join(format!("{robot}.json"));
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    program.args(["refine", "--fleet", FLEET, "--robot", robot]);
    program.args(["--mode", "fast", "--deadline", deadline]);
    program.args(["--connect", endpoint]);
    program.arg("--pairs").arg(folder.join("pairs.h5"));
    program.arg("--json").arg(&json);
    let asked = tokio::task::spawn_blocking(move || program.output());
    let output = asked.await.expect("it does not panic");
    let output = output.expect("the program runs");
    let text = std::fs::read(json).expect("written");
    let document: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
    let pairs = document["pairs"].as_array().expect("a list");
    let robots = pairs
        .iter()
        .map(|pair| pair["robot"].as_str().map(str::to_owned));
    (output, robots.collect())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_dies_does_not_end_a_batch() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    write_pairs(&folder.path().join("pairs.h5"), 3);
    let (router, endpoint) = network().await;

    // No other robot is asked. The pair that was answered counts, and each other pair is reported.
    let dying = short_lived(&endpoint).await;
    let (output, robots) = refine("a", &endpoint, "3", folder.path()).await;
    dying.await.expect("it dies in peace");
    let [said, error] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert_eq!(robots, [Some("a".to_owned()), None, None]);
    for pair in [
        "pair 1: no robot answered at ",
        "pair 2: no robot answered at ",
    ] {
        let lines = said.lines().filter(|line| line.starts_with(pair));
        assert_eq!(lines.count(), 1, "{said}");
    }
    assert!(said.contains("\nrefined "), "{said}");
    let summary = "error: 2 of 3 pairs without a pose, the first: pair 1: ";
    assert!(error.starts_with(summary), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");

    // Any robot may answer, so another one takes its place.
    let publisher = Publisher::new(router, FLEET, SigningKey::from_bytes(&[1; 32]));
    let mut publisher = publisher.expect("a good name");
    let _node = robot("b", &endpoint, &mut publisher, 1).await;
    let dying = short_lived(&endpoint).await;
    let (output, robots) = refine("any", &endpoint, "60", folder.path()).await;
    dying.await.expect("it dies in peace");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    assert_eq!(robots, ["a", "b", "b"].map(|robot| Some(robot.to_owned())));
}

#[tokio::test(flavor = "multi_thread")]
async fn pairs_do_not_wait_for_a_robot_that_has_been_away_for_the_deadline() {
    const PAIRS: usize = 400;
    let folder = tempfile::tempdir().expect("a temporary directory");
    write_pairs(&folder.path().join("pairs.h5"), PAIRS);
    let (_router, endpoint) = network().await;
    let key = SigningKey::from_bytes(&[1; 32]);
    let mut publisher = Publisher::new(join(&endpoint).await, FLEET, key).expect("a good name");
    let node = robot("b", &endpoint, &mut publisher, 1).await;
    let begun = Instant::now();
    let dies = async move {
        until(&node, |view| view.served > 20).await;
        node.stop().await;
    };
    let ((output, robots), ()) = tokio::join!(refine("b", &endpoint, "2", folder.path()), dies);
    let answered = robots.iter().flatten().count();
    assert!((20..PAIRS).contains(&answered), "{answered} answered");
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(said.matches("robot b has been away").count(), 1, "{said}");
    let unanswered = said.matches(": no robot answered at ").count();
    assert_eq!(unanswered, PAIRS - answered, "{said}");

    // One that was never there.
    let (output, robots) = refine("c", &endpoint, "1", folder.path()).await;
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(robots.iter().flatten().count(), 0);
    let passed = begun.elapsed();
    assert!(passed < Duration::from_secs(60), "{passed:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_router_that_restarts_loses_no_pair() {
    const PAIRS: usize = 400;
    let folder = tempfile::tempdir().expect("a temporary directory");
    write_pairs(&folder.path().join("pairs.h5"), PAIRS);
    let (router, endpoint) = network().await;
    let mut router = Some(router);
    let key = SigningKey::from_bytes(&[1; 32]);
    let mut publisher = Publisher::new(join(&endpoint).await, FLEET, key).expect("a good name");
    let node = robot("b", &endpoint, &mut publisher, 1).await;
    for (asked, before) in [("any", 0), ("b", PAIRS)] {
        let batch = refine(asked, &endpoint, "60", folder.path());
        let restart = async {
            until(&node, |view| view.served > before as u64 + 20).await;
            let served = node.watch().borrow().served as usize - before;
            assert!(served < PAIRS, "the batch is over");
            let (old, endpoint) = (router.take().expect("it runs"), endpoint.clone());
            // On another thread: a session that ends waits by itself, and would swallow this thread's wake-ups.
            let restarted = tokio::spawn(async move {
                old.close().await.expect("an open session");
                drop(old);
                reagent_tests::network::router(&endpoint).await
            });
            router = Some(restarted.await.expect("the port is free"));
        };
        let ((output, robots), ()) = tokio::join!(batch, restart);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{error}");
        assert_eq!(robots, vec![Some("b".to_owned()); PAIRS]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn where_no_robot_comes_the_deadline_ends_a_request() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    write_pairs(&folder.path().join("pairs.h5"), 1);
    let (_router, endpoint) = network().await;
    for robot in ["any", "a"] {
        let begun = Instant::now();
        let (output, _) = refine(robot, &endpoint, "0.5", folder.path()).await;
        assert!(begun.elapsed() >= Duration::from_millis(500));
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains("no robot answered at "), "{error}");
        assert!(error.contains(" within 50"), "{error}");
    }
}
