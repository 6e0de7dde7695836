//! `host-train register` on files as users have them: every format, unit and size, and typical mistakes.

mod support;

use glam::{Mat3, Vec3};
use host_train::dataset::Point;
use host_train::dataset::cloud_file::{CloudFile, read_cloud, write_cloud};
use host_train::dataset::procedural::{self, Shape};
use host_train::pose64::Pose64;
use reagent_core::Pose;
use reagent_core::pose::rotation_from_euler;
use std::path::Path;
use support::{fail, folder, read_json, run, succeed};

/// The true pose, in normalised units of length.
fn truth() -> Pose {
    Pose {
        rotation: rotation_from_euler(Vec3::new(0.2, -0.25, 0.3)),
        translation: Vec3::new(0.1, -0.2, 0.15),
    }
}

fn scaled(pose: Pose, unit: f32) -> Pose {
    Pose {
        translation: pose.translation * unit,
        ..pose
    }
}

fn shape() -> Shape {
    procedural::shape(1, 1)
}

/// Points drawn evenly from the surface, in a frame of their own.
fn scan(count: usize, unit: f32) -> CloudFile {
    let rng = &mut host_train::random::stream(5, host_train::random::Purpose::Shape, 0);
    let (points, normals): (Vec<Point>, Vec<Point>) = shape()
        .mesh
        .sample_with_normals(count, rng)
        .into_iter()
        .unzip();
    let points: Vec<Point> = points.into_iter().map(|p| p.map(|x| x * unit)).collect();
    let inverse = scaled(truth(), unit).inverse();
    CloudFile {
        normals: Some(normals),
        ..CloudFile::of(&points)
    }
    .moved(&Pose64::of(inverse, [0.0; 3], [0.0; 3]))
}

/// Writes the shape's mesh in the format of the extension.
fn write_mesh(path: &Path, unit: f32) {
    let mesh = shape().mesh;
    let vertices: Vec<Vec3> = mesh.vertices.iter().map(|&v| v * unit).collect();
    let rows = |prefix: &str| -> String {
        vertices
            .iter()
            .map(|v| format!("{prefix}{} {} {}\n", v.x, v.y, v.z))
            .collect()
    };
    let faces = |prefix: &str, first: u32| -> String {
        mesh.faces
            .iter()
            .map(|f| {
                format!(
                    "{prefix}{} {} {}\n",
                    f[0] + first,
                    f[1] + first,
                    f[2] + first
                )
            })
            .collect()
    };
    let (v, f) = (vertices.len(), mesh.faces.len());
    let text = match path.extension().and_then(|e| e.to_str()) {
        Some("off") => format!("OFF\n{v} {f} 0\n{}{}", rows(""), faces("3 ", 0)),
        Some("obj") => format!("{}{}", rows("v "), faces("f ", 1)),
        Some("ply") => format!(
            "ply\nformat ascii 1.0\nelement vertex {v}\nproperty float x\nproperty float y\nproperty float z\nelement face {f}\nproperty list uchar int vertex_indices\nend_header\n{}{}",
            rows(""),
            faces("3 ", 0)
        ),
        _ => {
            let facet = |face: &[u32; 3]| {
                let corners = face
                    .map(|i| vertices[i as usize])
                    .map(|v| format!("vertex {} {} {}\n", v.x, v.y, v.z));
                format!(
                    "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
                    corners.concat()
                )
            };
            format!(
                "solid shape\n{}endsolid shape\n",
                mesh.faces.iter().map(facet).collect::<String>()
            )
        }
    };
    std::fs::write(path, text).expect("written");
}

/// The pose that `register --json p.json` found.
fn found(at: &Path) -> Pose {
    let document = read_json(&at.join("p.json"));
    let number = |r: usize, c: usize| {
        document["target_from_source"][r][c]
            .as_f64()
            .expect("a number") as f32
    };
    Pose::from_rows(std::array::from_fn(|r| {
        std::array::from_fn(|c| number(r, c))
    }))
}

/// Rotation angle in degrees and translation in normalised units between a pose and the true one.
fn errors(pose: Pose, unit: f32) -> (f32, f32) {
    let between: Mat3 = pose.rotation * truth().rotation.transpose();
    let trace = between.x_axis.x + between.y_axis.y + between.z_axis.z;
    let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees();
    (
        angle,
        (pose.translation / unit - truth().translation).length(),
    )
}

#[test]
fn every_format_of_cloud_to_every_format_of_mesh_in_metres_and_millimetres() {
    let folder = folder();
    let at = folder.path();
    for unit in [1.0, 1000.0] {
        let meshes = ["m.off", "m.obj", "m.stl", "m.ply"];
        for (source, target) in ["s.ply", "s.pcd", "s.xyz", "s.npy"].into_iter().zip(meshes) {
            let cloud = scan(2000, unit);
            write_cloud(&at.join(source), &cloud).expect("written");
            write_mesh(&at.join(target), unit);
            let aligned = source.replace('s', "aligned");
            let text = succeed(
                at,
                &format!("register {source} {target} --json p.json --out {aligned}"),
            );
            assert!(
                ["ms", "steps", "polish: ", "verify: ", "right within"]
                    .iter()
                    .all(|word| text.contains(word)),
                "{text}"
            );
            let (angle, shift) = errors(found(at), unit);
            assert!(
                angle < 2.0 && shift < 0.02,
                "{source} to {target}, unit {unit}: {angle} deg, {shift}"
            );

            let written = read_cloud(&at.join(&aligned), 0).expect("readable");
            let expected = cloud.moved(&Pose64::of(found(at), [0.0; 3], [0.0; 3]));
            for (a, b) in written.points.iter().zip(&expected.points) {
                let near = (0..3).all(|axis| (a[axis] - b[axis]).abs() < 1e-5 * f64::from(unit));
                assert!(near, "{aligned}");
            }
            assert!(written.normals.is_some(), "{aligned}");
        }
    }
}

#[test]
fn large_repeated_and_flat_clouds_are_registered() {
    let folder = folder();
    let at = folder.path();
    write_mesh(&at.join("m.stl"), 1.0);
    write_cloud(&at.join("large.pcd"), &scan(100_000, 1.0)).expect("written");
    let mut repeated = scan(700, 1.0);
    repeated.points = repeated.points.iter().flat_map(|&p| [p; 3]).collect();
    repeated.normals = None;
    write_cloud(&at.join("repeated.ply"), &repeated).expect("written");
    for source in ["large.pcd", "repeated.ply"] {
        let output = run(
            at,
            &format!("register {source} m.stl --json p.json --out moved.ply"),
        );
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{stderr}");
        assert_eq!(
            stderr.contains("100000 points are thinned to 2048"),
            source == "large.pcd",
            "{stderr}"
        );
        let (angle, shift) = errors(found(at), 1.0);
        assert!(
            angle < 10.0 && shift < 0.1,
            "{source}: {angle} deg, {shift}"
        );
        let points = read_cloud(&at.join("moved.ply"), 0)
            .expect("readable")
            .points
            .len();
        assert_eq!(
            points,
            if source == "large.pcd" { 100_000 } else { 2100 },
            "every point is moved"
        );
    }
    let flat: Vec<Point> = (0..900)
        .map(|i| [(i % 30) as f32, (i / 30) as f32, 2.0])
        .collect();
    write_cloud(&at.join("flat.npy"), &CloudFile::of(&flat)).expect("written");
    succeed(at, "register flat.npy flat.npy --json p.json");
    assert!(found(at).translation.is_finite());
}

#[test]
fn pixels_without_depth_are_left_out_and_counted() {
    let folder = folder();
    let at = folder.path();
    write_mesh(&at.join("m.off"), 1.0);
    let seen = scan(1500, 1.0).relative_to([0.0; 3]);
    let header = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 50\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3000\nDATA binary\n";
    let pixels = (0..3000).flat_map(|i| {
        if i % 2 == 0 {
            seen[i / 2]
        } else {
            [f32::NAN; 3]
        }
    });
    let bytes = [
        header.as_bytes(),
        &pixels.flat_map(f32::to_le_bytes).collect::<Vec<u8>>(),
    ]
    .concat();
    std::fs::write(at.join("organised.pcd"), bytes).expect("written");
    let output = run(at, "register organised.pcd m.off --json p.json");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && stderr.contains("left out 1500 invalid points"),
        "{stderr}"
    );
    assert_eq!(read_json(&at.join("p.json"))["source_points"], 1500);
    assert!(errors(found(at), 1.0).0 < 10.0);
}

#[test]
fn what_cannot_be_registered_is_refused_in_one_line() {
    let folder = folder();
    let at = folder.path();
    write_mesh(&at.join("m.off"), 1.0);
    let write = |name: &str, text: &str| std::fs::write(at.join(name), text).expect("written");
    let ply = |n: usize, rows: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\nend_header\n{rows}"
        )
    };
    write("empty.ply", &ply(0, ""));
    write("one.ply", &ply(1, "1 2 3\n"));
    write("nan.ply", &ply(2, "nan 2 3\n1 inf 3\n"));
    write("short.ply", &ply(9, "1 2 3\n"));
    write(
        "none.pcd",
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\nnan nan nan\n",
    );
    write("same.xyz", &"1 1 1\n".repeat(50));
    let row = |i: u32| format!("{} {} {}\n", i % 7, i % 11, i % 5);
    write("cut.xyz", &(1..99).map(row).collect::<String>());
    write("noarea.off", "OFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n");
    for (arguments, words) in [
        ("empty.ply m.off", &["empty.ply", "no points"][..]),
        ("one.ply m.off", &["one.ply", "1 point"]),
        ("nan.ply m.off", &["nan.ply", "2 invalid"]),
        ("short.ply m.off", &["short.ply", "end of file"]),
        ("none.pcd m.off", &["none.pcd", "1 invalid"]),
        ("m.off same.xyz", &["same.xyz", "coincide"]),
        ("noarea.off m.off", &["noarea.off", "none with an area"]),
        (
            "m.off m.off --out moved.doc",
            &["moved.doc", ".ply .pcd .xyz or .npy"],
        ),
        (
            "m.off m.off --out no/such/folder.ply",
            &["no/such/folder.ply"],
        ),
        ("m.off m.off --init abc", &["\"abc\": give none, identity"]),
        ("cut.xyz m.off --scale 1e12", &["cut.xyz", "beyond 1e12"]),
    ] {
        fail(at, &format!("register {arguments}"), words);
    }
    // If the output cannot be written, nothing is done.
    let output = run(at, "register m.off m.off --json no/such/folder.json");
    assert!(output.stdout.is_empty() && output.status.code() == Some(1));
    let output = run(at, "register m.off m.off --fail-below 1");
    let said = String::from_utf8_lossy(&output.stderr);
    let words = "error: 1 pose with a probability below the 1 of --fail-below; the lowest is 0.";
    let (_, lowest) = said.split_once(words).unwrap_or_else(|| panic!("{said}"));
    assert!(lowest.trim().parse::<u64>().is_ok(), "{said}");
    assert_eq!(output.status.code(), Some(3));
}

#[test]
fn clouds_in_different_units_are_pointed_out() {
    let folder = folder();
    let at = folder.path();
    write_mesh(&at.join("m.off"), 1.0);
    write_cloud(&at.join("mm.ply"), &scan(500, 1000.0)).expect("written");
    let output = run(at, "register mm.ply m.off");
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(
        stdout.contains("sizes differ: the source is about"),
        "{stdout}"
    );
    assert!(stdout.contains("times as large"), "{stdout}");
    write_cloud(&at.join("m.ply"), &scan(500, 1.0)).expect("written");
    let output = run(at, "register m.ply m.off");
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    // With the unit stated, the sizes agree.
    let stated = run(at, "register mm.ply m.off --unit mm --json p.json");
    let stdout = String::from_utf8_lossy(&stated.stdout);
    assert!(!stdout.contains("sizes differ"), "{stdout}");
    assert_eq!(read_json(&at.join("p.json"))["source_scale"], 1e-3);
    let (angle, shift) = errors(found(at), 1.0);
    assert!(angle < 2.0 && shift < 0.02, "{angle} deg, {shift}");
}

/// The true pose after a turn about x, as `--init` takes it.
fn turned(angle: f32) -> String {
    let turn = Pose {
        rotation: Mat3::from_rotation_x(angle),
        translation: Vec3::ZERO,
    };
    let rows = truth().after(turn).to_rows();
    let numbers: Vec<String> = rows.iter().flatten().map(f32::to_string).collect();
    numbers.join(",")
}

#[test]
fn the_best_of_several_starts_is_given_out_and_the_next_best_are_listed() {
    let folder = folder();
    let at = folder.path();
    write_cloud(&at.join("s.ply"), &scan(1000, 1.0)).expect("written");
    write_mesh(&at.join("m.ply"), 1.0);
    let list: Vec<String> = [3.0, 1.5, 0.1]
        .map(|angle| format!("[{}]", turned(angle)))
        .into();
    std::fs::write(at.join("starts.json"), format!("[{}]", list.join(","))).expect("written");
    let [far, near] = [3.0, 0.1].map(turned);
    for (starts, best) in [
        (format!("--init {far} --init {near}"), 1),
        ("--init starts.json".to_owned(), 2),
        (format!("--init {far} --init starts.json"), 3),
    ] {
        let said = succeed(
            at,
            &format!("register s.ply m.ply {starts} --mode refine --best 3 --json p.json"),
        );
        let (angle, shift) = errors(found(at), 1.0);
        assert!(
            angle < 2.0 && shift < 0.02,
            "{starts}: {angle} deg, {shift}"
        );
        let document = read_json(&at.join("p.json"));
        assert_eq!(document["start"], best, "{starts}");
        assert!(
            said.contains(&format!("from start number {}\n", best + 1)),
            "{said}"
        );
        let (_, listed) = said.split_once("\nnext best poses").expect("a heading");
        assert!(listed.contains("they need not add up to 100 %:\n  residual"));
        let others = document["others"].as_array().expect("a list");
        assert!(
            (1..=2).contains(&others.len()),
            "{starts}: {}",
            others.len()
        );
        for other in others {
            assert_eq!(
                other["target_from_source"].as_array().map(Vec::len),
                Some(3)
            );
            // It fits far worse than the result.
            assert!(other["probability"].as_f64() < Some(0.05), "{other}");
            assert!(other["residual"][0].as_f64() > document["polish"]["residual"][0].as_f64());
        }
    }
    let alone = format!("register s.ply m.ply --init {near} --json p.json");
    succeed(at, &alone);
    let document = read_json(&at.join("p.json"));
    assert!(document.get("start").is_none() && document.get("others").is_none());
    // The list is there if it was asked for, even if it is empty.
    succeed(at, &format!("{alone} --best 1"));
    assert_eq!(
        read_json(&at.join("p.json"))["others"],
        serde_json::json!([])
    );
    for options in ["--best 2".to_owned(), format!("--init {far} --init {near}")] {
        let output = run(at, &format!("register s.ply m.ply --mode fast {options}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("mode fast does not compare poses"), "{said}");
    }
    fail(
        at,
        "register s.ply m.ply --init nowhere.json",
        &["nowhere.json"],
    );
}
