//! The program's exit status and its one line of error.
#![cfg(feature = "demo")]

use firmware_sim::session::{SessionArgs, open};
use host_train::dataset::pairs::PairSet;
use host_train::export::WeightFile;
use host_train::nn::{Parameters, Shape};
use reagent_core::Pose;
use reagent_core::wire::keys;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Output};

fn firmware_sim(arguments: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    program.args(arguments).output().expect("the program runs")
}

/// Runs the program and takes the one line that it must have failed with.
fn failure(arguments: &[&str]) -> String {
    let output = firmware_sim(arguments);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(error.starts_with("error: "), "{error}");
    error
}

fn unused_endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    format!("tcp/{}", listener.local_addr().expect("it is bound"))
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

fn write_pairs(path: &Path) {
    let cloud = vec![[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.5; 3]];
    let pairs = PairSet {
        source: vec![cloud.clone(); 3],
        target: vec![cloud.clone(); 3],
        target_from_source: vec![Pose::IDENTITY; 3],
        raw: Some(vec![cloud; 3]),
        label: vec![0; 3],
    };
    pairs.save(path).expect("a writable directory");
}

fn write_policy(path: &Path) {
    let parameters = Parameters::random(Shape::PAPER, 1);
    let policy = WeightFile::from_parameters(&parameters).expect("deployable");
    policy.save(path).expect("a writable directory");
}

#[test]
fn bad_usage_is_status_2() {
    for arguments in [
        &[][..],
        &["node", "--fleet", "f"],
        &["node", "--fleet", "f", "--robot", "r", "--trust", "abc"],
        &["refine", "--fleet", "f", "--robot", "r"],
        &["refine", "--fleet", "f", "--robot", "r", "only-one.ply"],
        &["demo", "--pairs", "a.h5", "--data", "b"],
        &["demo", "--per-robot", "0"],
    ] {
        let output = firmware_sim(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn no_router_is_an_error_that_names_the_endpoint() {
    let endpoint = unused_endpoint();
    let error = failure(&[
        "node",
        "--fleet",
        "f",
        "--robot",
        "r",
        "--connect",
        &endpoint,
    ]);
    assert!(error.contains(&endpoint), "{error}");
}

#[test]
fn a_bad_configuration_file_is_named() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let config = directory.path().join("zenoh.json5");
    let node = [
        "node",
        "--fleet",
        "f",
        "--robot",
        "r",
        "--zenoh",
        text(&config),
    ];
    assert!(failure(&node).contains("zenoh.json5"));
    std::fs::write(&config, "{ mode: \"nonsense\" }").expect("a writable directory");
    assert!(failure(&node).contains("zenoh.json5"));
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
    let endpoint = unused_endpoint();
    let args = SessionArgs {
        listen: vec![endpoint.clone()],
        ..SessionArgs::default()
    };
    let router = open(&args).await.expect("the port is free");
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
            for policy in ["initial", "version 1", "version 2"] {
                let error = &table[robot][policy]["r_iso_deg"];
                assert!(error.is_number(), "{robot} {policy}: {error}");
            }
        }
        std::fs::remove_file(&json).expect("it was written");
    }
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
    assert_eq!(numbers["robots"], 3);
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
