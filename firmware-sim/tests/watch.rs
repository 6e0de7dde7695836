//! `fleet watch` in a pipe.
#![cfg(feature = "demo")]

use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use reagent_tests::network::network;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;
use tokio::sync::oneshot;

#[tokio::test(flavor = "multi_thread")]
async fn it_ends_when_nobody_reads_any_more() {
    let (router, endpoint) = network().await;
    let mut watch = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    watch.args([
        "fleet",
        "watch",
        "--fleet",
        "f",
        "--json",
        "--connect",
        &endpoint,
    ]);
    let mut watch = watch.stdout(Stdio::piped()).spawn().expect("it runs");
    let mut output = BufReader::new(watch.stdout.take().expect("piped"));
    let mut line = String::new();
    tokio::task::block_in_place(|| output.read_line(&mut line)).expect("text");
    assert!(line.contains("\"robots\""), "{line}");
    drop(output);
    // The next line is of this robot.
    let config = NodeConfig {
        fleet: "f".into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let node = Node::start(router, config).await;
    let _node = node.expect("good names");
    let (ended, end) = oneshot::channel();
    std::thread::spawn(move || ended.send(watch.wait()));
    let end = tokio::time::timeout(Duration::from_secs(60), end).await;
    let status = end
        .expect("it ends")
        .expect("it is waited for")
        .expect("a child");
    assert!(status.success(), "{status}");
}
