use super::*;
use crate::dataset::cloud_file::npy::header;
use image::{write_depth, write_mask};
use std::path::PathBuf;
use tempfile::TempDir;

const DEPTH: &str = "000007.png";

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn camera(text: &str) -> Intrinsics {
    text.parse().expect("a camera")
}

fn image<T>(size: [usize; 2], values: &[T]) -> Image<T>
where
    T: Clone,
{
    Image {
        size,
        values: values.to_vec(),
    }
}

/// What is said of parts that do not fit: depths of 3 x 2 pixels, a camera and a mask.
fn refused(depths: &[f32], camera: Intrinsics, mask: Option<Image<bool>>) -> String {
    let depth = (Path::new("depth"), image([3, 2], depths));
    let mask = mask.map(|mask| (Path::new("mask"), mask));
    DepthImage::checked(depth, (Path::new("camera"), camera), mask, 1.0)
        .expect_err("refused")
        .to_string()
}

/// Pixel (u, v) with depth z is the point ((u - cx) z / fx, (v - cy) z / fy, z).
#[test]
fn pixels_are_points_on_their_rays() {
    let depth = image([3, 2], &[10.0, f32::NAN, 0.0, 40.0, -1.0, 60.0]);
    let mask = image([3, 2], &[true, true, true, false, true, true]);
    let seen = DepthImage::checked(
        (Path::new("depth"), depth),
        (Path::new("camera"), camera("2, 4, 1, 0.5")),
        Some((Path::new("mask"), mask)),
        0.5,
    )
    .expect("an image");
    assert_eq!(seen.object_pixels(), 5);
    assert_eq!(seen.object(), [[-2.5, -0.625, 5.0], [15.0, 3.75, 30.0]]);
    assert_eq!(seen.background(), [[-10.0, 2.5, 20.0]]);
}

#[test]
fn the_background_is_what_lies_around_the_object() {
    let inside = |pixel: usize| (4..6).contains(&(pixel % 10)) && pixel / 10 == 1;
    let seen = DepthImage::new(
        camera("1,1,0,0").pinhole([10, 3]),
        vec![1.0; 30],
        (0..30).map(inside).collect(),
    );
    let columns: Vec<f32> = seen.background().iter().map(|p| p[0]).collect();
    let row = [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
    let around = [&row[..], &[2.0, 3.0, 6.0, 7.0, 8.0], &row].concat();
    assert_eq!(columns, around);
}

#[test]
fn parts_that_do_not_fit_are_named() {
    let depths = [1.0; 6];
    let good = camera("2,2,1,1");
    let mask = |size: [usize; 2], value| Some(image(size, &vec![value; size[0] * size[1]]));
    let said = refused(&depths, good, mask([2, 3], true));
    assert_eq!(
        said,
        "mask: 2 x 3 pixels, but the depth image depth has 3 x 2"
    );
    let said = refused(&depths, good, mask([3, 2], false));
    assert!(
        said.starts_with("mask: no pixel shows the object"),
        "{said}"
    );
    let elsewhere = Intrinsics {
        size: Some([640, 480]),
        ..good
    };
    let said = refused(&depths, elsewhere, None);
    assert!(said.starts_with("camera: 640 x 480 pixels"), "{said}");
    let said = refused(&[0.0, f32::NAN, -3.0, f32::INFINITY, 0.0, 0.0], good, None);
    assert!(
        said.starts_with("depth: none of the object's 6 pixels"),
        "{said}"
    );
    let corner = image([3, 2], &[true, false, false, false, false, false]);
    let said = refused(&[0.0, 1.0, 1.0, 1.0, 1.0, 1.0], good, Some(corner));
    assert!(
        said.starts_with("depth: none of the object's 1 pixel has"),
        "{said}"
    );
}

#[test]
fn cameras_are_four_numbers_or_files_of_several_kinds() {
    let folder = folder();
    let read = |text: &str| {
        let path = folder.path().join("camera");
        std::fs::write(&path, text).expect("written");
        Intrinsics::read(&path, Path::new(DEPTH)).map_err(|e| e.to_string())
    };
    let plain = camera("600,610,320,240");
    assert_eq!(read("600 610 320 240\n"), Ok(plain));
    assert_eq!(read("600 0 320\n0 610 240\n0 0 1\n"), Ok(plain));
    let matrix = [600.0f64, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0];
    let path = folder.path().join("K.npy");
    let numbers: Vec<u8> = matrix.iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(&path, [header("<f8", &[3, 3]), numbers].concat()).expect("written");
    let of_array = Intrinsics::read(&path, Path::new(DEPTH)).map_err(|e| e.to_string());
    assert_eq!(of_array, Ok(plain));
    let numbers: Vec<u8> = [600.0f64, 610.0, 320.0, 240.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    std::fs::write(&path, [header("<f8", &[4]), numbers].concat()).expect("written");
    let of_array = Intrinsics::read(&path, Path::new(DEPTH)).map_err(|e| e.to_string());
    assert_eq!(of_array, Ok(plain));
    std::fs::write(&path, [0xff, 0xfe, 0x00]).expect("written");
    let said = Intrinsics::read(&path, Path::new(DEPTH)).expect_err("no text");
    assert!(
        said.to_string()
            .contains("it is neither text nor a NumPy array"),
        "{said}"
    );
    let bop = r#"{"cx": 320, "cy": 240, "depth_scale": 0.1, "fx": 600, "fy": 610, "height": 480, "width": 640}"#;
    let known = Intrinsics {
        size: Some([640, 480]),
        depth_scale: Some(0.1),
        ..plain
    };
    assert_eq!(read(bop), Ok(known));
    let entry = r#"{"cam_K": [600, 0, 320, 0, 610, 240, 0, 0, 1], "depth_scale": 0.1}"#;
    let sized = Intrinsics {
        depth_scale: None,
        ..known
    };
    let realsense = r#"{"coeffs": [0, 0, 0, 0, 0], "fx": 600, "fy": 610, "height": 480, "model": "inverse_brown_conrady", "ppx": 320, "ppy": 240, "width": 640}"#;
    assert_eq!(read(realsense), Ok(sized));
    let open3d =
        r#"{"height": 480, "intrinsic_matrix": [600, 0, 0, 0, 610, 0, 320, 240, 1], "width": 640}"#;
    assert_eq!(read(open3d), Ok(sized));
    let placed = format!(
        r#"{{"class_name": "PinholeCameraParameters", "extrinsic": [1], "intrinsic": {open3d}}}"#
    );
    assert_eq!(read(&placed), Ok(sized));
    for ros in [
        r#"{"height": 480, "width": 640, "distortion_model": "plumb_bob", "d": [0, 0, 0, 1e-9, 0], "k": [600, 0, 320, 0, 610, 240, 0, 0, 1]}"#,
        r#"{"height": 480, "width": 640, "K": [[600, 0, 320], [0, 610, 240], [0, 0, 1]]}"#,
        r#"{"image_height": 480, "image_width": 640, "camera_matrix": {"rows": 3, "cols": 3, "data": [600, 0, 320, 0, 610, 240, 0, 0, 1]}}"#,
    ] {
        assert_eq!(read(ros), Ok(sized), "{ros}");
    }
    let known = Intrinsics {
        size: None,
        ..known
    };
    assert_eq!(read(entry), Ok(known));
    assert_eq!(read(&format!("{{\"3\": {{}}, \"7\": {entry}}}")), Ok(known));
    for (text, reason) in [
        ("0,610,320,240", "focal lengths are positive"),
        ("600,nan,320,240", "focal lengths are positive"),
        ("600,-610,320,240", "focal lengths are positive"),
        ("600,610,inf,240", "the principal point is"),
        ("600 610 320", "it has 3 numbers"),
        ("600 610 320 one", "\"one\" is not a number"),
        ("600 2 320 0 610 240 0 0 1", "K has the rows"),
        ("{\"fx\": 600}", "missing field `fy`"),
        (
            &bop.replace("0.1", "0"),
            "depth_scale: expected a positive number, found 0",
        ),
        (
            &entry.replace("0.1", "-1"),
            "depth_scale: expected a positive number, found -1",
        ),
        ("{\"cam_K\": [600]}", "invalid length 1"),
        ("{\"K\": [600, 610]}", "its K does not have nine numbers"),
        (
            "{\"K\": [600, 0, 320, 0, 610, 240, 0, 0, 1], \"D\": [0.1]}",
            "its lens distorts",
        ),
        (
            "{\"K\": [600, 0, 320, 0, 610, 240, 0, 0, 1], \"D\": {\"k1\": 0.1}}",
            "its distortion is no list of numbers",
        ),
        (&realsense.replace("[0, ", "[0.1, "), "its lens distorts"),
        (
            "{\"camera_matrix\": [600, 0, 320, 0, 610, 240, 0, 0, 1], \"dist\": [[0.3, 0]]}",
            "its lens distorts",
        ),
        (
            "{\"fx\": 600, \"fy\": 600, \"cx\": 320, \"cy\": 240, \"k1\": 0.1, \"k2\": 0}",
            "its lens distorts",
        ),
        // By rows, not by columns.
        (
            &open3d.replace("0, 0, 0, 610, 0, 320, 240", "0, 320, 0, 610, 240, 0, 0"),
            "K has the rows",
        ),
        (&format!("{{\"3\": {entry}}}"), "no image 000007"),
        ("{", "EOF"),
        ("", "it has 0 numbers"),
        (
            "image_width: 640\ncamera_matrix:\n  rows: 3\n  data: [600, 0, 320, 0, 610, 240, 0, 0, 1]\n",
            "it is YAML, which is not read: give the nine numbers of its camera_matrix, k or K; expected fx,fy,cx,cy",
        ),
        ("---\nheight: 480\nk:\n- 600.0\n", "it is YAML"),
        ("600 610 320 240 x: y", "\"x:\" is not a number"),
    ] {
        let said = read(text).expect_err(text);
        let path = folder.path().join("camera").display().to_string();
        assert!(
            said.contains(reason) && said.starts_with(&path),
            "{text}: {said}"
        );
    }
}

#[test]
fn files_are_images_of_the_right_kind() {
    let folder = folder();
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    write_depth(&at("d.png"), &image([2, 1], &[0, 700])).expect("written");
    write_mask(&at("m.PNG"), [2, 1], &[true, false]).expect("written");
    let integers = |size, values: &[f32]| Depths {
        image: image(size, values),
        is_float: false,
        marked: None,
    };
    let depth = read_depths(&at("d.png")).expect("depths");
    assert_eq!(depth, integers([2, 1], &[0.0, 700.0]));
    let mask = read_mask(&at("m.PNG")).expect("a mask");
    assert_eq!(mask, image([2, 1], &[true, false]));
    let array = |name: &str, kind: &str, shape: &[usize], bytes: &[u8]| {
        std::fs::write(at(name), [&header(kind, shape), bytes].concat()).expect("written");
    };
    let floats: Vec<u8> = [0.5f32, 1.5, 2.5, f32::NAN, 4.5, 5.5]
        .into_iter()
        .flat_map(f32::to_le_bytes)
        .collect();
    array("f.npy", "<f4", &[2, 3], &floats);
    let depth = read_depths(&at("f.npy")).expect("depths");
    assert!(depth.is_float && depth.marked.is_none());
    assert!(depth.image.size == [3, 2] && depth.image.values[4] == 4.5);
    array("u.npy", "<u2", &[1, 2, 1], &[1, 0, 0, 1]);
    let depth = read_depths(&at("u.npy")).expect("depths");
    assert_eq!(depth, integers([2, 1], &[1.0, 256.0]));
    array("b.npy", "|b1", &[1, 2], &[0, 1]);
    let mask = read_mask(&at("b.npy")).expect("a mask");
    assert_eq!(mask, image([2, 1], &[false, true]));

    // Labels below 0 and NaN are nothing.
    array("labels.npy", "|i1", &[1, 3], &[255, 0, 7]);
    let mask = read_mask(&at("labels.npy")).expect("a mask");
    assert_eq!(mask, image([3, 1], &[false, false, true]));
    let mask = read_mask(&at("f.npy")).expect("a mask");
    assert_eq!(mask.values, [true, true, true, false, true, true]);

    array("short.npy", "<f4", &[4, 3], &floats);
    array("flat.npy", "<f4", &[6], &floats);
    array("none.npy", "<f4", &[0, 6], &[]);
    for (name, reason) in [
        ("m.PNG", "it is greyscale of 8 bits"),
        ("b.npy", "8 bits, which are too few"),
        ("short.npy", "6 numbers follow"),
        ("flat.npy", "expected (rows, columns)"),
        ("none.npy", "from 1 to"),
        ("d.tiff", "its extension is \".tiff\""),
        ("missing.png", "No such file"),
    ] {
        let said = read_depths(&at(name)).expect_err(name).to_string();
        assert!(said.contains(reason) && said.contains(name), "{said}");
    }
}

/// The largest integer of a type marks what was not measured, in PNG and in arrays. In float images only what is no positive number does.
#[test]
fn the_largest_integer_is_no_depth() {
    let folder = folder();
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    write_depth(&at("d.png"), &image([4, 1], &[65535, 700, 0, 65535])).expect("written");
    let depth = read_depths(&at("d.png")).expect("depths");
    assert_eq!(depth.image.values, [0.0, 700.0, 0.0, 0.0]);
    assert_eq!(depth.marked, Some((65535.0, 2)));
    for (kind, bytes, largest) in [
        ("<u2", &[1, 0, 255, 255][..], Some(65535.0)),
        (">i2", &[0, 1, 127, 255], Some(32767.0)),
        (
            "<u4",
            &[1, 0, 0, 0, 255, 255, 255, 255],
            Some(4_294_967_295.0),
        ),
    ] {
        let array = [&header(kind, &[1, 2]), bytes].concat();
        std::fs::write(at("a.npy"), array).expect("written");
        let depth = read_depths(&at("a.npy")).expect("depths");
        assert_eq!(depth.image.values, [1.0, 0.0], "{kind}");
        assert_eq!(depth.marked, largest.map(|largest| (largest, 1)), "{kind}");
    }
    let far = image([2, 1], &[65535.0, 1e30]);
    let camera = (Path::new("camera"), camera("2,2,0,0"));
    let seen = DepthImage::checked((Path::new("depth"), far), camera, None, 1.0);
    assert_eq!(seen.expect("an image").pixels(true), [0]);
}
