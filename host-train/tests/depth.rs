//! `host-train register --depth`: a depth image in the source's place.

mod support;

use host_train::dataset::cloud_file::{CloudFile, write_cloud};
use host_train::dataset::depth::image::{Image, write_depth, write_mask};
use host_train::dataset::procedural;
use reagent_core::Pose;
use reagent_tests::depth::{CAMERA, SIZE, camera_from_model, start, write_view};
use std::path::Path;
use support::{fail, folder, read_json, run, succeed};

/// Depth of the wall, tenths of a millimetre.
const WALL: u16 = 9000;

/// Rotation and translation error of the pose in `p.json` with its lengths times `scale`, degrees and millimetres.
fn errors(at: &Path, scale: f32) -> (f32, f32) {
    let document = read_json(&at.join("p.json"));
    let row = |r: usize| -> [f32; 4] {
        std::array::from_fn(|c| {
            let number = document["target_from_source"][r][c].as_f64();
            number.expect("a number") as f32
        })
    };
    let found = Pose::from_rows([row(0), row(1), row(2)]);
    let scaled = Pose {
        translation: found.translation * scale,
        ..found
    };
    let off = scaled.after(camera_from_model());
    let trace = off.rotation.x_axis.x + off.rotation.y_axis.y + off.rotation.z_axis.z;
    let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees();
    (angle, off.translation.length())
}

#[test]
fn a_depth_image_is_registered_in_millimetres_and_other_units() {
    let folder = folder();
    let at = folder.path();
    write_view(at, WALL);
    let common = format!("--mask mask.png --init {} --json p.json", start());
    let output = run(
        at,
        &format!(
            "register --depth depth.png --camera {CAMERA} --depth-scale 0.1 part.ply {common}"
        ),
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(
        said.contains("points in millimetres (0.1 mm a unit of depth)"),
        "{said}"
    );
    let (angle, shift) = errors(at, 1.0);
    assert!(angle < 1.0 && shift < 1.0, "{angle} deg, {shift} mm");
    let document = read_json(&at.join("p.json"));
    assert_eq!(document["verdict"], "converged");
    assert_eq!(document["notes"][0]["kind"], "seen");

    // The scale of the camera's file, and a target in metres.
    let file = r#"{"fx": 200, "fy": 200, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120, "depth_scale": 0.1}"#;
    std::fs::write(at.join("camera.json"), file).expect("written");
    let part = host_train::dataset::cloud_file::read_file(&at.join("part.ply")).expect("read");
    let metres = CloudFile {
        points: part.points.iter().map(|p| p.map(|x| x * 1e-3)).collect(),
        ..part.clone()
    };
    write_cloud(&at.join("metres.ply"), &metres).expect("written");
    let init: Vec<f32> = start()
        .split(',')
        .map(|x| x.parse().expect("a number"))
        .collect();
    let shifted = |(i, &x): (usize, &f32)| if i % 4 == 3 { x * 1e-3 } else { x };
    let init: Vec<String> = init
        .iter()
        .enumerate()
        .map(shifted)
        .map(|x| x.to_string())
        .collect();
    succeed(
        at,
        &format!(
            "register --depth depth.png --camera camera.json --mask mask.png --unit mm metres.ply --init {} --json p.json",
            init.join(",")
        ),
    );
    let (angle, shift) = errors(at, 1e3);
    assert!(angle < 1.0 && shift < 1.0, "{angle} deg, {shift} mm");

    // A model without faces is accepted, too, and a note says so.
    let vertices = CloudFile {
        faces: None,
        points: procedural::shape(1, 1)
            .mesh
            .sample(
                3000,
                &mut host_train::random::stream(1, host_train::random::Purpose::Shape, 0),
            )
            .into_iter()
            .map(|p| p.map(|x| f64::from(x) * 80.0))
            .collect(),
        ..part
    };
    write_cloud(&at.join("points.ply"), &vertices).expect("written");
    let output = run(
        at,
        &format!("register --depth depth.png --camera camera.json points.ply {common}"),
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        said.contains("points.ply: it has points and no faces"),
        "{said}"
    );
    let (angle, shift) = errors(at, 1.0);
    assert!(angle < 1.0 && shift < 1.5, "{angle} deg, {shift} mm");
}

#[test]
fn depth_images_that_cannot_be_registered_are_refused_with_the_reason() {
    let folder = folder();
    let at = folder.path();
    write_view(at, WALL);
    let register = |rest: &str| format!("register --depth {rest} part.ply");
    write_mask(&at.join("small.png"), [3, 2], &[true; 6]).expect("written");
    write_mask(&at.join("empty.png"), SIZE, &[false; 160 * 120]).expect("written");
    let mut corner = [false; 160 * 120];
    corner[..3].fill(true);
    write_mask(&at.join("corner.png"), SIZE, &corner).expect("written");
    let nothing = Image {
        size: SIZE,
        values: vec![0; 160 * 120],
    };
    write_depth(&at.join("nothing.png"), &nothing).expect("written");
    let marked = nothing.map(|_| 65535);
    write_depth(&at.join("marked.png"), &marked).expect("written");
    let info = "image_width: 160\nimage_height: 120\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [200, 0, 79.5, 0, 200, 59.5, 0, 0, 1]\n";
    std::fs::write(at.join("camera_info.yaml"), info).expect("written");
    for (rest, words) in [
        (
            format!("depth.png --camera {CAMERA} --mask small.png"),
            ["small.png", "3 x 2 pixels"],
        ),
        (
            format!("depth.png --camera {CAMERA} --mask empty.png"),
            ["empty.png", "no pixel shows"],
        ),
        (
            format!("nothing.png --camera {CAMERA} --mask mask.png"),
            ["nothing.png", "has a depth"],
        ),
        (
            format!("mask.png --camera {CAMERA}"),
            ["mask.png", "16 bits"],
        ),
        (
            format!("depth.png --camera {CAMERA} --mask part.ply"),
            ["part.ply", "a greyscale PNG, or an array"],
        ),
        (
            format!("marked.png --camera {CAMERA}"),
            [
                "marked.png",
                "none of the object's 19200 pixels has a depth; 0, 65535",
            ],
        ),
        (
            "depth.png --camera camera_info.yaml".into(),
            [
                "camera_info.yaml: it is YAML",
                "its camera_matrix, k or K; expected fx,fy,cx,cy in",
            ],
        ),
        (
            format!("depth.tif --camera {CAMERA}"),
            ["depth.tif", ".npy"],
        ),
        (
            "depth.png --camera nowhere.json".into(),
            ["nowhere.json", "No such file"],
        ),
    ] {
        fail(at, &register(&rest), &words);
    }
    // A pose from three pixels is one that nobody should act on.
    succeed(
        at,
        &register(&format!(
            "depth.png --camera {CAMERA} --mask corner.png --depth-scale 0.1 --json p.json"
        )),
    );
    assert_ne!(read_json(&at.join("p.json"))["verdict"], "converged");
    for (rest, words) in [
        ("depth.png".to_owned(), "--camera"),
        (
            "depth.png --camera 0,200,79.5,59.5".into(),
            "focal lengths are positive",
        ),
        ("depth.png --camera 200,200,79.5".into(), "it has 3 numbers"),
        (
            format!("depth.png --camera {CAMERA} --depth-scale 0"),
            "from 1e-12 to 1e12",
        ),
        (
            format!("depth.png --camera {CAMERA} --view origin"),
            "--view",
        ),
        (
            format!("depth.png --camera {CAMERA} part.ply"),
            "takes the place of SOURCE",
        ),
    ] {
        let output = run(at, &register(&rest));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{rest}: {said}");
        assert!(said.contains(words), "{rest}: {said}");
    }
}

/// A wall out of the sensor's range, and a mask that holds 16-bit labels.
#[test]
fn pixels_that_are_marked_are_counted_and_labels_are_a_mask() {
    let folder = folder();
    let at = folder.path();
    write_view(at, 65535);
    let mask = host_train::dataset::depth::image::read_mask(&at.join("mask.png")).expect("read");
    let marked = mask.values.iter().filter(|&&value| value == 0).count();
    write_depth(
        &at.join("labels.png"),
        &mask.map(|value| 300 * value.min(1)),
    )
    .expect("written");
    let common = format!(
        "register --depth depth.png --camera {CAMERA} --depth-scale 0.1 part.ply --init {} --json p.json",
        start()
    );
    for mask in ["", "--mask labels.png"] {
        let output = run(at, &format!("{common} {mask}"));
        let said = String::from_utf8_lossy(&output.stderr);
        let words = format!("depth.png: {marked} pixels are 65535, the largest number");
        assert!(output.status.success() && said.contains(&words), "{said}");
        let document = read_json(&at.join("p.json"));
        assert_eq!(document["verdict"], "converged");
        let note = &document["notes"][1];
        assert_eq!(
            (&note["kind"], &note["pixels"]),
            (&"marked".into(), &marked.into())
        );
    }
}

#[test]
fn an_image_in_the_place_of_a_cloud_is_told_how_it_is_given() {
    let folder = folder();
    for clouds in ["depth.png part.ply", "part.ply depth.TIFF"] {
        let output = run(folder.path(), &format!("register {clouds}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{clouds}: {said}");
        let words = "--depth IMAGE --camera FX,FY,CX,CY TARGET, and --mask and --depth-scale";
        assert!(said.contains(words), "{clouds}: {said}");
    }
    let output = run(folder.path(), "register a.ply b.ply --view orgin");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    let words = "three finite numbers separated by commas, or \"origin\"";
    assert!(said.contains(words), "{said}");
}

#[test]
fn the_camera_of_another_size_is_pointed_out() {
    let folder = folder();
    let at = folder.path();
    write_view(at, WALL);
    // Pixel centres lie at whole numbers, so the last row reaches down to 119.5.
    for (camera, is_told) in [("200,200,79.5,119.6", true), ("200,200,-0.5,119.5", false)] {
        let register = format!(
            "register --depth depth.png --camera {camera} --depth-scale 0.1 part.ply --mask mask.png --json p.json"
        );
        let output = run(at, &register);
        let said = String::from_utf8_lossy(&output.stderr);
        let words = "depth.png: the camera's principal point (79.5, 119.6) lies outside of the image of 160 x 120 pixels";
        assert_eq!(said.contains(words), is_told, "{camera}: {said}");
        let document = read_json(&at.join("p.json"));
        let notes = document["notes"].as_array().expect("a list");
        let is_noted = notes.iter().any(|note| note["kind"] == "off_centre");
        assert_eq!(is_noted, is_told, "{camera}: {notes:?}");
    }
}
