use super::*;
use glam::Vec3;
use reagent_core::pose::rotation_from_euler;

fn sample() -> PairSet {
    let clouds = |n: usize, phase: f32| -> Vec<Vec<Point>> {
        let coordinate =
            |m: usize, i: usize, axis: usize| ((m * 31 + i * 7 + axis) as f32 + phase).sin();
        (0..10)
            .map(|m| {
                (0..n)
                    .map(|i| [0, 1, 2].map(|axis| coordinate(m, i, axis)))
                    .collect()
            })
            .collect()
    };
    let pose = |m| Pose {
        rotation: rotation_from_euler(Vec3::new(m as f32 * 0.1, 0.2, -0.3)),
        translation: Vec3::new(0.1, m as f32, 0.0),
    };
    PairSet {
        source: clouds(20, 0.0),
        target: clouds(24, 0.5),
        target_from_source: (0..10).map(pose).collect(),
        raw: Some(clouds(30, 0.25)),
        label: (0..10).collect(),
        symmetries: None,
        seen: vec![None; 10],
    }
}

/// The same, with view points for some sources.
fn views() -> PairSet {
    let seen = |m: usize| {
        (m % 3 == 1).then(|| Seen {
            view_point: [m as f32, 0.5, -2.0],
            background: Vec::new(),
        })
    };
    PairSet {
        seen: (0..10).map(seen).collect(),
        ..sample()
    }
}

fn refused(set: PairSet) -> String {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("pairs.h5");
    set.save(&path)
        .and_then(|()| PairSet::load(&path).map(|_| ()))
        .expect_err("must be refused")
        .to_string()
}

#[test]
fn saved_and_loaded_is_the_same() {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("pairs.h5");
    let mut set = sample();
    set.save(&path).expect("save");
    assert_eq!(PairSet::load(&path).expect("load"), set);
    set.raw = None;
    set.save(&path).expect("save");
    assert_eq!(PairSet::load(&path).expect("load"), set);
    let set = views();
    set.save(&path).expect("save");
    assert_eq!(PairSet::load(&path).expect("load"), set);

    let sets = [
        ("policy".into(), set.target_from_source.clone()),
        ("icp".into(), vec![Pose::IDENTITY; 2]),
    ];
    save_poses(&path, &sets).expect("save");
    for (name, poses) in sets {
        assert_eq!(load_poses(&path, &name).expect("load"), poses);
    }
    assert!(load_poses(&path, "gone").is_err());
}

#[test]
fn homogeneous_poses_are_read() {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("pairs.h5");
    let set = sample();
    let with_last_row = |last: [f32; 4]| {
        let mut file = FileBuilder::new();
        add_clouds(&mut file, "source", &set.source).expect("equal sizes");
        add_clouds(&mut file, "target", &set.target).expect("equal sizes");
        let values: Vec<f32> = set
            .target_from_source
            .iter()
            .flat_map(|pose| pose.to_rows().into_iter().chain([last]))
            .flatten()
            .collect();
        file.create_dataset("transform_gt")
            .with_f32_data(&values)
            .with_shape(&[set.source.len() as u64, 4, 4]);
        write(file, &path).expect("write");
        PairSet::load(&path)
    };
    let read = with_last_row([0.0, 0.0, 0.0, 1.0]).expect("load");
    assert_eq!(read.target_from_source, set.target_from_source);
    let said = with_last_row([0.0, 0.0, 1.0, 1.0]).expect_err("refused");
    assert!(
        said.to_string().contains("entry 0 is not a finite rigid"),
        "{said}"
    );
}

#[test]
fn bad_numbers_are_named_by_their_place() {
    let mut set = sample();
    set.target[3][5][1] = f32::INFINITY;
    assert!(refused(set).contains("\"target\", entry 3, point 5"));
    let mut set = sample();
    set.target_from_source[4].rotation.x_axis *= 1.1;
    assert!(refused(set).contains("\"transform_gt\", entry 4 is not a finite rigid transform"));
    let mut set = sample();
    set.target_from_source[9].translation.x = f32::NAN;
    assert!(refused(set).contains("entry 9"));
    for bad in [f32::INFINITY, f32::NAN, -2e12] {
        let mut set = views();
        set.seen[4].as_mut().expect("a view").view_point[2] = bad;
        assert!(refused(set).contains("\"view_point\", entry 4 is no point"));
    }
}

#[test]
fn lists_of_unequal_length_are_refused() {
    let mut set = sample();
    set.label.pop();
    assert!(refused(set).contains("9 labels for 10 source clouds"));
    let mut set = views();
    set.seen.pop();
    assert!(refused(set).contains("9 view points for 10 source clouds"));
    let mut set = sample();
    set.source[7].pop();
    assert!(refused(set).contains("source 7 has 19 points where the first has 20"));
    let mut set = sample();
    set.source.clear();
    assert!(refused(set).contains("no pairs"));
}

#[test]
fn entries_of_unequal_number_in_a_file_are_refused() {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("pairs.h5");
    let set = sample();
    let mut file = FileBuilder::new();
    add_clouds(&mut file, "source", &set.source).expect("equal sizes");
    add_clouds(&mut file, "target", &set.target[..6]).expect("equal sizes");
    write(file, &path).expect("write");
    let said = PairSet::load(&path)
        .expect_err("must be refused")
        .to_string();
    assert!(
        said.contains("\"target\" has 6 entries where \"source\" has 10"),
        "{said}"
    );

    let mut file = FileBuilder::new();
    add_clouds(&mut file, "source", &set.source).expect("equal sizes");
    add_clouds(&mut file, "target", &set.target).expect("equal sizes");
    write(file, &path).expect("write");
    let said = PairSet::load(&path)
        .expect_err("must be refused")
        .to_string();
    assert!(
        said.contains("no dataset \"transform_gt\" ([M,3,4] or [M,4,4] f32)"),
        "{said}"
    );
    assert!(said.contains("source [10, 20, 3] f32"), "{said}");
}

#[test]
fn symmetries_are_read_from_beside_the_pairs() {
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().join("pairs.h5");
    let beside = dir.path().join("pairs.json");
    let set = sample();
    set.save(&path).expect("written");
    assert_eq!(PairSet::load(&path).expect("read").symmetries, None);
    // The output of an evaluation under the same name says nothing of symmetries.
    std::fs::write(&beside, r#"{"pairs": 10}"#).expect("written");
    assert_eq!(PairSet::load(&path).expect("read").symmetries, None);
    let one = r#"{"truths": [[[1,0,0,0],[0,1,0,0],[0,0,1,0]]], "sym": true, "what": "a can"}"#;
    let list = |n| format!("[{}]", vec![one; n].join(","));
    std::fs::write(&beside, list(10)).expect("written");
    let found = PairSet::load(&path)
        .expect("read")
        .symmetries
        .expect("there");
    assert!(found.len() == 10 && found[0].sym && found[0].truths.len() == 1);
    std::fs::write(&beside, list(9)).expect("written");
    let error = PairSet::load(&path)
        .expect_err("one is missing")
        .to_string();
    assert!(
        error.contains("symmetries") && error.contains('9'),
        "{error}"
    );
}

#[test]
fn targets_in_millimetres_are_refused() {
    let scaled = |scale: f32, shift: f32| {
        let mut set = sample();
        for cloud in &mut set.target[4..] {
            for point in cloud {
                *point = point.map(|x| scale * x + shift);
            }
        }
        refused(set)
    };
    for (said, words) in [
        (scaled(100.0, 0.0), "pair 4 has radius 1"),
        (scaled(0.1, 0.0), "pair 4 has radius 0.1"),
        (scaled(1.0, 5.0), "its mean is 8."),
    ] {
        assert!(
            said.contains(words) && said.contains("divide these"),
            "{said}"
        );
    }
}

#[test]
fn targets_without_noise_in_other_units_are_refused() {
    let mut set = sample();
    let raw = set.raw.as_mut().expect("a raw target");
    raw[1].iter_mut().flatten().for_each(|x| *x *= 100.0);
    let said = refused(set);
    assert!(said.contains("\"raw\" of pair 1 has radius"), "{said}");
}

#[test]
fn a_list_of_symmetries_that_cannot_be_read_is_an_error() {
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().join("pairs.h5");
    let beside = dir.path().join("pairs.json");
    sample().save(&path).expect("written");
    let one = r#"{"truths": [[[1,0,0,0],[0,1,0,0],[0,0,1,0]]], "symmetric": true}"#;
    for (text, words) in [
        (format!(" [{one}]"), "missing field `sym`"),
        ("[{".to_owned(), "EOF"),
        (r#"["a"]"#.to_owned(), "line 1 column 4"),
    ] {
        std::fs::write(&beside, text).expect("written");
        let said = PairSet::load(&path).expect_err("refused").to_string();
        let named = said.contains("pairs.json") && said.contains("move it away");
        assert!(named && said.contains(words), "{said}");
    }
}

#[test]
fn the_list_of_symmetries_is_not_written_over() {
    let dir = tempfile::tempdir().expect("a directory");
    let path = dir.path().join("pairs.h5");
    let [same, other] = ["./pairs.json", "other.json"].map(|name| Some(dir.path().join(name)));
    assert!(Symmetry::keep_beside(&path, [&None, &other]).is_ok());
    let said = Symmetry::keep_beside(&path, [&other, &same]).expect_err("refused");
    assert!(said.to_string().contains("another file"), "{said}");
}
