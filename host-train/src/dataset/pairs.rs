//! Pairs files: clouds to register and their true poses, in one HDF5 file.
//!
//! | dataset | shape, type | meaning |
//! |---|---|---|
//! | `source` | `[M,N,3]` f32 | observed clouds |
//! | `target` | `[M,N,3]` f32 | model clouds |
//! | `transform_gt` | `[M,3,4]` or `[M,4,4]` f32 | rows of `[R \| t]`, target_from_source |
//! | `raw` | `[M,K,3]` f32 | noise-free target; may be absent |
//! | `label` | `[M]` integer | category; may be absent |
//! | `view_point` | `[M,3]` f32 | where the sensor stood, in the source's frame and units, if the source is a view from one point, else three NaN; may be absent |
//!
//! Lengths are in radii of the target: its mean lies near the origin, its farthest point about 1 from there.

mod symmetries;

pub use symmetries::Symmetry;

use super::h5::H5File;
use super::{DatasetError, Point};
use crate::files;
use hdf5_pure::FileBuilder;
use reagent_core::cloud::LARGEST_COORDINATE;
use reagent_core::{Frame, Pose};
use std::path::Path;

const CLOUDS: &str = "[M,N,3] f32";
/// Farthest mean of a target from the origin, and its least and largest radius. Noise and few points move them a little.
const OFF_CENTRE: f32 = 0.5;
const RADII: std::ops::RangeInclusive<f32> = 0.5..=2.0;
const POSES: &str = "[M,3,4] or [M,4,4] f32";
const VIEW_POINTS: &str = "[M,3] f32";
/// View point of a source that is not a view from one point.
const NOWHERE: Point = [f32::NAN; 3];
/// Label of a pair of unknown category.
pub const NO_LABEL: i32 = -1;

/// One pair of clouds and its true pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Observed source, `[N]` points.
    pub source: Vec<Point>,
    /// Target, `[N']` points.
    pub target: Vec<Point>,
    /// Plain transform that registers the source: the true pose.
    pub target_from_source: Pose,
}

/// M pairs of clouds; every list has M entries.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PairSet {
    /// Observed clouds, `[M][N]` points.
    pub source: Vec<Vec<Point>>,
    /// Model clouds, `[M][N']` points.
    pub target: Vec<Vec<Point>>,
    /// True poses, plain rigid transforms of the source.
    pub target_from_source: Vec<Pose>,
    /// Noise-free targets, `[M][K]` points.
    pub raw: Option<Vec<Vec<Point>>>,
    /// Categories; [`NO_LABEL`] where the file has none.
    pub label: Vec<i32>,
    /// The objects' symmetries, if they are known, `[M]`.
    pub symmetries: Option<Vec<Symmetry>>,
    /// Where the sources were seen from, for those that are views from one point.
    pub seen: Vec<Option<Seen>>,
}

/// Where a source was seen from, and what else was seen, in the source's frame and units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Position of the sensor.
    pub view_point: Point,
    /// Points that it saw besides the source. Files do not hold them.
    pub background: Vec<Point>,
}

impl PairSet {
    /// Adds a pair with its noise-free target and its category. A set is either filled by this or loaded.
    pub fn push(&mut self, sample: Sample, raw: Vec<Point>, label: u32) {
        self.source.push(sample.source);
        self.target.push(sample.target);
        self.target_from_source.push(sample.target_from_source);
        self.raw.get_or_insert_default().push(raw);
        self.label.push(i32::try_from(label).unwrap_or(NO_LABEL));
        self.seen.push(None);
    }

    /// The same for a source that was seen from a point.
    pub fn push_view(&mut self, sample: Sample, raw: Vec<Point>, view_point: Point, label: u32) {
        self.push(sample, raw, label);
        self.seen.pop();
        self.seen.push(Some(Seen {
            view_point,
            background: Vec::new(),
        }));
    }

    /// Where the source of a pair was seen from, if that is known.
    pub fn seen(&self, index: usize) -> Option<&Seen> {
        self.seen.get(index)?.as_ref()
    }

    /// Whether all sources are views from known points.
    pub fn is_of_views(&self) -> bool {
        !self.seen.is_empty() && self.seen.iter().all(Option::is_some)
    }

    /// The pairs, without the noise-free clouds and other data that only metrics use.
    pub fn samples(&self) -> impl Iterator<Item = Sample> + '_ {
        let clouds = self.source.iter().zip(&self.target);
        clouds
            .zip(&self.target_from_source)
            .map(|((source, target), &target_from_source)| Sample {
                source: source.clone(),
                target: target.clone(),
                target_from_source,
            })
    }

    /// Adds all pairs of another set; both must have been filled by [`Self::push`].
    pub fn extend(&mut self, other: PairSet) {
        self.source.extend(other.source);
        self.target.extend(other.target);
        self.target_from_source.extend(other.target_from_source);
        if let Some(raw) = other.raw {
            self.raw.get_or_insert_default().extend(raw);
        }
        self.label.extend(other.label);
        self.symmetries = None;
        self.seen.extend(other.seen);
    }

    /// Reads and checks a pairs file: shapes, equal numbers of entries, finite points, normalised targets, rigid poses.
    pub fn load(path: &Path) -> Result<PairSet, DatasetError> {
        let file = H5File::open(path)?;
        let source = file.read_clouds("source", CLOUDS)?;
        let count = source.len();
        if count == 0 {
            return Err(DatasetError::NoPairs { path: path.into() });
        }
        let target = file.read_clouds("target", CLOUDS)?;
        file.same_count("target", target.len(), "source", count)?;
        normalised(&target, path, "target")?;
        let target_from_source = poses(&file, path, "transform_gt")?;
        file.same_count("transform_gt", target_from_source.len(), "source", count)?;
        let names = file.names()?;
        let has = |name: &str| names.iter().any(|n| n == name);
        let raw = if has("raw") {
            let raw = file.read_clouds("raw", "[M,K,3] f32")?;
            file.same_count("raw", raw.len(), "source", count)?;
            normalised(&raw, path, "raw")?;
            Some(raw)
        } else {
            None
        };
        let label = if has("label") {
            let labels = file.read_labels("label", count, "source")?;
            let narrow = |(entry, label)| {
                i32::try_from(label).map_err(|_| DatasetError::BadLabel {
                    path: path.into(),
                    dataset: "label".into(),
                    entry,
                    label,
                })
            };
            labels
                .into_iter()
                .enumerate()
                .map(narrow)
                .collect::<Result<_, _>>()?
        } else {
            vec![NO_LABEL; count]
        };
        let seen = if has("view_point") {
            seen(&file, path, count)?
        } else {
            vec![None; count]
        };
        Ok(PairSet {
            source,
            target,
            target_from_source,
            raw,
            label,
            symmetries: Symmetry::read_beside(path, count)?,
            seen,
        })
    }

    /// Writes a pairs file (shuffle and deflate). All clouds of one kind must have the same number of points.
    pub fn save(&self, path: &Path) -> Result<(), DatasetError> {
        let count = self.source.len();
        if count == 0 {
            return Err(DatasetError::NoPairs { path: path.into() });
        }
        let lengths = [
            ("target clouds", self.target.len()),
            ("poses", self.target_from_source.len()),
            ("raw clouds", self.raw.as_ref().map_or(count, Vec::len)),
            ("labels", self.label.len()),
            ("view points", self.seen.len()),
        ];
        if let Some(&(what, found)) = lengths.iter().find(|(_, found)| *found != count) {
            return Err(DatasetError::Lengths {
                what,
                found,
                expected: count,
            });
        }
        let mut file = FileBuilder::new();
        add_clouds(&mut file, "source", &self.source)?;
        add_clouds(&mut file, "target", &self.target)?;
        if let Some(raw) = &self.raw {
            add_clouds(&mut file, "raw", raw)?;
        }
        add_poses(&mut file, "transform_gt", &self.target_from_source);
        file.create_dataset("label")
            .with_i32_data(&self.label)
            .with_shape(&[count as u64]);
        if self.seen.iter().any(Option::is_some) {
            let point = |seen: &Option<Seen>| seen.as_ref().map_or(NOWHERE, |seen| seen.view_point);
            let points: Vec<f32> = self.seen.iter().flat_map(point).collect();
            file.create_dataset("view_point")
                .with_f32_data(&points)
                .with_shape(&[count as u64, 3]);
        }
        write(file, path)
    }
}

/// Writes one dataset `[M,3,4]` of poses for each name.
pub fn save_poses(path: &Path, sets: &[(String, Vec<Pose>)]) -> Result<(), DatasetError> {
    let mut file = FileBuilder::new();
    for (name, poses) in sets {
        add_poses(&mut file, name, poses);
    }
    write(file, path)
}

/// Reads a dataset `[M,3,4]` or `[M,4,4]` of rigid transforms.
pub fn load_poses(path: &Path, dataset: &str) -> Result<Vec<Pose>, DatasetError> {
    poses(&H5File::open(path)?, path, dataset)
}

/// Refuses targets in other units than their radii: they are registered as they are, and would fit nothing.
fn normalised(
    targets: &[Vec<Point>],
    path: &Path,
    dataset: &'static str,
) -> Result<(), DatasetError> {
    for (entry, target) in targets.iter().enumerate() {
        // Clouds without a frame are refused where they are registered.
        let Ok(Frame { centre, scale }) = Frame::of(target) else {
            continue;
        };
        let off_centre = centre.length();
        if off_centre > OFF_CENTRE || !RADII.contains(&scale) {
            return Err(DatasetError::NotNormalised {
                path: path.into(),
                dataset,
                entry,
                off_centre,
                radius: scale,
            });
        }
    }
    Ok(())
}

/// View points of the pairs; `None` for those that have none.
fn seen(file: &H5File, path: &Path, count: usize) -> Result<Vec<Option<Seen>>, DatasetError> {
    let (shape, values) = file.read_f32("view_point", 2, VIEW_POINTS)?;
    if shape[1] != 3 {
        return Err(DatasetError::WrongDataset {
            path: path.into(),
            dataset: "view_point".into(),
            expected: VIEW_POINTS,
            found: format!("{shape:?}"),
        });
    }
    file.same_count("view_point", shape[0], "source", count)?;
    let (points, _) = values.as_chunks::<3>();
    let checked = points.iter().enumerate().map(|(entry, &view_point)| {
        if view_point.iter().all(|x| x.is_nan()) {
            Ok(None)
        } else if view_point.iter().all(|x| x.abs() <= LARGEST_COORDINATE) {
            let background = Vec::new();
            Ok(Some(Seen {
                view_point,
                background,
            }))
        } else {
            Err(DatasetError::BadViewPoint {
                path: path.into(),
                entry,
            })
        }
    });
    checked.collect()
}

fn poses(file: &H5File, path: &Path, name: &str) -> Result<Vec<Pose>, DatasetError> {
    let (shape, values) = file.read_f32(name, 3, POSES)?;
    let homogeneous = shape[1..] == [4, 4];
    if shape[1..] != [3, 4] && !homogeneous {
        return Err(DatasetError::WrongDataset {
            path: path.into(),
            dataset: name.into(),
            expected: POSES,
            found: format!("{shape:?}"),
        });
    }
    let (rows, _) = values.as_chunks::<4>();
    let matrices = rows.chunks_exact(shape[1]);
    let checked = matrices.enumerate().map(|(entry, matrix)| {
        let pose = match *matrix {
            [a, b, c] | [a, b, c, [0.0, 0.0, 0.0, 1.0]] => {
                Pose::from_rows([a, b, c]).checked().ok()
            }
            _ => None,
        };
        pose.ok_or_else(|| DatasetError::NotRigid {
            path: path.into(),
            dataset: name.into(),
            entry,
        })
    });
    checked.collect()
}

fn add_clouds(
    file: &mut FileBuilder,
    name: &'static str,
    clouds: &[Vec<Point>],
) -> Result<(), DatasetError> {
    let expected = clouds.first().map_or(0, Vec::len);
    if let Some(entry) = clouds.iter().position(|cloud| cloud.len() != expected) {
        return Err(DatasetError::Ragged {
            what: name,
            entry,
            found: clouds[entry].len(),
            expected,
        });
    }
    let values: Vec<f32> = clouds.iter().flatten().flatten().copied().collect();
    file.create_dataset(name)
        .with_f32_data(&values)
        .with_shape(&[clouds.len() as u64, expected as u64, 3])
        // One chunk for a coordinate of a few clouds, so that shuffled bytes of similar values lie together.
        .with_chunks(&[clouds.len().min(8) as u64, expected.max(1) as u64, 1])
        .with_shuffle()
        .with_deflate(6);
    Ok(())
}

fn add_poses(file: &mut FileBuilder, name: &str, poses: &[Pose]) {
    let values: Vec<f32> = poses.iter().flat_map(Pose::to_rows).flatten().collect();
    file.create_dataset(name)
        .with_f32_data(&values)
        .with_shape(&[poses.len() as u64, 3, 4]);
}

fn write(file: FileBuilder, path: &Path) -> Result<(), DatasetError> {
    let bytes = file.finish().map_err(|e| DatasetError::Write {
        path: path.into(),
        reason: e.to_string(),
    })?;
    files::write(path, &bytes).map_err(|source| DatasetError::Io {
        path: path.into(),
        source,
    })
}

#[cfg(test)]
mod tests;
