//! The `modelnet40_ply_hdf5_2048` layout: `train_files.txt`, `test_files.txt` and `ply_data_*.h5`.

use super::h5::H5File;
use super::{DatasetError, MAX_BYTES, Model, Point, Split};
use crate::random::{Purpose, stream};
use rand::seq::SliceRandom;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

/// Labels of the first half of the categories: the ones the paper trains on.
pub const FIRST_HALF: Range<u32> = 0..20;
/// Labels of the second half, 20 to 39 in ModelNet40: the paper's held-out categories.
pub const SECOND_HALF: Range<u32> = 20..u32::MAX;

/// All clouds of a split, in the order of its list. Normals are not decoded.
pub fn load(dir: &Path, split: Split) -> Result<Vec<Model>, DatasetError> {
    if !dir.is_dir() {
        return Err(DatasetError::NoDirectory { dir: dir.into() });
    }
    let list = dir.join(split.list());
    if !list.is_file() {
        return Err(DatasetError::NoList { list });
    }
    let text = std::fs::read_to_string(&list).map_err(|source| DatasetError::Io {
        path: list.clone(),
        source,
    })?;
    let mut models = Vec::new();
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        // The published lists give paths that exist only on the machine that wrote them.
        let name = line.rsplit(['/', '\\']).next().unwrap_or(line);
        models.extend(load_file(&dir.join(name))?);
        let points: usize = models.iter().map(|model| model.points.len()).sum();
        if (points * size_of::<Point>()) as u64 > MAX_BYTES {
            return Err(DatasetError::BeyondMemory { path: list });
        }
    }
    if models.is_empty() {
        return Err(DatasetError::EmptyList { list });
    }
    Ok(models)
}

/// The clouds of one file: `data` `[N,P,3]` f32 (P is 2048 in the published files, 3 or more here) and `label`
/// `[N]` or `[N,1]`. Files of ScanObjectNN have the same datasets.
pub fn load_file(path: &Path) -> Result<Vec<Model>, DatasetError> {
    let file = H5File::open(path)?;
    let clouds = file.read_clouds("data", "[N,2048,3] f32")?;
    let labels = file.read_labels("label", clouds.len(), "data")?;
    let models = clouds.into_iter().zip(labels).enumerate();
    models
        .map(|(entry, (points, label))| match u32::try_from(label) {
            Ok(label) => Ok(Model { points, label }),
            Err(_) => Err(DatasetError::BadLabel {
                path: path.into(),
                dataset: "label".into(),
                entry,
                label,
            }),
        })
        .collect()
}

/// The models whose label lies in `labels`, in order.
pub fn categories(models: Vec<Model>, labels: Range<u32>) -> Vec<Model> {
    models
        .into_iter()
        .filter(|model| labels.contains(&model.label))
        .collect()
}

/// How many categories have no label in `kept`, and how many there are.
pub fn left_out(labels: Vec<u32>, kept: &Range<u32>) -> [usize; 2] {
    let labels: BTreeSet<u32> = labels.into_iter().collect();
    let left_out = labels.iter().filter(|label| !kept.contains(label));
    [left_out.count(), labels.len()]
}

/// Splits a training split by mesh into `(training, validation)`, each in the given order. The second part has
/// `fraction` (0 to 1) of the models, rounded, but at least one if there are two or more and the fraction is above 0.
pub fn validation_split<T>(models: Vec<T>, seed: u64, fraction: f64) -> (Vec<T>, Vec<T>) {
    let share = (models.len() as f64 * fraction.clamp(0.0, 1.0)).round() as usize;
    let held_out = if fraction > 0.0 && models.len() > 1 {
        share.max(1)
    } else {
        share
    };
    let mut is_held_out = vec![false; models.len()];
    is_held_out[..held_out].fill(true);
    is_held_out.shuffle(&mut stream(seed, Purpose::Split, 0));
    let (mut training, mut validation) = (Vec::new(), Vec::new());
    for (model, held_out) in models.into_iter().zip(is_held_out) {
        if held_out {
            &mut validation
        } else {
            &mut training
        }
        .push(model);
    }
    (training, validation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hdf5_pure::FileBuilder;

    /// A data directory with `clouds` tiny clouds of 4 points.
    fn directory(clouds: usize) -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("temporary directory");
        write(
            &dir.path().join("ply_data_train0.h5"),
            clouds,
            &[clouds as u64, 4, 3],
            |_| (),
        );
        std::fs::write(
            dir.path().join("train_files.txt"),
            "data/somewhere/ply_data_train0.h5\n\n",
        )
        .expect("write list");
        dir
    }

    fn write(path: &Path, clouds: usize, shape: &[u64], edit: impl Fn(&mut Vec<f32>)) {
        let count = shape.iter().product::<u64>() as usize;
        let mut values: Vec<f32> = (0..count).map(|i| (i as f32 * 0.37).sin()).collect();
        edit(&mut values);
        let labels: Vec<u8> = (0..clouds).map(|i| i as u8).collect();
        let mut file = FileBuilder::new();
        file.create_dataset("data")
            .with_f32_data(&values)
            .with_shape(shape)
            .with_shuffle()
            .with_deflate(4);
        file.create_dataset("label")
            .with_u8_data(&labels)
            .with_shape(&[clouds as u64, 1]);
        file.write(path).expect("write h5");
    }

    fn refused(dir: &Path, split: Split) -> String {
        load(dir, split).expect_err("must be refused").to_string()
    }

    #[test]
    fn reads_clouds_and_labels_through_a_prefixed_list() {
        let dir = directory(5);
        let models = load(dir.path(), Split::Train).expect("load");
        assert_eq!(models.len(), 5);
        assert_eq!(
            models.iter().map(|m| m.label).collect::<Vec<_>>(),
            [0, 1, 2, 3, 4]
        );
        assert_eq!(
            models[0].points[1],
            [3.0, 4.0, 5.0].map(|i: f32| (i * 0.37).sin())
        );
        let kept = categories(models, 1..3);
        assert_eq!(kept.iter().map(|m| m.label).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn what_is_missing_is_named() {
        let dir = directory(2);
        assert!(
            refused(&dir.path().join("nowhere"), Split::Train)
                .contains(super::super::MODELNET40_URL)
        );
        assert!(refused(dir.path(), Split::Test).contains("test_files.txt"));
        std::fs::write(dir.path().join("test_files.txt"), "\n \n").expect("write list");
        assert!(refused(dir.path(), Split::Test).contains("names no .h5"));
        std::fs::write(dir.path().join("test_files.txt"), "x/ply_data_test7.h5")
            .expect("write list");
        assert!(refused(dir.path(), Split::Test).contains("ply_data_test7.h5"));
    }

    #[test]
    fn wrong_datasets_say_what_is_there() {
        let dir = directory(2);
        let path = dir.path().join("ply_data_train0.h5");
        write(&path, 2, &[2, 4, 2], |_| ());
        let said = refused(dir.path(), Split::Train);
        assert!(
            said.contains("\"data\" is [2, 4, 2]") && said.contains("[N,2048,3]"),
            "{said}"
        );

        write(&path, 3, &[2, 4, 3], |_| ());
        let said = refused(dir.path(), Split::Train);
        assert!(
            said.contains("\"label\" has 3 entries where \"data\" has 2"),
            "{said}"
        );

        write(&path, 2, &[2, 4, 3], |values| values[12 + 5] = f32::NAN);
        let said = refused(dir.path(), Split::Train);
        assert!(said.contains("entry 1, point 1 is NaN"), "{said}");

        let mut file = FileBuilder::new();
        file.create_dataset("points").with_i32_data(&[1, 2, 3]);
        file.write(&path).expect("write h5");
        let said = refused(dir.path(), Split::Train);
        assert!(
            said.contains("no dataset \"data\"") && said.contains("points [3] i32"),
            "{said}"
        );

        let mut file = FileBuilder::new();
        file.create_dataset("data")
            .with_i32_data(&[0; 9])
            .with_shape(&[1, 3, 3]);
        file.write(&path).expect("write h5");
        assert!(refused(dir.path(), Split::Train).contains("i32, expected [N,2048,3] f32"));
    }

    #[test]
    fn every_cut_and_flip_is_an_error_or_other_numbers_but_never_a_panic() {
        let dir = directory(3);
        let path = dir.path().join("ply_data_train0.h5");
        let whole = std::fs::read(&path).expect("read back");
        for cut in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..cut]).expect("write cut");
            assert!(load(dir.path(), Split::Train).is_err(), "cut at {cut}");
        }
        for at in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[at] ^= 0xff;
            std::fs::write(&path, &flipped).expect("write flip");
            let _ = load(dir.path(), Split::Train);
        }
    }

    #[test]
    fn the_validation_split_is_seeded_disjoint_and_complete() {
        let models: Vec<Model> = (0..50)
            .map(|label| Model {
                points: Vec::new(),
                label,
            })
            .collect();
        let labels = |models: &[Model]| models.iter().map(|m| m.label).collect::<Vec<_>>();
        let (training, validation) = validation_split(models.clone(), 7, 0.1);
        assert_eq!((training.len(), validation.len()), (45, 5));
        let mut all = [labels(&training), labels(&validation)].concat();
        all.sort_unstable();
        assert_eq!(all, (0..50).collect::<Vec<_>>());
        assert_eq!(
            labels(&validation_split(models.clone(), 7, 0.1).1),
            labels(&validation)
        );
        assert_ne!(
            labels(&validation_split(models, 8, 0.1).1),
            labels(&validation)
        );
    }
}
