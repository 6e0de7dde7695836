//! Corrupt files of every kind that is read give a typed error or other numbers, but never a panic, and never use more
//! memory than the file's length explains.
//!
//! `PROPTEST_CASES` asks for more cases.

#[path = "corrupt_files/damage.rs"]
mod damage;

use damage::damage_and_read;
use host_train::dataset::cloud_file::bag::Bag;
use host_train::dataset::cloud_file::{CloudFile, read_file, write_cloud};
use host_train::dataset::pairs::{PairSet, Sample, load_poses, save_poses};
use host_train::dataset::{self, Point, Split, modelnet};
use reagent_core::Pose;
use reagent_tests::shared;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};

/// Memory is counted over the whole process: one test at a time.
static TURN: Mutex<()> = Mutex::new(());

fn turn() -> MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn points(n: usize) -> Vec<Point> {
    let point = |i: usize| [0, 1, 2].map(|axis| ((i * 7 + axis * 13) as f32 * 0.37).sin());
    (0..n).map(point).collect()
}

/// A small file of every format and flavour.
fn loose_files(dir: &Path) -> Vec<PathBuf> {
    let cloud = CloudFile {
        normals: Some(vec![[0.0, 0.6, 0.8]; 40]),
        colours: Some(vec![[1, 100, 255]; 40]),
        intensities: Some(vec![0.5; 40]),
        ..CloudFile::of(&points(40))
    };
    let mut paths: Vec<PathBuf> = ["le.ply", "binary.pcd", "cloud.npy", "cloud.xyz"]
        .map(|name| dir.join(name))
        .into();
    for path in &paths {
        write_cloud(path, &cloud).expect("written");
    }
    let mut add = |name: &str, bytes: Vec<u8>| {
        paths.push(dir.join(name));
        std::fs::write(dir.join(name), bytes).expect("written");
    };
    let lines = |prefix: &str| -> String {
        points(12)
            .iter()
            .map(|[x, y, z]| format!("{prefix}{x} {y} {z}\n"))
            .collect()
    };
    let faces = |prefix: &str, first: usize| -> String {
        (0..8)
            .map(|i| {
                format!(
                    "{prefix}{} {} {}\n",
                    i + first,
                    i + first + 1,
                    i + first + 3
                )
            })
            .collect()
    };
    add(
        "mesh.off",
        format!("OFF\n12 8 0\n{}{}", lines(""), faces("3 ", 0)).into(),
    );
    add(
        "mesh.obj",
        format!(
            "# mesh\no a\n{}{}f 1/1 2/2 3/3 -1/4\n",
            lines("v "),
            faces("f ", 1)
        )
        .into(),
    );
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment made here\nelement vertex 12\nproperty float x\nproperty float y\nproperty float z\nelement face 8\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    add(
        "ascii.ply",
        format!("{}{}{}", header("ascii"), lines(""), faces("3 ", 0)).into(),
    );
    let mut bytes = header("binary_big_endian").into_bytes();
    bytes.extend(points(12).iter().flatten().flat_map(|x| x.to_be_bytes()));
    bytes.extend((0..8u32).flat_map(|i| {
        [
            &[3][..],
            &i.to_be_bytes(),
            &(i + 1).to_be_bytes(),
            &(i + 3).to_be_bytes(),
        ]
        .concat()
    }));
    add("be.ply", bytes);
    let corners = |i: usize| points(3 * i + 3)[3 * i..].to_vec();
    let facet = |i| {
        format!(
            "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n",
            corners(i)
                .iter()
                .map(|[x, y, z]| format!("vertex {x} {y} {z}\n"))
                .collect::<String>()
        )
    };
    add(
        "ascii.stl",
        format!(
            "solid a\n{}endsolid a\n",
            (0..6).map(facet).collect::<String>()
        )
        .into(),
    );
    let mut bytes = [&[b' '; 80][..], &6u32.to_le_bytes()].concat();
    for i in 0..6 {
        bytes.extend([0; 12]);
        bytes.extend(
            corners(i)
                .iter()
                .flatten()
                .flat_map(|x| x.to_le_bytes())
                .chain([0, 0]),
        );
    }
    add("binary.stl", bytes);
    let pcd = |kind: &str| {
        format!(
            "VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 12\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 12\nDATA {kind}\n"
        )
    };
    let rows: String = points(12)
        .iter()
        .map(|[x, y, z]| format!("{x} {y} {z} 255\n"))
        .collect();
    add(
        "ascii.pcd",
        format!("{}nan nan nan 0\n{rows}", pcd("ascii").replace("12", "13")).into(),
    );
    // Column after column, in literal runs and one reference back.
    let columns: Vec<u8> = (0..3)
        .flat_map(|axis| {
            points(12)
                .into_iter()
                .flat_map(move |p| p[axis].to_le_bytes())
        })
        .collect();
    let mut packed: Vec<u8> = columns
        .chunks(32)
        .flat_map(|run| [&[run.len() as u8 - 1][..], run].concat())
        .collect();
    packed.extend([3, 0, 0, 0, 0, 0xe0, 35, 3]);
    let sizes = [packed.len() as u32, 4 * 48].map(u32::to_le_bytes).concat();
    add(
        "packed.pcd",
        [pcd("binary_compressed").as_bytes(), &sizes, &packed].concat(),
    );
    paths
}

#[test]
fn loose_clouds_and_meshes() {
    let _turn = turn();
    let dir = tempfile::tempdir().expect("temporary directory");
    for path in loose_files(dir.path()) {
        let whole = std::fs::read(&path).expect("written");
        // A packed byte expands to up to 88, of which three copies are made.
        let factor = if path.ends_with("packed.pcd") {
            300
        } else {
            64
        };
        damage_and_read(&path, &whole, factor, 200, |path| {
            let file = read_file(path).map_err(|e| e.to_string())?;
            assert!(file.points.iter().flatten().all(|x| x.is_finite()));
            let count = file.points.len();
            assert!(
                file.faces
                    .iter()
                    .flatten()
                    .flatten()
                    .all(|&vertex| (vertex as usize) < count)
            );
            assert!(file.normals.is_none_or(|normals| normals.len() == count));
            Ok(())
        });
    }
}

/// Reads every message of a bag.
fn read_bag(path: &Path) -> Result<(), String> {
    let bag = Bag::open(path, Some("/camera/points")).map_err(|e| e.to_string())?;
    for message in bag.messages() {
        let message = message.map_err(|e| e.to_string())?;
        // A message that is not a cloud is refused, and the others are read.
        if let Ok((cloud, _)) = message.cloud() {
            assert!(cloud.points.iter().flatten().all(|x| x.is_finite()));
        }
    }
    Ok(())
}

#[test]
fn bags_of_ros() {
    let _turn = turn();
    let dir = tempfile::tempdir().expect("temporary directory");
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/bags");
    for name in ["lz4.mcap", "zstd.mcap", "two_topics.mcap"] {
        let whole = std::fs::read(fixtures.join(name)).expect("a fixture");
        // A chunk may claim 4096 times the file's length, and its buffer doubles as it grows.
        damage_and_read(&dir.path().join(name), &whole, 9000, 400, read_bag);
    }
}

/// A pairs file as this program writes them.
fn pairs() -> PairSet {
    let mut set = PairSet::default();
    for i in 0..9 {
        let sample = Sample {
            source: points(30),
            target: points(30),
            target_from_source: Pose::IDENTITY,
        };
        set.push(sample, points(50), i);
    }
    set
}

fn read_pairs(path: &Path) -> Result<(), String> {
    let set = PairSet::load(path).map_err(|e| e.to_string())?;
    assert_eq!(set.source.len(), set.label.len());
    assert!(
        set.source
            .iter()
            .chain(&set.target)
            .flatten()
            .flatten()
            .all(|x| x.is_finite())
    );
    Ok(())
}

fn read_models(path: &Path) -> Result<(), String> {
    let models = modelnet::load_file(path).map_err(|e| e.to_string())?;
    assert!(
        models
            .iter()
            .flat_map(|m| m.points.as_flattened())
            .all(|x| x.is_finite())
    );
    Ok(())
}

#[test]
fn files_of_pairs_and_poses() {
    let _turn = turn();
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("pairs.h5");
    pairs().save(&path).expect("written");
    let whole = std::fs::read(&path).expect("written");
    damage_and_read(&path, &whole, 100, 600, read_pairs);

    let path = dir.path().join("poses.h5");
    save_poses(&path, &[("icp".into(), vec![Pose::IDENTITY; 20])]).expect("written");
    let whole = std::fs::read(&path).expect("written");
    damage_and_read(&path, &whole, 100, 300, |path| {
        load_poses(path, "icp").map(drop).map_err(|e| e.to_string())
    });
}

#[test]
fn hdf5_as_the_reference_library_writes_it() {
    let _turn = turn();
    let dir = tempfile::tempdir().expect("temporary directory");
    if let Some(scans) = shared("data/real_scans/test_objectdataset.h5") {
        let whole = std::fs::read(scans).expect("readable");
        damage_and_read(&dir.path().join("scans.h5"), &whole, 100, 100, read_models);
    }
    if let Some(poses) = shared("fixtures/reference_poses.h5") {
        let whole = std::fs::read(poses).expect("readable");
        let read = |path: &Path| {
            load_poses(path, "pred")
                .map(drop)
                .map_err(|e| e.to_string())
        };
        damage_and_read(&dir.path().join("poses.h5"), &whole, 100, 200, read);
    }
}

#[test]
fn lists_of_a_data_set() {
    let _turn = turn();
    let dir = tempfile::tempdir().expect("temporary directory");
    let file = dir.path().join("ply_data_train0.h5");
    pairs().save(&file).expect("written");
    let list = dir.path().join("train_files.txt");
    // Undamaged, the list leads to a file without clouds; only its name matters here.
    damage_and_read(
        &list,
        b"data/x/ply_data_train0.h5\nply_data_train0.h5\n",
        64,
        100,
        |_| match dataset::load(dir.path(), Split::Train, 1) {
            Ok(_) => Ok(()),
            Err(e) if e.to_string().contains("no dataset \"data\"") => Ok(()),
            Err(e) => Err(format!("train_files.txt: {e}")),
        },
    );
}
