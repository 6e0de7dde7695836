//! `host-train track`: views of a part that moves in front of a camera, goes away and comes back.

mod support;

use glam::{Affine3A, Vec2, Vec3};
use host_train::dataset::Point;
use host_train::dataset::cloud_file::{CloudFile, write_cloud};
use host_train::dataset::mesh::Mesh;
use host_train::dataset::procedural;
use host_train::dataset::raster::Pinhole;
use reagent_core::Pose;
use reagent_core::pose::rotation_from_euler;
use serde_json::Value;
use std::path::Path;
use support::{fail, folder, run, succeed};

const CAMERA: Pinhole = Pinhole {
    size: [96, 96],
    focal: Vec2::splat(250.0),
    centre: Vec2::splat(47.5),
};

/// A figure; the other thing is a house.
const PART: u64 = 7;
const OTHER: u64 = 11;

/// The part's pose: from each view to the next it turns by 3 degrees and moves by 3 mm.
fn camera_from_part(view: usize) -> Pose {
    let t = view as f32;
    Pose {
        rotation: rotation_from_euler(Vec3::new(2.0 + 0.04 * t, 0.4, -0.7 - 0.03 * t)),
        translation: Vec3::new(2.0 * t - 20.0, 10.0 - t, 500.0 + 2.0 * t),
    }
}

/// A built-in shape, 160 mm wide.
fn shape(index: u64) -> Mesh {
    let mut mesh = procedural::shape(1, index).mesh;
    mesh.vertices.iter_mut().for_each(|v| *v *= 80.0);
    mesh
}

/// The camera's view of a mesh, millimetres.
fn seen(mesh: &Mesh, at: &Pose) -> Vec<Point> {
    let place = Affine3A::from_mat3_translation(at.rotation, at.translation);
    let image = CAMERA.inverse_depths(mesh, &place);
    let inverses = image.iter().enumerate().filter(|(_, i)| **i > 0.0);
    let point = |(pixel, inverse): (usize, &f32)| {
        (CAMERA.ray(pixel % CAMERA.size[0], pixel / CAMERA.size[0]) / *inverse).to_array()
    };
    inverses.map(point).collect()
}

fn write_part(path: &Path) {
    let mesh = shape(PART);
    let vertices = mesh.vertices.iter();
    let file = CloudFile {
        points: vertices.map(|v| v.to_array().map(f64::from)).collect(),
        faces: Some(mesh.faces),
        ..CloudFile::default()
    };
    write_cloud(path, &file).expect("written");
}

fn write_view(path: &Path, mesh: &Mesh, view: usize) {
    let points = seen(mesh, &camera_from_part(view));
    assert!(points.len() > 300, "{} points", points.len());
    write_cloud(path, &CloudFile::of(&points)).expect("written");
}

fn lines(text: &str) -> Vec<Value> {
    let line = |line: &str| serde_json::from_str(line).expect("JSON");
    text.lines().map(line).collect()
}

/// Error of a line's pose in a view: angle in degrees, and distance of the part's centre in millimetres.
fn errors(line: &Value, view: usize) -> (f32, f32) {
    let rows = serde_json::from_value(line["target_from_source"].clone()).expect("a pose");
    let truth = camera_from_part(view);
    let [x, y, z] = Pose::from_rows(rows)
        .rotation
        .mul_mat3(&truth.rotation)
        .to_cols_array_2d();
    let cosine = (x[0] + y[1] + z[2] - 1.0) / 2.0;
    let centre = Pose::from_rows(rows).apply(truth.translation);
    (cosine.min(1.0).acos().to_degrees(), centre.length())
}

#[test]
fn a_part_is_tracked_said_to_be_lost_and_found_again() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    write_part(&at("part.ply"));
    std::fs::create_dir(at("views")).expect("created");
    let (part, other) = (shape(PART), shape(OTHER));
    // Another object takes its place in views 20 to 25, and view 26 shows nothing.
    for view in 0..40 {
        let path = at(&format!("views/{view:02}.ply"));
        match view {
            20..26 => write_view(&path, &other, view),
            26 => std::fs::write(path, "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n").expect("written"),
            _ => write_view(&path, &part, view),
        }
    }
    let output = run(
        folder.path(),
        "track part.ply views --view origin --init none",
    );
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let lines = lines(&String::from_utf8_lossy(&output.stdout));
    assert_eq!(lines.len(), 40);
    for (view, line) in lines.iter().enumerate() {
        assert!(line["ms"].as_f64().is_some_and(|ms| ms > 0.0), "{line}");
        let (state, mode) = match view {
            0 | 27 => ("found", "verify"),
            20..27 => ("lost", "verify"),
            _ => ("tracked", "refine"),
        };
        assert_eq!(line["state"], state, "{line}");
        if view == 26 {
            let reason = line["error"].as_str().unwrap_or_default();
            assert!(
                reason.contains("no points") && line.get("mode").is_none(),
                "{line}"
            );
            continue;
        }
        assert_eq!(line["mode"], mode, "{line}");
        assert_eq!(
            line["probability"].as_f64().is_some_and(|p| p >= 0.5),
            state != "lost",
            "{line}"
        );
        // What is undetermined is only found where poses are compared.
        let is_compared = mode == "verify" && state != "lost";
        assert_eq!(line.get("undetermined").is_some(), is_compared, "{line}");
        if state == "lost" {
            assert!(line.get("target_from_source").is_none(), "{line}");
        } else {
            let (angle, distance) = errors(line, view);
            assert!(angle < 1.0 && distance < 1.0, "{view}: {angle} {distance}");
        }
    }
    let summary = said.lines().last().unwrap_or_default();
    assert!(
        summary.starts_with("40 clouds: 31 tracked, 2 found, 7 lost; "),
        "{summary}"
    );
    assert!(
        summary.contains("median") && summary.ends_with("p99"),
        "{summary}"
    );
}

#[test]
fn files_units_and_starts_are_those_of_register() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    write_part(&at("part.ply"));
    for view in 0..3 {
        write_view(&at(&format!("{view}.npy")), &shape(PART), view);
    }
    std::fs::write(at("bad.npy"), "nothing").expect("written");
    let start = camera_from_part(0).inverse().to_rows();
    let start = start
        .iter()
        .flatten()
        .map(f32::to_string)
        .collect::<Vec<_>>();
    let init = format!("--init {} --view origin", start.join(","));
    // Files are taken in their order; the pose is that of the scaled cloud.
    for (unit, factor) in [("--scale 1", 1.0), ("--unit mm:mm", 1.0)] {
        let said = succeed(
            folder.path(),
            &format!("track part.ply 0.npy 1.npy 2.npy {unit} {init}"),
        );
        for (view, line) in lines(&said).iter().enumerate() {
            assert_eq!(line["source"], format!("{view}.npy"));
            let (angle, distance) = errors(line, view);
            assert!(angle < 1.0 && distance < 1.0 * factor, "{line}");
        }
    }
    // A file that cannot be read gets a line of its own, and the others go on.
    let output = run(
        folder.path(),
        &format!("track part.ply 0.npy bad.npy 1.npy {init} --json lines.jsonl"),
    );
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        said.contains("error: 1 of 3 clouds could not be read"),
        "{said}"
    );
    assert!(output.stdout.is_empty());
    let written = lines(&std::fs::read_to_string(at("lines.jsonl")).expect("written"));
    let states: Vec<_> = written.iter().map(|line| line["state"].clone()).collect();
    assert_eq!(states, ["found", "lost", "found"]);
    assert!(
        written[1]["error"]
            .as_str()
            .is_some_and(|reason| reason.contains("bad.npy"))
    );
    std::fs::create_dir(at("empty")).expect("created");
    fail(
        folder.path(),
        "track part.ply empty",
        &["empty: no clouds", "ply"],
    );
    fail(folder.path(), "track none.ply 0.npy", &["none.ply"]);
    assert_eq!(run(folder.path(), "track part.ply").status.code(), Some(2));
}
