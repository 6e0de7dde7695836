//! Remarks of `host-train register` on a pose.

mod support;

use glam::Vec3;
use host_train::dataset::Point;
use host_train::dataset::cloud_file::{CloudFile, read_file, write_cloud};
use host_train::dataset::depth::image::read_depth;
use host_train::dataset::procedural;
use host_train::random::{Purpose, stream};
use reagent_core::pose::rotation_from_euler;
use reagent_tests::depth::{CAMERA, write_view};
use std::path::Path;
use support::{fail, folder, read_json, run, succeed};

/// Writes a part, `part.ply`, and returns points of its surface, turned.
fn scan(at: &Path) -> Vec<Point> {
    let mesh = procedural::shape(1, 1).mesh;
    let part = CloudFile {
        faces: Some(mesh.faces.clone()),
        ..CloudFile::of(&mesh.vertices.iter().map(Vec3::to_array).collect::<Vec<_>>())
    };
    write_cloud(&at.join("part.ply"), &part).expect("written");
    let turn = rotation_from_euler(Vec3::new(0.2, -0.15, 0.1));
    let points = mesh.sample(1500, &mut stream(5, Purpose::Surface, 0));
    let turned = |&point: &Point| (turn * Vec3::from(point)).to_array();
    points.iter().map(turned).collect()
}

#[test]
fn much_that_lies_off_the_target_is_pointed_out() {
    let folder = folder();
    let at = folder.path();
    let scan = scan(at);
    // A table below the part, with a quarter as many points.
    let low = scan.iter().map(|p| p[2]).fold(f32::MAX, f32::min);
    let table = (0..375).map(|i| {
        [
            0.1 * (i % 25) as f32 - 1.2,
            0.1 * (i / 25) as f32,
            low - 0.3,
        ]
    });
    let crowded: Vec<Point> = scan.iter().copied().chain(table).collect();
    for (source, share) in [(&scan, 0.0), (&crowded, 20.0)] {
        write_cloud(&at.join("s.ply"), &CloudFile::of(source)).expect("written");
        let said = succeed(at, "register s.ply part.ply --json p.json");
        assert!(said.contains("\nconverged, "), "{said}");
        let notes = &read_json(&at.join("p.json"))["notes"];
        if share == 0.0 {
            assert!(!said.contains("lies off"), "{said}");
            assert_eq!(*notes, serde_json::json!([]));
            continue;
        }
        assert!(
            said.contains(" % of the source lies off the target: "),
            "{said}"
        );
        assert!(
            said.contains("Crop it, give a depth image's --mask, or"),
            "{said}"
        );
        assert_eq!(
            (&notes[0]["of"], &notes[0]["kind"]),
            (&"source".into(), &"off_target".into())
        );
        let found = 100.0 * notes[0]["share"].as_f64().expect("a share");
        assert!((found - share).abs() < 8.0, "{found}");
    }
}

/// Writes an image of 160 x 120 numbers as `numpy.save` does.
fn write_array(path: &Path, numbers: impl Iterator<Item = f32>) {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (120, 160), }\n";
    let length = (header.len() as u16).to_le_bytes();
    let array = [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes()].concat();
    let numbers = numbers.flat_map(f32::to_le_bytes);
    std::fs::write(path, array.into_iter().chain(numbers).collect::<Vec<u8>>()).expect("written");
}

/// The source is the whole scene, or a depth in another unit.
#[test]
fn where_sizes_differ_the_options_of_the_source_at_hand_are_named() {
    let folder = folder();
    let at = folder.path();
    let large: Vec<Point> = scan(at).iter().map(|p| p.map(|x| 25.4 * x)).collect();
    write_cloud(&at.join("s.ply"), &CloudFile::of(&large)).expect("written");
    let said = succeed(at, "register s.ply part.ply");
    let words = "See --unit and --scale, or crop a source that shows more than the target";
    assert!(said.contains(words), "{said}");
    write_view(at, 9000);
    let depth = format!("register --depth depth.png --camera {CAMERA} part.ply");
    for (options, words) in [
        (
            "--depth-scale 0.1",
            "Without --mask the source is the whole scene. See --depth-scale and --unit",
        ),
        (
            "--depth-scale 2 --mask mask.png",
            "See --depth-scale and --unit",
        ),
    ] {
        let said = succeed(at, &format!("{depth} {options}"));
        assert!(
            said.contains("sizes differ: ") && said.contains(words),
            "{said}"
        );
    }
    // Millimetres in float32, as some programs save them, in an array.
    let depths = read_depth(&at.join("depth.png")).expect("read");
    let millimetres = depths.values.iter().map(|&tenths| 0.1 * f32::from(tenths));
    write_array(&at.join("depth.npy"), millimetres);
    let depth = format!("register --depth depth.npy --mask mask.png --camera {CAMERA} part.ply");
    let said = succeed(at, &depth);
    let words = "taken for a metre: if it is a millimetre, give --depth-scale 1\n";
    assert!(
        said.contains("sizes differ: ") && said.contains(words),
        "{said}"
    );
    let said = succeed(at, &format!("{depth} --depth-scale 1"));
    assert!(!said.contains("sizes differ"), "{said}");
    // Taken for a cloud, the file is described as what it may be.
    write_array(
        &at.join("depth.npy"),
        (0..160 * 120).map(|i| (i % 97) as f32),
    );
    let output = run(at, "register depth.npy part.ply");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("the longer axis; a depth image goes with its camera in"),
        "{said}"
    );
}

#[test]
fn a_view_point_that_a_source_names_is_told_with_the_option_that_takes_it() {
    let folder = folder();
    let at = folder.path();
    let rows = scan(at);
    let rows = rows.iter().map(|[x, y, z]| format!("{x} {y} {z}\n"));
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1500\nHEIGHT 1";
    let text = format!(
        "VERSION .7\n{header}\nVIEWPOINT 0.5 -1 8 1 0 0 0\nPOINTS 1500\nDATA ascii\n{}",
        rows.collect::<String>()
    );
    std::fs::write(at.join("s.pcd"), text).expect("written");
    let told = |options: &str| {
        let output = run(at, &format!("register {options}"));
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).expect("text")
    };
    let said = told("s.pcd part.ply");
    let words = "s.pcd: its viewpoint (0.5, -1, 8) is not used";
    let advice = "; if the sensor stood there: --view 0.5,-1,8\n";
    assert!(said.contains(&format!("{words}{advice}")), "{said}");
    // No option is named if it was given, or for the target.
    for options in ["s.pcd part.ply --view 0.5,-1,8", "part.ply s.pcd"] {
        let said = told(options);
        assert!(said.contains(words) && !said.contains("stood"), "{said}");
    }
}

/// A line about one of many pairs is a single pair's document after the names, and starts the next registration.
#[test]
fn lines_of_pairs_are_as_the_document_of_one_pair() {
    let folder = folder();
    let at = folder.path();
    write_cloud(&at.join("s.ply"), &CloudFile::of(&scan(at))).expect("written");
    std::fs::write(at.join("list.txt"), "s.ply part.ply\nnone.ply part.ply\n").expect("written");
    let output = run(at, "register --pairs list.txt --json lines.jsonl");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains("1 of 2 pairs could not be registered"),
        "{said}"
    );
    succeed(at, "register s.ply part.ply --json p.json");
    let text = |name: &str| std::fs::read_to_string(at.join(name)).expect("written");
    let (lines, document) = (text("lines.jsonl"), text("p.json"));
    let (line, failed) = lines.split_once('\n').expect("two lines");
    assert!(
        failed.starts_with(r#"{"source":"none.ply","target":"part.ply","error":"none.ply: "#),
        "{failed}"
    );
    let names = document
        .lines()
        .filter_map(|line| line.strip_prefix("  \""));
    let names = names.filter_map(|rest| rest.split_once("\": "));
    let names: Vec<&str> = ["source", "target"]
        .into_iter()
        .chain(names.map(|(name, _)| name))
        .collect();
    let places: Vec<_> = names
        .iter()
        .map(|name| line.find(&format!("\"{name}\":")))
        .collect();
    assert!(
        names.len() > 12 && places.iter().all(Option::is_some),
        "{names:?}"
    );
    assert!(places.is_sorted(), "{names:?}: {line}");
    let numbers = |text: &str| serde_json::from_str::<serde_json::Value>(text).expect("JSON");
    assert_eq!(
        numbers(line)["target_from_source"],
        numbers(&document)["target_from_source"]
    );
    std::fs::write(at.join("line.json"), line).expect("written");
    succeed(at, "register s.ply part.ply --init line.json");
    fail(
        at,
        "register s.ply part.ply --init lines.jsonl",
        &["lines.jsonl: it holds 2 registrations"],
    );
}

/// The source has no partner where it starts.
#[test]
fn a_last_refinement_that_is_dropped_is_told() {
    let folder = folder();
    let at = folder.path();
    let away: Vec<Point> = scan(at).iter().map(|&[x, y, z]| [x + 9.0, y, z]).collect();
    write_cloud(&at.join("s.ply"), &CloudFile::of(&away)).expect("written");
    for (dense, is_told) in [("always", true), ("never", false)] {
        let register =
            format!("register s.ply part.ply --mode refine --dense {dense} --json p.json");
        let said = succeed(at, &register);
        let words = "\ndense: no better pose on many points, dropped\n";
        assert_eq!(said.contains(words), is_told, "{said}");
        let document = read_json(&at.join("p.json"));
        assert!(document.get("dense").is_none());
        let notes = document["notes"].as_array().expect("a list");
        let is_noted = notes.iter().any(|note| note["kind"] == "not_finer");
        assert_eq!(is_noted, is_told, "{notes:?}");
    }
}

#[test]
fn a_mesh_is_not_written_of_a_cloud_and_that_is_said_before_any_work() {
    let folder = folder();
    let at = folder.path();
    write_cloud(&at.join("s.ply"), &CloudFile::of(&scan(at))).expect("written");
    for name in ["a.stl", "a.obj", "a.off"] {
        let register = format!("register s.ply part.ply --out {name}");
        fail(at, &register, &[name, "a cloud without faces is no mesh"]);
        assert!(run(at, &register).stdout.is_empty());
    }
    // The target may be a cloud, since it is not written.
    succeed(at, "register part.ply s.ply --out a.stl");
    // Nor does the format have digits for a place that far away.
    let part = read_file(&at.join("part.ply")).expect("read");
    let far = CloudFile {
        points: part
            .points
            .iter()
            .map(|&[x, y, z]| [x, y + 5e6, z])
            .collect(),
        ..part
    };
    write_cloud(&at.join("far.ply"), &far).expect("written");
    let register = "register part.ply far.ply --init 1,0,0,0,0,1,0,5e6,0,0,1,0 --out b.stl";
    fail(at, register, &["b.stl: .stl has no digits"]);
    assert!(run(at, register).stdout.is_empty());
}
