//! A depth image in a request: a robot gives the same answer as the workstation.

mod support;

use clap::Parser;
use firmware_sim::refine::RefineArgs;
use host_train::cli::Cli;
use host_train::dataset::cloud_file::{CloudFile, read_cloud, write_cloud};
use host_train::policy::{VIEWS, WeightFile};
use reagent_tests::depth::{CAMERA, start, write_view};
use serde_json::Value;
use std::path::Path;
use support::{FLEET, Network, publisher, until};

/// Depth of the wall, tenths of a millimetre: near enough to matter.
const WALL: u16 = 5600;

/// The command line of a client.
#[derive(Parser)]
struct Refine {
    #[command(flatten)]
    args: RefineArgs,
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

    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| {
        folder
            .path()
            .join(name)
            .to_str()
            .expect("a path")
            .to_owned()
    };
    write_view(folder.path(), WALL);
    // Frames do not say which way a target faces, so the workstation does not learn it either.
    let surface = read_cloud(Path::new(&at("part.ply")), 1).expect("a mesh");
    let points = CloudFile {
        points: surface.points,
        ..CloudFile::default()
    };
    write_cloud(Path::new(&at("part.xyz")), &points).expect("written");
    let (depth, mask, part) = (at("depth.png"), at("mask.png"), at("part.xyz"));
    let start = start();
    // From an estimate, from anywhere, and in another unit, in which nothing fits.
    for (init, scale) in [(start.as_str(), "1"), ("none", "1"), ("none", "0.5")] {
        let source = [
            "--depth",
            &depth,
            "--camera",
            CAMERA,
            "--mask",
            &mask,
            "--depth-scale",
            "0.1",
            "--scale",
            scale,
        ];
        let common = [&source[..], &["--init", init, &part]].concat();
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
        let refine = [&words[..], &written, &common].concat();
        let refine = Refine::try_parse_from(refine).expect("good usage");
        refine.args.run().await.expect("a pose");
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
