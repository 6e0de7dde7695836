//! A depth image in a request: a robot gives the same answer as the workstation.

mod support;

use clap::Parser;
use firmware_sim::refine::RefineArgs;
use host_train::cli::{Cli, status};
use host_train::policy::{VIEWS, WeightFile};
use reagent_core::wire::{
    Cloud, Message, Mode, Reason, RefineReply, Refusal, SMALL_FRAME_BYTES, decode, encode, keys,
};
use reagent_core::{Pose, Verdict};
use reagent_tests::depth::{CAMERA, start, write_view};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use support::{FLEET, Network, publisher, until};
use tempfile::TempDir;
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

/// Depth of the wall, tenths of a millimetre: near enough to matter.
const WALL: u16 = 5600;

/// The command line of a client.
#[derive(Parser)]
struct Refine {
    #[command(flatten)]
    args: RefineArgs,
}

/// A depth image, its mask and the part that it shows, in a folder.
struct Scene(TempDir);

impl Scene {
    const FILES: [&str; 3] = ["depth.png", "mask.png", "part.ply"];

    fn new() -> Scene {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write_view(folder.path(), WALL);
        Scene(folder)
    }

    fn at(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }
}

/// The words that name the image as a source.
fn source<'a>(depth: &'a str, mask: &'a str) -> [&'a str; 8] {
    [
        "--depth",
        depth,
        "--camera",
        CAMERA,
        "--mask",
        mask,
        "--depth-scale",
        "0.1",
    ]
}

/// The document that a command wrote.
fn document(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).expect("written");
    serde_json::from_str(&text).expect("JSON")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_answers_what_the_workstation_does() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let policy = WeightFile::load(Path::new(VIEWS)).expect("it is bundled");
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "views", policy).await;
    published.expect("a policy");
    until(&node, |view| view.policy.is_some()).await;

    let scene = Scene::new();
    let at = |name: &str| scene.at(name);
    let [depth, mask, part] = Scene::FILES.map(at);
    let start = start();
    // From an estimate, from anywhere, and in another unit, in which nothing fits.
    for (init, scale) in [(start.as_str(), "1"), ("none", "1"), ("none", "0.5")] {
        let common = [
            &source(&depth, &mask)[..],
            &["--scale", scale, "--init", init, &part],
        ]
        .concat();
        let here = at("here.json");
        let words = [
            "host-train",
            "register",
            "--dense",
            "never",
            "--json",
            &here,
        ];
        let register = Cli::try_parse_from([&words[..], &common].concat()).expect("good usage");
        tokio::task::block_in_place(|| register.run()).expect("a pose");
        let (there, trace) = (at("there.json"), at("run.trace"));
        let words = [
            "refine",
            "--fleet",
            FLEET,
            "--robot",
            "r1",
            "--deadline",
            "60",
        ];
        let written = [
            "--connect",
            &network.endpoint,
            "--json",
            &there,
            "--trace",
            &trace,
        ];
        let sure = ["--fail-below", "0.5"];
        let refine = [&words[..], &written, &sure, &common].concat();
        let refine = Refine::try_parse_from(refine).expect("good usage");
        let ended = refine.args.run().await;
        assert_eq!(
            ended.as_ref().map_err(status),
            if scale == "1" { Ok(&()) } else { Err(3) }
        );
        let [here, there] = [here, there].map(|path| document(Path::new(&path)));
        for what in ["target_from_source", "verdict"] {
            assert_eq!(here[what], there[what], "{what}");
        }
        let probability = |of: &Value| of["probability"].as_f64().map(|p| p as f32);
        assert_eq!(probability(&here), probability(&there));
        assert_eq!(here["verdict"] == "converged", scale == "1", "{here}");
        // Its trace is replayed bit for bit.
        let replay = Cli::try_parse_from(["host-train", "replay", &trace]);
        let replay = replay.expect("good usage");
        tokio::task::block_in_place(|| replay.run()).expect("the same");
    }
    let short = [
        "refine", "--fleet", FLEET, "--robot", "r1", "--depth", &depth,
    ];
    assert!(Refine::try_parse_from(short).is_err(), "no camera");
}

/// A robot without memory for more than two clouds, as a board is. Counts its refusals.
async fn small_robot(session: &Session, robot: &str) -> (Queryable<()>, Arc<AtomicU32>) {
    let key = keys::refine(FLEET, robot).expect("good names");
    let refused = Arc::new(AtomicU32::new(0));
    let (count, here) = (refused.clone(), key.clone());
    let serving = session.declare_queryable(key.as_str());
    let serving = serving.callback(move |query| {
        let payload = query.payload().expect("a request").to_bytes();
        let Ok(Message::RefineRequest(request)) = decode(&payload) else {
            panic!("it is a request");
        };
        let mut buffer = [0; SMALL_FRAME_BYTES];
        let mut frame = |message| encode(&message, &mut buffer).expect("it fits").to_vec();
        let besides = request.background.len() + request.outward.len();
        let sent = if besides > 0 {
            assert!(
                request.outward.len() == request.target.len() && !request.background.is_empty()
            );
            count.fetch_add(1, Ordering::Relaxed);
            let reason = Reason::TooManyPoints(Cloud::Background, besides as u32);
            let id = request.id;
            query
                .reply_err(frame(Message::Refusal(Refusal { id, reason })))
                .wait()
        } else {
            let reply = RefineReply {
                id: request.id,
                target_from_source: Pose::IDENTITY.to_rows(),
                steps: 0,
                mode: Mode::Fast,
                verdict: Verdict::StepLimit,
                probability: None,
                fit: None,
                waited_micros: 0,
                micros: 0,
                policy_version: 1,
            };
            query
                .reply(here.as_str(), frame(Message::RefineReply(reply)))
                .wait()
        };
        sent.expect("an open session");
    });
    (serving.await.expect("an open session"), refused)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_without_memory_for_what_was_seen_besides_is_asked_without_it() {
    let network = Network::start().await;
    let (_robot, refused) = small_robot(&network.router, "r2").await;
    let scene = Scene::new();
    let [depth, mask, part] = Scene::FILES.map(|name| scene.at(name));
    let json = scene.at("r2.json");
    let words = [
        "refine",
        "--fleet",
        FLEET,
        "--robot",
        "r2",
        "--connect",
        &network.endpoint,
    ];
    let words = [
        &words[..],
        &source(&depth, &mask),
        &["--json", &json, &part],
    ]
    .concat();
    let refine = Refine::try_parse_from(words).expect("good usage");
    refine.args.run().await.expect("a pose");
    assert_eq!(refused.load(Ordering::Relaxed), 1);
    assert_eq!(document(Path::new(&json))["robot"], "r2");
}
