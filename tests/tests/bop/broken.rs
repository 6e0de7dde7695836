//! Missing, impossible and damaged data is named.

use super::*;
use host_train::bop::synth::ESTIMATES_FILE;
use host_train::dataset::bop::BopError;
use host_train::dataset::depth::DepthError;
use proptest::prelude::*;
use std::path::Path;

#[test]
fn the_first_thing_that_is_missing_is_named() {
    let open = |root: &Path| {
        Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1)
            .map(|_| ())
            .expect_err("refused")
            .to_string()
    };
    let empty = tempfile::tempdir().expect("temporary directory");
    let said = open(empty.path());
    assert!(
        said.contains("models_eval") && said.contains("bop.felk.cvut.cz"),
        "{said}"
    );
    for (missing, words) in [
        ("test/000001/scene_gt.json", "cam_R_m2c"),
        ("test/000001/scene_camera.json", "cam_K"),
        ("models_eval/models_info.json", "diameter"),
        ("models_eval/obj_000003.ply", "obj_000003.ply"),
        ("test/000000/depth/000001.png", "16 bits"),
        ("estimates.csv", "scene_id,im_id,obj_id,score,R,t,time"),
    ] {
        let dir = generated(0.0, 7);
        std::fs::remove_file(dir.path().join(missing)).expect("removed");
        let said = open(dir.path());
        assert!(said.contains(missing) && said.contains(words), "{said}");
    }
    let dir = generated(0.0, 7);
    let root = dir.path();
    std::fs::remove_dir_all(root.join("test/000000/mask_estimate")).expect("removed");
    assert!(Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1).is_ok());
    std::fs::remove_dir_all(root.join("test/000000/mask_visib")).expect("removed");
    assert!(open(root).contains("mask_visib"));
}

#[test]
fn contents_that_cannot_be_are_named() {
    let dir = generated(0.0, 7);
    let root = dir.path();
    let refuse = |file: &str, from: &str, to: &str, words: &[&str]| {
        let path = root.join(file);
        let text = std::fs::read_to_string(&path).expect("text");
        let changed = text.replacen(from, to, 1);
        assert_ne!(text, changed, "{file} holds {from}");
        std::fs::write(&path, changed).expect("written");
        let said = Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1)
            .map(|_| ())
            .expect_err("refused")
            .to_string();
        std::fs::write(&path, text).expect("written");
        assert!(said.contains(file), "{said}");
        for word in words {
            assert!(said.contains(word), "no {word} in {said}");
        }
    };
    let truth = "test/000000/scene_gt.json";
    refuse(truth, "cam_t_m2c", "cam_T_m2c", &["cam_t_m2c", "line"]);
    refuse(
        truth,
        "\"obj_id\": ",
        "\"obj_id\": 99",
        &["names object 99", "models_eval"],
    );
    refuse(
        truth,
        "\"1\": [",
        "\"7\": [",
        &["image 7", "scene_camera.json"],
    );
    let camera = "test/000001/scene_camera.json";
    refuse(
        camera,
        "\"depth_scale\": 0.1",
        "\"depth_scale\": -0.1",
        &["depth_scale"],
    );
    let info = "models_eval/models_info.json";
    refuse(info, "\"diameter\": ", "\"diameter\": -", &["diameter -"]);
    refuse("estimates.csv", " ", " x ", &["row 2"]);

    // A mask of another size, and a depth image that is a mask.
    let masks = root.join("test/000000/mask_estimate");
    for entry in std::fs::read_dir(&masks).expect("masks") {
        let path = entry.expect("an entry").path();
        host_train::dataset::depth::image::write_mask(&path, [3, 2], &[true; 6]).expect("written");
    }
    let said = Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1)
        .map(|_| ())
        .expect_err("refused");
    assert!(
        matches!(
            said,
            BopError::Depth(DepthError::Size { found: [3, 2], .. })
        ),
        "{said}"
    );
}

/// Damage to a file: its end cut off, or some bytes changed.
#[derive(Clone, Debug)]
enum Damage {
    Cut(f64),
    Bytes(Vec<(f64, u8)>),
}

fn damage() -> impl Strategy<Value = Damage> {
    let cut = (0.0..1.0).prop_map(Damage::Cut);
    let bytes = prop::collection::vec((0.0..1.0, any::<u8>()), 1..12).prop_map(Damage::Bytes);
    prop_oneof![cut, bytes]
}

const FRAGILE: [&str; 8] = [
    "models_eval/models_info.json",
    "models_eval/obj_000004.ply",
    "test/000000/scene_gt.json",
    "test/000000/scene_camera.json",
    "test/000000/scene_gt_info.json",
    "test/000000/depth/000000.png",
    "test/000000/mask_estimate/000000_000000.png",
    "estimates.csv",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Whatever the damage, the set is read or refused. There is no panic, and no more memory in use than the images
    /// take. A file that was cut is named unless the rest of it is complete.
    #[test]
    fn damaged_files_are_read_or_refused(file in 0..FRAGILE.len(), damage in damage()) {
        static DIR: LazyLock<TempDir> = LazyLock::new(|| generated(0.0, 11));
        let root = DIR.path();
        let path = root.join(FRAGILE[file]);
        let whole = std::fs::read(&path).expect("a file");
        let mut bytes = whole.clone();
        match &damage {
            Damage::Cut(share) => bytes.truncate((bytes.len() as f64 * share) as usize),
            Damage::Bytes(changes) => for (place, byte) in changes {
                let place = (bytes.len() as f64 * place) as usize;
                bytes[place] = *byte;
            },
        }
        std::fs::write(&path, &bytes).expect("written");
        let opened = Refinements::open(root, &root.join(ESTIMATES_FILE), None, 1);
        std::fs::write(&path, &whole).expect("written");
        match opened {
            Ok(found) => {
                let pairs = found.set.source.len();
                prop_assert!(found.estimated(&vec![Pose::IDENTITY; pairs]).is_ok());
            }
            Err(error) => {
                let said = error.to_string();
                prop_assert!(said.contains(root.to_str().expect("text")), "{}", said);
            }
        }
    }
}
