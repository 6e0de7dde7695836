//! ROS 2 bags in `host-train register` and `track`, written by `tests/bags.py` with software that is not ours.

mod support;

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use serde_json::Value;
use std::path::Path;
use support::{fail, folder, read_json, run, succeed};
use tempfile::TempDir;

/// A folder with the part and the bags.
fn bags() -> TempDir {
    let folder = folder();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/bags");
    for name in ["part.xyz", "lz4.mcap", "two_topics.mcap"] {
        std::fs::copy(fixtures.join(name), folder.path().join(name)).expect("copied");
    }
    folder
}

/// Checks a pose of the part in a message: angle in degrees and distance from the truth.
fn is_there(pose: &Value, number: usize) {
    let rows: [[f64; 4]; 3] = serde_json::from_value(pose.clone()).expect("a pose");
    let axis = Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0));
    let turned = Rotation3::from_axis_angle(&axis, 0.05 * number as f64);
    let shift = Vector3::new(0.02, -0.01, 0.0) * number as f64 + Vector3::new(0.0, 0.0, 0.5);
    let rotation = Matrix3::from_fn(|r, c| rows[r][c]);
    let error = rotation * shift + Vector3::from_fn(|r, _| rows[r][3]);
    let cosine = ((rotation * turned.into_inner()).trace() - 1.0) / 2.0;
    let degrees = cosine.min(1.0).acos().to_degrees();
    assert!(
        degrees < 3.0 && error.norm() < 0.01,
        "{number}: {degrees} {error}"
    );
}

#[test]
fn a_message_is_registered() {
    let folder = bags();
    let at = folder.path();
    for (options, number) in [
        ("lz4.mcap part.xyz", 0),
        ("lz4.mcap part.xyz --message 3", 3),
        ("lz4.mcap part.xyz --message 0.45s", 5),
        (
            "two_topics.mcap part.xyz --topic /camera/points --message 2",
            2,
        ),
    ] {
        let output = run(at, &format!("register {options} --json pose.json"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{options}: {said}");
        let of = format!("message {number} of /camera/points, stamped {number}.000000005");
        assert!(said.contains(&of), "{options}: {said}");
        is_there(
            &read_json(&at.join("pose.json"))["target_from_source"],
            number,
        );
    }
    // A bag is read wherever clouds are.
    std::fs::write(at.join("list.txt"), "lz4.mcap part.xyz\n").expect("written");
    let said = succeed(at, "register --pairs list.txt");
    let line: Value = serde_json::from_str(&said).expect("a line");
    is_there(&line["target_from_source"], 0);
    std::fs::create_dir(at.join("models")).expect("created");
    std::fs::copy(at.join("lz4.mcap"), at.join("models/lz4.mcap")).expect("copied");
    let said = succeed(
        at,
        "eval --data models --protocol m40-models --methods init",
    );
    assert!(said.contains("1 pair of models"), "{said}");
}

#[test]
fn all_messages_of_a_topic_are_followed() {
    let folder = bags();
    let at = folder.path();
    // A bag's folder, which also holds a file that is not part of the bag.
    std::fs::create_dir(at.join("bag")).expect("created");
    std::fs::write(at.join("bag/metadata.yaml"), "").expect("written");
    std::fs::copy(at.join("lz4.mcap"), at.join("bag/bag_0.mcap")).expect("copied");
    for (scans, count) in [
        ("lz4.mcap", 6),
        ("bag", 6),
        ("two_topics.mcap --topic /camera/points", 5),
    ] {
        let output = run(at, &format!("track part.xyz {scans}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{scans}: {said}");
        let lines = String::from_utf8_lossy(&output.stdout);
        for (number, line) in lines.lines().enumerate() {
            let line: Value = serde_json::from_str(line).expect("JSON");
            assert_eq!(line["message"], number, "{line}");
            assert_eq!(line["stamp"]["sec"], number, "{line}");
            assert_eq!(line["stamp"]["nanosec"], 5, "{line}");
            let state = if number == 0 { "found" } else { "tracked" };
            assert_eq!(line["state"], state, "{line}");
            is_there(&line["target_from_source"], number);
        }
        let summary = format!("{count} clouds: {} tracked, 1 found, 0 lost; ", count - 1);
        assert!(said.starts_with(&summary), "{said}");
    }
    // An interrupted recording is followed to its end, and a message says so.
    let bytes = std::fs::read(at.join("lz4.mcap")).expect("a bag");
    std::fs::write(at.join("cut.mcap"), &bytes[..bytes.len() / 2]).expect("written");
    let output = run(at, "track part.xyz cut.mcap lz4.mcap");
    assert_eq!(output.status.code(), Some(1));
    let lines = String::from_utf8_lossy(&output.stdout);
    let lines: Vec<Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    let cut = lines.iter().position(|line| line.get("error").is_some());
    let cut = cut.expect("a line for the end");
    assert!((1..6).contains(&cut) && lines.len() == cut + 1 + 6, "{cut}");
    let reason = lines[cut]["error"].as_str().unwrap_or_default();
    assert!(
        reason.contains("cut.mcap: the bag is cut off at"),
        "{reason}"
    );
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("could not be read"), "{said}");
}

#[test]
fn what_is_wrong_with_a_bag_is_said() {
    let folder = bags();
    let at = folder.path();
    std::fs::write(at.join("old.db3"), "SQLite format 3").expect("written");
    std::fs::write(at.join("empty.mcap"), "").expect("written");
    for command in ["register", "track part.xyz"] {
        let target = if command == "register" {
            "part.xyz"
        } else {
            ""
        };
        let fail =
            |bag: &str, words: &[&str]| fail(at, &format!("{command} {bag} {target}"), words);
        fail("old.db3", &["old.db3", "ros2 bag convert"]);
        fail(
            "empty.mcap",
            &["empty.mcap", "no points: the file is empty"],
        );
        fail("no.mcap", &["no.mcap", "No such file"]);
        fail(
            "two_topics.mcap",
            &["--topic", "/camera/points, /lidar/points"],
        );
        fail("lz4.mcap --topic /x", &["no topic /x", "/camera/points"]);
        fail("lz4.mcap --topic /camera/label", &["std_msgs/msg/Header"]);
    }
    fail(
        at,
        "register lz4.mcap part.xyz --message 6",
        &["has 6 messages"],
    );
    // Where no topic can be named, the advice is another.
    std::fs::create_dir(at.join("models")).expect("created");
    std::fs::copy(at.join("two_topics.mcap"), at.join("models/two.mcap")).expect("copied");
    for command in [
        "eval --data models --protocol m40-models --methods init",
        "track two_topics.mcap part.xyz",
        "register part.xyz two_topics.mcap",
    ] {
        let output = run(at, command);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            !said.contains("--topic") && said.contains("mcap filter"),
            "{said}"
        );
        assert!(said.contains("/camera/points, /lidar/points"), "{said}");
    }
    // With a topic, every source in a list must be a bag.
    let list = "lz4.mcap part.xyz\npart.xyz part.xyz\n";
    std::fs::write(at.join("list.txt"), list).expect("written");
    for wrong in [
        "register --pairs list.txt --topic /camera/points",
        "register --pairs list.txt --message 3",
        "register part.xyz part.xyz --message 0",
        "register lz4.mcap part.xyz --message last",
        "track part.xyz part.xyz --topic /points",
    ] {
        assert_eq!(run(at, wrong).status.code(), Some(2), "{wrong}");
    }
}
