//! Files as programs and sensors write them, each with its correct result: see `tests/fixtures/cases`.
//!
//! Unless said otherwise a file holds an L-shaped bracket of 100 x 40 x 60, turned by the inverse of [`truth`].

mod support;

use host_train::dataset::cloud_file::{CloudFile, Note, read_file};
use host_train::pose64::Pose64;
use nalgebra::{Rotation3, Unit, Vector3};
use std::path::{Path, PathBuf};
use support::{fail, folder, read_json, run, succeed};

fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/fixtures/cases")
        .join(name)
}

fn read(name: &str) -> CloudFile {
    read_file(&case(name)).unwrap_or_else(|error| panic!("{error}"))
}

/// 25 degrees about (1, 2, 3), then (12, -7, 5).
fn truth() -> Pose64 {
    let axis = Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0));
    Pose64 {
        rotation: Rotation3::from_axis_angle(&axis, 25f64.to_radians()).into_inner(),
        translation: Vector3::new(12.0, -7.0, 5.0),
    }
}

/// The pose in a document that `register --json` wrote.
fn found(path: &Path) -> Pose64 {
    let document = read_json(path);
    let number = |r: usize, c: usize| {
        document["target_from_source"][r][c]
            .as_f64()
            .expect("a number")
    };
    Pose64::from_rows(std::array::from_fn(|r| {
        std::array::from_fn(|c| number(r, c))
    }))
}

/// Rotation angle in degrees between two poses, and how far apart they put a point.
fn errors(pose: &Pose64, truth: &Pose64, at: [f64; 3]) -> (f64, f64) {
    let between = Rotation3::from_matrix_unchecked(pose.rotation * truth.rotation.transpose());
    let apart = Vector3::from(pose.apply(at)) - Vector3::from(truth.apply(at));
    (between.angle().to_degrees(), apart.norm())
}

/// Registers a file of the bracket and checks the pose.
fn registers(source: &Path, arguments: &str) {
    let folder = folder();
    let target = case("npy_3xn/target.ply");
    let (source, target) = (source.display(), target.display());
    succeed(
        folder.path(),
        &format!("register {source} {target} --json p.json {arguments}"),
    );
    let (angle, shift) = errors(
        &found(&folder.path().join("p.json")),
        &truth(),
        [20.0, 20.0, 20.0],
    );
    assert!(angle < 2.0 && shift < 2.0, "{source}: {angle} deg, {shift}");
}

const POINTS: usize = 1500;
/// The first points of the bracket that are valid in every file.
const SECOND: [f64; 3] = [54.271941, 27.228991, 10.347767];

fn is_bracket(name: &str, file: &CloudFile, points: usize) {
    assert_eq!(file.points.len(), points, "{name}");
    let near = |p: &[f64; 3]| (0..3).all(|axis| (p[axis] - SECOND[axis]).abs() < 1e-5);
    assert!(
        file.points[..2].iter().any(near),
        "{name}: {:?}",
        &file.points[..2]
    );
}

#[test]
fn arrays_along_either_axis() {
    for name in ["npy_3xn/npy_3xn.npy", "npy_3xn/npy_3xn_fortran.npy"] {
        let file = read(name);
        is_bracket(name, &file, POINTS);
        let note = Note::LongerAxis {
            rows: 3,
            columns: POINTS,
        };
        assert_eq!(file.notes, [note], "{name}");
        registers(&case(name), "");
    }
    assert_eq!(read("npy_3xn/npy_3x3.npy").points.len(), 3);
}

#[test]
fn fields_of_count_zero() {
    let file = read("pcd_count0/pcd_ouster_count0.pcd");
    is_bracket("pcd", &file, POINTS);
    assert_eq!(file.intensities.map(|all| all.len()), Some(POINTS));
    let said: Vec<String> = file.notes.iter().map(Note::to_string).collect();
    assert_eq!(said, ["not used: t, reflectivity, ring, noise, range"]);
    registers(&case("pcd_count0/pcd_ouster_count0.pcd"), "");
}

#[test]
fn rows_of_nan_are_dropped_and_counted() {
    let mut counts = Vec::new();
    for name in [
        "ply_nan_rows.ply",
        "ply_nan_bin.ply",
        "xyz_nan.xyz",
        "npy_nan.npy",
    ] {
        let path = format!("nan_rows/{name}");
        let file = read(&path);
        let [Note::Dropped { points, faces: 0 }] = file.notes[..] else {
            panic!("{name}: {:?}", file.notes);
        };
        is_bracket(name, &file, POINTS - points);
        counts.push(points);
        registers(&case(&path), "");
    }
    // One row in ten.
    assert_eq!(counts, [150; 4]);
    let at = folder();
    let source = case("nan_rows/xyz_nan.xyz");
    let target = case("npy_3xn/target.ply");
    let output = run(
        at.path(),
        &format!("register {} {}", source.display(), target.display()),
    );
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("left out 150 invalid points"), "{stderr}");
}

#[test]
fn stereolithography_as_programs_write_it() {
    for name in [
        "stl_ascii_nonutf8.stl",
        "stl_ascii_upper.stl",
        "stl_bin_count_wrong.stl",
    ] {
        let path = format!("stl_text/{name}");
        let file = read(&path);
        let faces = file.faces.map(|faces| faces.len());
        assert_eq!(faces, Some(file.points.len() / 3), "{name}");
        assert_eq!(file.points.len(), 3 * 48, "{name}");
        let wrong = Note::Count {
            what: "triangles",
            claimed: 0,
            read: 48,
        };
        assert_eq!(
            file.notes.contains(&wrong),
            name.contains("wrong"),
            "{name}: {:?}",
            file.notes
        );
        registers(&case(&path), "");
    }
}

#[test]
fn text_with_headers() {
    for (name, note) in [
        ("bom", None),
        ("csv_header", None),
        ("decimal_comma", Some(Note::DecimalComma)),
        ("header_count", None),
        ("header_names", None),
        ("header_slashes", None),
        ("lead_index", Some(Note::IndexColumn)),
        ("pts", None),
        ("utf16", Some(Note::Utf16)),
    ] {
        let path = format!("xyz_headers/xyz_{name}.xyz");
        let file = read(&path);
        is_bracket(name, &file, POINTS);
        assert_eq!(file.notes.first(), note.as_ref(), "{name}");
        assert_eq!(file.colours.is_some(), name == "pts");
        registers(&case(&path), "");
    }
}

/// Text under the other extensions that such files have.
#[test]
fn text_under_every_extension() {
    let folder = folder();
    for extension in ["csv", "pts", "asc", "txt", "XYZ"] {
        let path = folder.path().join(format!("cloud.{extension}"));
        std::fs::copy(case("xyz_headers/xyz_csv_header.xyz"), &path).expect("copied");
        is_bracket(extension, &read_file(&path).expect("read"), POINTS);
    }
}

#[test]
fn the_document_of_a_registration_is_a_start() {
    let start = case("init_json/j1.json");
    let source = case("xyz_headers/xyz_bom.xyz");
    registers(&source, &format!("--init {}", start.display()));
    // Without a step the pose is the initial one.
    registers(
        &source,
        &format!("--init {} --mode fast --steps 1", start.display()),
    );
}

/// A 2 m object in UTM coordinates, measured to .1 mm.
#[test]
fn georeferenced_clouds_keep_their_digits() {
    let folder = folder();
    let at = folder.path();
    let text = std::fs::read_to_string(case("utm_precision/true_pose.txt")).expect("read");
    let numbers: Vec<f64> = text
        .split_whitespace()
        .map(|word| word.parse().expect("a number"))
        .collect();
    let truth = Pose64::from_rows(std::array::from_fn(|r| {
        std::array::from_fn(|c| numbers[4 * r + c])
    }));
    let middle = [483_221.0, 5_456_871.0, 310.0];
    let (source, target) = (
        case("utm_precision/source.xyz"),
        case("utm_precision/target.xyz"),
    );
    let register = |arguments: &str| {
        let text = succeed(
            at,
            &format!(
                "register {} {} --json p.json --matrix p.txt {arguments}",
                source.display(),
                target.display()
            ),
        );
        let pose = found(&at.join("p.json"));
        let (angle, shift) = errors(&pose, &truth, middle);
        assert!(
            angle < 0.1 && shift < 2e-3,
            "{arguments}: {angle} deg, {shift} m"
        );
        (pose, text)
    };
    let (pose, text) = register("--out aligned.xyz");
    let matrix = std::fs::read_to_string(at.join("p.txt")).expect("written");
    let rows: Vec<f64> = matrix
        .split_whitespace()
        .map(|word| word.parse().expect("a number"))
        .collect();
    let [a, b, c] = pose.to_rows();
    for (written, number) in rows.iter().zip([a, b, c, [0.0, 0.0, 0.0, 1.0]].concat()) {
        // The JSON reader rounds the last digit.
        assert!(
            (written - number).abs() <= 4e-16 * number.abs(),
            "{written} {number}"
        );
    }
    assert_eq!(rows.len(), 16);
    // As printed, the pose still puts a point within a tenth of a millimetre.
    let printed: Vec<f64> = text
        .lines()
        .skip(1)
        .take(3)
        .flat_map(str::split_whitespace)
        .map(|word| word.parse().expect("a number"))
        .collect();
    let printed = Pose64::from_rows(std::array::from_fn(|r| {
        std::array::from_fn(|c| printed[4 * r + c])
    }));
    assert!(errors(&printed, &pose, middle).1 < 1e-4, "{text}");
    // The points that are written keep their digits, too.
    let before = read_file(&source).expect("read");
    let aligned = read_file(&at.join("aligned.xyz")).expect("written");
    let moved = before.moved(&pose).points;
    for (a, b) in aligned.points.iter().flatten().zip(moved.iter().flatten()) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    // Each output is a valid start, with all digits.
    for start in ["p.json", "p.txt"] {
        std::fs::copy(at.join(start), at.join(format!("start-{start}"))).expect("copied");
        register(&format!("--init start-{start}"));
    }
}

#[test]
fn hostile_files_are_refused() {
    let folder = folder();
    let at = folder.path();
    let python = std::process::Command::new("python3")
        .arg(case("hostile_files.py"))
        .current_dir(at)
        .status();
    if !python.is_ok_and(|status| status.success()) {
        println!("skipped: no python3 to write the files");
        return;
    }
    let target = case("npy_3xn/target.ply");
    let mut count = 0;
    for entry in std::fs::read_dir(at).expect("a folder") {
        let name = entry.expect("an entry").file_name();
        let name = name.to_string_lossy();
        fail(
            at,
            &format!("register {name} {}", target.display()),
            &[&name],
        );
        count += 1;
    }
    assert!(count >= 35, "{count}");
}
