//! A depth image in a request: a robot answers what the workstation does.
#![cfg(feature = "demo")]

use clap::Parser;
use ed25519_dalek::SigningKey;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::refine::RefineArgs;
use firmware_sim::session::{SessionArgs, open};
use glam::{Affine3A, Vec2, Vec3};
use host_train::cli::Cli;
use host_train::dataset::cloud_file::{CloudFile, write_cloud};
use host_train::dataset::depth::image::{Image, write_depth, write_mask};
use host_train::dataset::procedural;
use host_train::dataset::raster::Pinhole;
use host_train::policy::{VIEWS, WeightFile};
use host_train::publish::Publisher;
use reagent_core::Pose;
use reagent_core::pose::rotation_from_euler;
use serde_json::Value;
use std::net::TcpListener;
use std::path::Path;
use std::time::Duration;

const SIZE: [usize; 2] = [160, 120];

/// Half a metre ahead.
fn camera_from_model() -> Pose {
    Pose {
        rotation: rotation_from_euler(Vec3::new(2.0, 0.4, -0.7)),
        translation: Vec3::new(20.0, -10.0, 500.0),
    }
}

/// Some 14 degrees and 12 mm off.
fn start() -> String {
    let off = Pose {
        rotation: rotation_from_euler(Vec3::new(0.15, -0.15, 0.1)),
        translation: Vec3::new(5.0, -5.0, 10.0),
    };
    let rows = off.after(camera_from_model().inverse()).to_rows();
    let numbers: Vec<String> = rows.iter().flatten().map(f32::to_string).collect();
    numbers.join(",")
}

/// The command of a client.
#[derive(Parser)]
struct Refine {
    #[command(flatten)]
    args: RefineArgs,
}

/// A part of 80 mm as a mesh, and what a camera sees of it before a wall, in tenths of a millimetre.
fn write_view(at: &Path) {
    let mut mesh = procedural::shape(1, 1).mesh;
    for vertex in &mut mesh.vertices {
        *vertex *= 80.0;
    }
    let vertices = mesh.vertices.iter();
    let part = CloudFile {
        points: vertices.map(|v| v.to_array().map(f64::from)).collect(),
        faces: Some(mesh.faces.clone()),
        ..CloudFile::default()
    };
    write_cloud(&at.join("part.ply"), &part).expect("written");
    let camera = Pinhole {
        size: SIZE,
        focal: Vec2::splat(200.0),
        centre: Vec2::new(79.5, 59.5),
    };
    let Pose {
        rotation,
        translation,
    } = camera_from_model();
    let place = Affine3A::from_mat3_translation(rotation, translation);
    let seen = camera.inverse_depths(&mesh, &place);
    let tenths = |&inverse: &f32| match inverse > 0.0 {
        true => (10.0 / inverse).round() as u16,
        false => 5600,
    };
    let depths = Image {
        size: SIZE,
        values: seen.iter().map(tenths).collect(),
    };
    write_depth(&at.join("depth.png"), &depths).expect("written");
    let mask: Vec<bool> = seen.iter().map(|&inverse| inverse > 0.0).collect();
    write_mask(&at.join("mask.png"), SIZE, &mask).expect("written");
}

/// What a command wrote.
fn document(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).expect("written");
    serde_json::from_str(&text).expect("JSON")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_answers_what_the_workstation_does() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let endpoint = format!("tcp/{}", listener.local_addr().expect("it is bound"));
    drop(listener);
    let args = SessionArgs {
        listen: vec![endpoint.clone()],
        ..SessionArgs::default()
    };
    let router = open(&args).await.expect("the port is free");
    let config = NodeConfig {
        fleet: "f".into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let node = Node::start(router.clone(), config).await;
    let node = node.expect("good names");
    let mut publisher =
        Publisher::new(router, "f", SigningKey::from_bytes(&[1; 32])).expect("a name");
    let policy = WeightFile::load(Path::new(VIEWS)).expect("it is bundled");
    publisher
        .publish(1, "views", policy)
        .await
        .expect("a policy");
    let mut view = node.watch();
    let taken = view.wait_for(|view| view.policy.is_some());
    let taken = tokio::time::timeout(Duration::from_secs(60), taken).await;
    taken.expect("it takes the policy").expect("it runs");

    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| {
        folder
            .path()
            .join(name)
            .to_str()
            .expect("a path")
            .to_owned()
    };
    write_view(folder.path());
    let (depth, mask, part) = (at("depth.png"), at("mask.png"), at("part.ply"));
    let start = start();
    // From a guess, from nowhere, and in another unit, in which nothing fits.
    for (init, scale) in [(start.as_str(), "1"), ("none", "1"), ("none", "0.5")] {
        let source = [
            "--depth",
            &depth,
            "--camera",
            "200,200,79.5,59.5",
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
            "f",
            "--robot",
            "r1",
            "--deadline",
            "60",
        ];
        let written = ["--connect", &endpoint, "--json", &there, "--trace", &trace];
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
        // A trace of it is done again to the bit.
        let replay = Cli::try_parse_from(["host-train", "replay", &trace]);
        let replay = replay.expect("good usage");
        tokio::task::block_in_place(|| replay.run()).expect("the same");
    }
    let short = ["refine", "--fleet", "f", "--robot", "r1", "--depth", &depth];
    assert!(Refine::try_parse_from(short).is_err(), "no camera");
}
