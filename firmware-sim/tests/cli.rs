//! The program as a user runs it.
#![cfg(feature = "demo")]

use ed25519_dalek::SigningKey;
use firmware_sim::client::Client;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::session::unused_endpoint;
use host_train::dataset::pairs::PairSet;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::publish::Publisher;
use reagent_core::Pose;
use reagent_core::wire::{CloudView, RefineRequest, keys};
use reagent_tests::network::{self, network};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

fn firmware_sim(arguments: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    program.args(arguments).output().expect("the program runs")
}

/// Runs the program, which must fail with one line, and returns that line.
fn failure(arguments: &[&str]) -> String {
    let output = firmware_sim(arguments);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(error.starts_with("error: "), "{error}");
    error
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

/// The configuration of robot r1 of fleet f.
fn config(state: Option<&Path>) -> NodeConfig {
    NodeConfig {
        fleet: "f".into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
        state: state.map(Path::to_owned),
    }
}

fn write_pairs(path: &Path) {
    let cloud = vec![[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-0.5; 3]];
    let pairs = PairSet {
        source: vec![cloud.clone(); 3],
        target: vec![cloud.clone(); 3],
        target_from_source: vec![Pose::IDENTITY; 3],
        raw: Some(vec![cloud; 3]),
        label: vec![0; 3],
        symmetries: None,
        seen: vec![None; 3],
    };
    pairs.save(path).expect("a writable directory");
}

fn write_policy(path: &Path) {
    let parameters = Parameters::random(Shape::PAPER, 1);
    let policy = WeightFile::from_parameters(&parameters).expect("deployable");
    policy.save(path).expect("a writable directory");
}

#[test]
fn a_board_without_its_simulator_says_how_to_get_it() {
    let output = Command::new(env!("CARGO_BIN_EXE_firmware-sim"))
        .args([
            "node",
            "--fleet",
            "f",
            "--robot",
            "r",
            "--trust-any",
            "--board",
            "cortex-m7",
        ])
        .env("PATH", "")
        .output()
        .expect("the program runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("apt-get install qemu-system-arm"), "{error}");
}

/// A child process that does not outlive the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_process_refuses_until_it_has_a_policy() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let pairs = directory.path().join("pairs.h5");
    write_pairs(&pairs);
    let (router, endpoint) = network().await;
    let refine = |robot: &'static str| {
        let (endpoint, pairs) = (endpoint.clone(), pairs.clone());
        let asking = tokio::task::spawn_blocking(move || {
            failure(&[
                "refine",
                "--fleet",
                "f",
                "--robot",
                robot,
                "--pairs",
                text(&pairs),
                "--connect",
                &endpoint,
            ])
        });
        async { asking.await.expect("the assertions hold") }
    };
    let error = refine("r1").await;
    assert!(
        error.contains("no robot answered at reagent/v1/f/robot/r1/refine"),
        "{error}"
    );
    let error = refine("any").await;
    assert!(
        error.contains("no robot answered at reagent/v1/f/robot/*/status"),
        "{error}"
    );

    let alive = keys::alive("f", "r1").expect("good names");
    let tokens = router
        .liveliness()
        .declare_subscriber(alive.as_str())
        .history(true);
    let tokens = tokens.await.expect("an open session");
    let node = Command::new(env!("CARGO_BIN_EXE_firmware-sim"))
        .args([
            "node",
            "--fleet",
            "f",
            "--robot",
            "r1",
            "--trust-any",
            "--connect",
            &endpoint,
        ])
        .env("RUST_LOG", "off")
        .spawn();
    let _node = Running(node.expect("the program runs"));
    tokens.recv_async().await.expect("the node comes up");
    for robot in ["r1", "any"] {
        let error = refine(robot).await;
        assert!(
            error.contains("robot r1 refused request 1: it has no policy"),
            "{error}"
        );
    }
}

#[test]
fn the_demo_runs_on_its_own_shapes_and_on_pairs() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let path = |name: &str| directory.path().join(name);
    let (policy, pairs, json) = (path("policy.rgw"), path("pairs.h5"), path("table.json"));
    let short = [
        "demo",
        "--seconds",
        "1",
        "--per-robot",
        "1",
        "--json",
        text(&json),
    ];
    let missing = failure(&[&short[..], &["--weights", text(&policy)]].concat());
    assert!(missing.contains("policy.rgw"), "{missing}");

    write_policy(&policy);
    write_pairs(&pairs);
    for scene in [&[][..], &["--pairs", text(&pairs)]] {
        let output = firmware_sim(&[&short[..], &["--weights", text(&policy)], scene].concat());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{error}");
        let table = std::fs::read(&json).expect("it was written");
        let table: serde_json::Value = serde_json::from_slice(&table).expect("it is JSON");
        for robot in ["r1", "r2", "r3", "all"] {
            for policy in [
                "initial",
                "version 1",
                "version 1, verified",
                "version 2",
                "version 2, verified",
            ] {
                let error = &table[robot][policy]["r_iso_deg"];
                assert!(error.is_number(), "{robot} {policy}: {error}");
            }
        }
        std::fs::remove_file(&json).expect("it was written");
    }
}

#[test]
fn more_robots_than_a_router_takes_are_an_error_that_says_how_many_routers_they_need() {
    let error = failure(&["fleet", "--robots", "2000", "--routers", "2"]);
    assert!(error.contains("2000 robots need 3 --routers"), "{error}");
}

#[test]
fn a_small_fleet_is_updated_and_asked_whether_or_not_anybody_reads() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let (policy, json) = (folder.path().join("p.rgw"), folder.path().join("f.json"));
    write_policy(&policy);
    let arguments = [
        "fleet",
        "--robots",
        "3",
        "--routers",
        "2",
        "--requests",
        "4",
        "--in-flight",
        "2",
    ];
    let files = ["--weights", text(&policy), "--json", text(&json)];
    let output = firmware_sim(&[&arguments[..], &files].concat());
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{output:?}");
    assert!(said.contains("policies in use: version 1: 3"), "{said}");
    let written = std::fs::read_to_string(&json).expect("it was written");
    let numbers: serde_json::Value = serde_json::from_str(&written).expect("JSON");
    assert_eq!(
        (&numbers["robots"], &numbers["routers"]),
        (&3.into(), &2.into())
    );
    for load in ["alone", "loaded"] {
        assert_eq!(numbers[load]["poses"], 4, "{numbers}");
        assert!(numbers[load]["compute"]["p50"].as_f64() > Some(0.0));
    }
    assert!(numbers["update"]["max"].as_f64() > Some(0.0), "{numbers}");

    std::fs::remove_file(&json).expect("it was written");
    let mut unread = Command::new(env!("CARGO_BIN_EXE_firmware-sim"))
        .args(arguments)
        .args(files)
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("the program runs");
    drop(unread.stdout.take());
    assert!(unread.wait().expect("it ends").success());
    assert!(json.exists(), "it went on to write its numbers");
}

/// A node in a process of its own, and the lines that it logs.
fn logging_node(
    endpoint: &str,
) -> (
    Running,
    std::io::Lines<BufReader<std::process::ChildStderr>>,
) {
    let names = ["node", "--fleet", "f", "--robot", "r1", "--trust-any"];
    let mut node = Command::new(env!("CARGO_BIN_EXE_firmware-sim"))
        .args(names)
        .args(["--connect", endpoint])
        .env_remove("RUST_LOG")
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let log = BufReader::new(node.stderr.take().expect("piped")).lines();
    (Running(node), log)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_logs_its_router_going_and_coming_and_every_request() {
    let endpoint = unused_endpoint().expect("a free port");
    let router = network::router(&endpoint).await;
    let (node, mut log) = logging_node(&endpoint);
    let mut until = move |text: &str| {
        let line = log.find(|line| line.as_ref().is_ok_and(|line| line.contains(text)));
        assert!(line.is_some(), "{text}");
    };
    tokio::task::block_in_place(|| until("connected to router"));
    router.close().await.expect("it was open");
    tokio::task::block_in_place(|| until("lost router"));
    let router = network::router(&endpoint).await;
    tokio::task::block_in_place(|| until("connected to router"));

    let cloud = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.5; 3]];
    let cloud = CloudView::of(&cloud);
    let key = keys::refine("f", "r1").expect("good names");
    let querier = router.declare_querier(key.as_str()).await;
    let querier = querier.expect("an open session");
    let changes = querier.matching_listener().await.expect("an open session");
    while !querier
        .matching_status()
        .await
        .expect("an open session")
        .matching()
    {
        changes.recv_async().await.expect("an open session");
    }
    let client = Client::new(router.clone(), "f").await;
    let client = client.expect("a good name");
    let asked = client
        .refine("r1", &RefineRequest::new(44, cloud, cloud))
        .await;
    assert!(asked.is_err(), "{asked:?}");
    tokio::task::block_in_place(|| until("request 44 refused: it has no policy"));
    drop(node);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_script_learns_that_no_robot_is_there() {
    let (router, endpoint) = network().await;
    let watch = async |more: &'static [&'static str]| {
        let endpoint = endpoint.clone();
        let watch = move || {
            let once = ["fleet", "watch", "--fleet", "f", "--once", "--connect"];
            firmware_sim(&[&once, &[endpoint.as_str()][..], more].concat())
        };
        let output = tokio::task::spawn_blocking(watch).await;
        output.expect("it does not panic")
    };
    for more in [&[][..], &["--json"], &["--check"]] {
        let output = watch(more).await;
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said, "error: no robot is there\n");
        assert!(!output.stdout.is_empty());
    }
    let node = Node::start(router, config(None)).await;
    let node = node.expect("good names");
    assert!(watch(&[]).await.status.success());
    node.stop().await;
}

#[cfg(unix)]
#[tokio::test(flavor = "multi_thread")]
async fn a_state_directory_that_may_only_be_read_starts_on_the_policy_in_it() {
    use firmware_sim::flash::FILE;
    use std::fs::{Permissions, set_permissions};
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    use std::os::unix::process::CommandExt;

    let (router, endpoint) = network().await;
    let folder = tempfile::tempdir().expect("a temporary directory");
    let node = Node::start(router.clone(), config(Some(folder.path()))).await;
    let node = node.expect("good names");
    let mut publisher = Publisher::new(router.clone(), "f", SigningKey::from_bytes(&[1; 32]));
    let publisher = publisher.as_mut().expect("a good name");
    let policy = WeightFile::from_parameters(&Parameters::random(Shape::COMPACT, 1));
    let shipped = publisher
        .publish(7, "kept", policy.expect("deployable"))
        .await;
    let shipped = shipped.expect("a good policy");
    let mut view = node.watch();
    let taken = view.wait_for(|view| view.policy.as_ref() == Some(&shipped));
    taken.await.expect("the node runs");
    node.stop().await;

    let modes = [
        (folder.path().join(FILE), 0o444),
        (folder.path().into(), 0o555),
    ];
    for (path, mode) in modes {
        set_permissions(path, Permissions::from_mode(mode)).expect("its owner");
    }
    let mut node = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    node.args(["node", "--fleet", "f", "--robot", "r2", "--trust-any"])
        .args(["--connect", &endpoint, "--state", text(folder.path())])
        .env("RUST_LOG", "off");
    // root may write everything.
    if folder.path().metadata().expect("it is there").uid() == 0 {
        node.uid(65534);
    }
    let client = Client::new(router, "f").await.expect("a good name");
    client.follow_robots().await.expect("an open session");
    let mut changes = client.changes();
    let mut node = match node.spawn() {
        Ok(node) => Running(node),
        Err(error) => return eprintln!("skipped: nobody may run the program: {error}"),
    };
    while !client.heard().iter().any(|heard| heard.robot == "r2") {
        let heard = tokio::time::timeout(Duration::from_secs(60), changes.changed()).await;
        let ended = node.0.try_wait().expect("a child");
        assert!(heard.is_ok() && ended.is_none(), "{ended:?}");
    }
    let heard = client.heard().into_iter().find(|heard| heard.robot == "r2");
    let policy = heard.expect("just heard").status.policy;
    assert_eq!(policy, Some(shipped.id()));
}
