//! What a caller says of the start and of the sensor.

mod support;

use std::path::Path;
use support::{fail, folder, read_json, run, succeed};

/// A folder with the example's scan and part.
fn example() -> tempfile::TempDir {
    let folder = folder();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/data");
    for name in ["scan.ply", "part.ply"] {
        std::fs::copy(data.join(name), folder.path().join(name)).expect("copied");
    }
    folder
}

#[test]
fn without_steps_the_start_is_compared_with_other_poses() {
    let folder = example();
    let at = folder.path();
    let words = "register scan.ply part.ply --json p.json --dense never";
    let said = succeed(at, &format!("{words} --steps 0"));
    assert!(!said.contains("policy"), "{said}");
    let document = read_json(&at.join("p.json"));
    assert_eq!(document["verdict"], "converged");
    assert_eq!(document["steps"], 0);
    assert!(document["verify"]["hypotheses"].as_u64() > Some(0));
    let output = run(at, &format!("{words} --steps 0 --mode fast"));
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn an_uncertain_start_is_stated_in_degrees_and_in_the_targets_units() {
    let folder = example();
    let at = folder.path();
    let words = "register scan.ply part.ply --json p.json";
    for good in ["10,20,5", "180,inf,inf", "0,0,0"] {
        succeed(at, &format!("{words} --uncertainty {good}"));
    }
    for bad in ["10", "1,2", "1,-2,3", "nan,1,1"] {
        let output = run(at, &format!("{words} --uncertainty={bad}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("three numbers"), "{said}");
    }
}

#[test]
fn a_view_point_among_the_points_is_told() {
    let folder = example();
    let at = folder.path();
    let cloud = host_train::dataset::cloud_file::read_file(&at.join("scan.ply")).expect("a cloud");
    let [x, y, z] = cloud.points[0];
    let words = "register scan.ply part.ply --json p.json";
    succeed(at, &format!("{words} --view={x},{y},{z}"));
    let notes = read_json(&at.join("p.json"))["notes"].to_string();
    assert!(notes.contains("among its points"), "{notes}");
    fail(at, &format!("{words} --view=1e20,0,0"), &["view point"]);
}
