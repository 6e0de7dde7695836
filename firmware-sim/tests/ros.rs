//! `firmware-sim ros` on a network, with messages written here byte by byte. `tests/ros2.py` uses messages that other libraries
//! write.
#![cfg(all(feature = "demo", unix))]

#[path = "ros/parameters.rs"]
mod parameters;
#[path = "ros/views.rs"]
mod views;

use host_train::dataset::ros::cdr::{from_cdr, to_cdr};
use reagent_tests::network::network;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tokio::time::timeout;
use zenoh::Session;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::query::ReplyKeyExpr;
use zenoh::sample::Sample;

const PATIENCE: Duration = Duration::from_secs(60);
const CLOUD: &str = "0/points/sensor_msgs::msg::dds_::PointCloud2_/\
    RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5";
const MODEL: &str = "0/reagent/model/sensor_msgs::msg::dds_::PointCloud2_/\
    RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5";
const POSE: &str = "0/reagent/pose/geometry_msgs::msg::dds_::PoseStamped_/*";
const DIAGNOSTICS: &str = "0/diagnostics/diagnostic_msgs::msg::dds_::DiagnosticArray_/*";

const REGISTER: &str = "0/reagent/register/std_srvs::srv::dds_::Trigger_/\
    RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f";

/// A child process that does not outlive the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// Little-endian CDR, aligned after its header of four bytes.
struct Cdr(Vec<u8>);

impl Cdr {
    fn numbers(&mut self, numbers: &[u32]) {
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        self.0
            .extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    }

    fn text(&mut self, text: &str) {
        self.numbers(&[text.len() as u32 + 1]);
        self.0.extend(text.bytes());
        self.0.push(0);
    }

    fn cloud(points: &[[f32; 3]]) -> Vec<u8> {
        let mut cdr = Cdr(vec![0, 1, 0, 0]);
        cdr.numbers(&[7, 8]);
        cdr.text("camera");
        cdr.numbers(&[1, points.len() as u32, 3]);
        for (name, offset) in [("x", 0), ("y", 4), ("z", 8)] {
            cdr.text(name);
            cdr.numbers(&[offset]);
            cdr.0.push(7);
            cdr.numbers(&[1]);
        }
        cdr.0.push(0);
        let length = 12 * points.len() as u32;
        cdr.numbers(&[12, length, length]);
        cdr.0
            .extend(points.iter().flatten().flat_map(|x| x.to_le_bytes()));
        cdr.0.push(1);
        cdr.0
    }
}

type Heard = Subscriber<FifoChannelHandler<Sample>>;

async fn next(heard: &Subscriber<FifoChannelHandler<Sample>>) -> Vec<u8> {
    let sample = timeout(PATIENCE, heard.recv_async())
        .await
        .expect("it comes");
    let sample = sample.expect("an open session");
    assert_eq!(sample.attachment().expect("there is one").len(), 33);
    sample.payload().to_bytes().into_owned()
}

/// A node that hears clouds.
fn node(endpoint: &str, model: &Path, options: &[&str]) -> Running {
    node_of_domain("", endpoint, model, options)
}

/// The same, where the environment names a domain.
fn node_of_domain(domain: &str, endpoint: &str, model: &Path, options: &[&str]) -> Running {
    let mut node = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    node.args(["ros", "--connect", endpoint, "--model"])
        .arg(model)
        .env("ROS_DOMAIN_ID", domain)
        .args(options)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut node = Running(node.spawn().expect("the program runs"));
    let lines = BufReader::new(node.0.stdout.take().expect("piped")).lines();
    let up = lines
        .map_while(Result::ok)
        .any(|line| line.contains(&format!("hears /points (connect {endpoint})")));
    assert!(up, "it ended");
    node
}

/// Ends a node and returns what it wrote to standard error.
fn complaints(mut node: Running) -> String {
    node.0.kill().expect("it runs");
    let mut said = String::new();
    let errors = node.0.stderr.as_mut().expect("piped");
    errors.read_to_string(&mut said).expect("text");
    said
}

/// Three faces of a box that is twice as long as wide.
fn part() -> Vec<[f32; 3]> {
    let point = |i: usize| {
        let [u, v] = [(i / 3 % 17) as f32 / 17.0, (i / 51) as f32 / 18.0];
        [[0.0, u, v], [2.0 * u, 0.0, v], [2.0 * u, v, 0.0]][i % 3]
    };
    (0..900).map(point).collect()
}

/// A network with a node that knows the part, and subscriptions to its poses and diagnostics.
async fn looking_for_a_part(folder: &Path, options: &[&str]) -> (Session, Running, [Heard; 2]) {
    let lines = part().into_iter();
    let lines = lines.map(|[x, y, z]| format!("{x} {y} {z}\n"));
    std::fs::write(folder.join("part.xyz"), lines.collect::<String>()).expect("writable");
    looking_for("part.xyz", folder, options).await
}

/// The same with a model of the folder.
async fn looking_for(
    model: &str,
    folder: &Path,
    options: &[&str],
) -> (Session, Running, [Heard; 2]) {
    let model = folder.join(model);
    let (session, endpoint) = network().await;
    let hear = async |key| {
        let heard = session.declare_subscriber(key).await;
        heard.expect("an open session")
    };
    let heard = [hear(POSE).await, hear(DIAGNOSTICS).await];

    let node = node(&endpoint, &model, options);
    let tokens = session.liveliness();
    let tokens = tokens.declare_subscriber("@ros2_lv/0/*/0/*/*/%/%/reagent/**");
    let tokens = tokens.history(true).await.expect("an open session");
    let mut kinds = Vec::new();
    let publishers = if options.contains(&"--tf") { 6 } else { 5 };
    while kinds.len() < publishers + 9 {
        let token = timeout(PATIENCE, tokens.recv_async()).await;
        let token = token.expect("it comes").expect("an open session");
        kinds.extend(token.key_expr().split('/').nth(5).map(str::to_owned));
    }
    kinds.sort();
    let expected = format!("{}MS NN SS SS SS SS SS SS SS", "MP ".repeat(publishers));
    assert_eq!(kinds.join(" "), expected);
    (session, node, heard)
}

#[tokio::test(flavor = "multi_thread")]
async fn an_object_is_followed() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let (session, _node, [_, diagnostics]) = looking_for_a_part(folder.path(), &["--track"]).await;
    let moved = |by: f32| part().into_iter().map(move |[x, y, z]| [x + by, y, z]);
    let on_ball = |[x, y, z]: [f32; 3]| {
        let [x, y, z] = [x - 0.9, y - 0.4, z - 0.4];
        let distance = (x * x + y * y + z * z).sqrt();
        [x, y, z].map(|along| 0.8 * along / distance)
    };
    for (cloud, state) in [
        (moved(0.0).collect::<Vec<_>>(), "found"),
        (moved(0.05).collect(), "tracked"),
        (moved(0.0).map(on_ball).collect(), "lost"),
        (moved(0.1).collect(), "found"),
    ] {
        let cloud = Cdr::cloud(&cloud);
        session.put(CLOUD, cloud).await.expect("an open session");
        let said = next(&diagnostics).await;
        let said = String::from_utf8_lossy(&said);
        assert!(said.contains(state), "{state}: {said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn clouds_come_in_and_poses_and_reasons_go_out() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let (session, _node, [poses, diagnostics]) = looking_for_a_part(folder.path(), &[]).await;
    let points = part();
    // Late subscribers get the model, by the query that `zenoh-ext` sends.
    let asked = session.get(format!("{MODEL}/@adv/**"));
    let asked = asked.accept_replies(ReplyKeyExpr::Any).await;
    let kept = asked.expect("an open session").recv_async().await;
    let kept = kept.expect("the model").into_result().expect("the model");
    assert_eq!(kept.key_expr().as_str(), MODEL);
    assert_eq!(kept.source_info().map(|info| info.source_sn()), Some(0));
    let bytes = kept.payload().to_bytes();
    assert_eq!(bytes[12..24], *b"\x05\0\0\0part\0\0\0\0");
    let last: Vec<u8> = points[899].iter().flat_map(|x| x.to_le_bytes()).collect();
    assert!(
        bytes.ends_with(&[&last[..], &[1]].concat()),
        "the last point, and that all are finite"
    );

    session
        .put(CLOUD, Cdr::cloud(&points))
        .await
        .expect("an open session");
    let said = next(&diagnostics).await;
    assert!(
        String::from_utf8_lossy(&said).contains("converged"),
        "{said:?}"
    );
    let pose = next(&poses).await;
    // The header and seven numbers. The last one, w, says that there is no turn.
    assert_eq!(
        pose[..24],
        *b"\0\x01\0\0\x07\0\0\0\x08\0\0\0\x07\0\0\0camera\0\0"
    );
    let w = pose.last_chunk().map(|bytes| f64::from_le_bytes(*bytes));
    assert!(w.is_some_and(|w| w.abs() > 0.999), "{w:?}");

    for (bytes, reason) in [
        (b"nothing".to_vec(), "plain CDR"),
        (Cdr::cloud(&points[..1]), "point"),
        (Cdr::cloud(&[[f32::NAN; 3]; 9]), "point"),
    ] {
        session.put(CLOUD, bytes).await.expect("an open session");
        let said = next(&diagnostics).await;
        let said = String::from_utf8_lossy(&said);
        assert!(said.contains(reason), "{said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_model_in_another_unit_than_its_clouds_is_found() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let options = ["--unit", "mm"];
    let (session, _node, [_, diagnostics]) = looking_for_a_part(folder.path(), &options).await;
    let metres = part().into_iter().map(|point| point.map(|x| 1e-3 * x));
    let cloud = Cdr::cloud(&metres.collect::<Vec<_>>());
    session.put(CLOUD, cloud).await.expect("an open session");
    let said = next(&diagnostics).await;
    let said = String::from_utf8_lossy(&said);
    assert!(said.contains("converged"), "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_model_in_the_frame_of_its_clouds_has_no_transform() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let options = ["--tf", "camera"];
    let (session, node, [poses, diagnostics]) = looking_for_a_part(folder.path(), &options).await;
    let transforms = session.declare_subscriber("0/tf/**").await;
    let transforms = transforms.expect("an open session");
    let reason = "the frame of the clouds is \"camera\", as that of --tf, which is the model's";
    for _ in 0..2 {
        let cloud = Cdr::cloud(&part());
        session.put(CLOUD, cloud).await.expect("an open session");
        let said = next(&diagnostics).await;
        assert!(String::from_utf8_lossy(&said).contains(reason), "{said:?}");
        // A transform would come before the pose.
        next(&poses).await;
    }
    assert!(transforms.try_recv().expect("an open session").is_none());
    let said = complaints(node);
    assert_eq!(said.matches(reason).count(), 1, "{said}");
}

/// The answer of a service to a client's request number 9.
async fn called<Q: Serialize, A: DeserializeOwned>(session: &Session, key: &str, request: &Q) -> A {
    let identity = [7; 16];
    let number = [9, 0, 0, 0, 0, 0, 0, 0];
    let attachment = [&number[..], &[0; 8], &[16], &identity].concat();
    let asked = session.get(key).payload(to_cdr(request));
    let asked = asked.attachment(attachment).await.expect("an open session");
    let reply = timeout(PATIENCE, asked.recv_async()).await;
    let reply = reply.expect("it comes").expect("an answer");
    let reply = reply.into_result().expect("no refusal");
    let attached = reply.attachment().expect("there is one").to_bytes();
    assert_eq!(
        (&attached[..8], &attached[17..]),
        (&number[..], &identity[..])
    );
    let answer = from_cdr::<Answer<A>>(&reply.payload().to_bytes());
    answer.expect("what the service answers").0
}

/// An answer that owns what was read.
#[derive(Deserialize)]
#[serde(bound = "A: DeserializeOwned")]
struct Answer<A>(A);

/// Whether a cloud was registered, and the message about it. An empty request has one byte.
async fn triggered(session: &Session) -> (bool, String) {
    called(session, REGISTER, &0u8).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_registers_the_newest_cloud() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let (session, _node, [poses, diagnostics]) =
        looking_for_a_part(folder.path(), &["--on-request"]).await;
    let said = triggered(&session).await;
    assert_eq!(said, (false, "no cloud has come on /points so far".into()));
    let put = async |cloud: Vec<u8>| session.put(CLOUD, cloud).await.expect("an open session");
    put(b"nothing".to_vec()).await;
    put(Cdr::cloud(&part())).await;
    for _ in 0..2 {
        let (success, said) = triggered(&session).await;
        assert!(success, "{said}");
        let said: serde_json::Value = serde_json::from_str(&said).expect("JSON");
        let header = r#"{"frame_id":"camera","stamp":{"nanosec":8,"sec":7}}"#;
        assert_eq!(said["header"].to_string(), header);
        assert!(
            said["probability"].as_f64().is_some_and(|p| p > 0.9),
            "{said}"
        );
        let turn = said["pose"]["orientation"][3].as_f64();
        assert!(turn.is_some_and(|w| w.abs() > 0.999), "{said}");
        // The pose is published, too. Nothing is published for the cloud before it.
        next(&poses).await;
        let told = next(&diagnostics).await;
        assert!(String::from_utf8_lossy(&told).contains("converged"));
    }
    put(Cdr::cloud(&part()[..1])).await;
    let (success, said) = triggered(&session).await;
    assert!(!success && said.contains("point"), "{said}");
    // A query that is no ROS request is refused.
    let asked = session.get(REGISTER).await.expect("an open session");
    let reply = asked.recv_async().await.expect("an answer");
    let refused = reply.into_result().expect_err("refused");
    let refused = refused.payload().to_bytes();
    assert!(String::from_utf8_lossy(&refused).contains("attachment of 33 bytes"));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_domain_is_that_of_the_environment_unless_one_is_named() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let model = folder.path().join("part.xyz");
    std::fs::write(&model, "0 0 0\n1 0 0\n0 1 0\n0 0 1\n").expect("writable");
    for (options, domain) in [(&[][..], "7"), (&["--domain", "9"], "9")] {
        let (session, endpoint) = network().await;
        let _node = node_of_domain("7", &endpoint, &model, options);
        let tokens = session.liveliness().get("@ros2_lv/*/*/0/0/NN/**");
        let token = tokens.await.expect("an open session").recv_async().await;
        let token = token.expect("a node").into_result().expect("a token");
        let found = token.key_expr().split('/').nth(1);
        assert_eq!(found, Some(domain));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn two_nodes_of_one_name_are_told() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let model = folder.path().join("part.xyz");
    std::fs::write(&model, "0 0 0\n1 0 0\n0 1 0\n0 0 1\n").expect("writable");
    let (_session, endpoint) = network().await;
    let nodes = [(); 2].map(|()| node(&endpoint, &model, &[]));
    let said = nodes.map(complaints);
    assert_eq!(said[0], "");
    assert!(
        said[1].starts_with("another node is called /reagent: "),
        "{said:?}"
    );
}
