//! What can be wrong with a data set on disk.

use super::Split;
use super::cloud_file::CloudError;
use std::path::PathBuf;

/// Where the reference data set is published.
pub const MODELNET40_URL: &str =
    "https://shapenet.cs.stanford.edu/media/modelnet40_ply_hdf5_2048.zip";

/// Why a data set or a pairs file was refused: what, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The data directory does not exist.
    #[error(
        "no data directory {}; unpack {MODELNET40_URL} there, name another, or use the built-in data set (--data procedural)",
        dir.display()
    )]
    NoDirectory {
        /// Directory that was asked for.
        dir: PathBuf,
    },
    /// The directory has no list of `.h5` files for the split.
    #[error(
        "{} is missing: the directory does not have the modelnet40_ply_hdf5_2048 layout ({MODELNET40_URL})",
        list.display()
    )]
    NoList {
        /// List file that was looked for.
        list: PathBuf,
    },
    /// The list of `.h5` files is empty.
    #[error("{} names no .h5 file; unpack the data set again", list.display())]
    EmptyList {
        /// The list.
        list: PathBuf,
    },
    /// A directory holds nothing that is read.
    #[error(
        "{}: no data set: neither train_files.txt and test_files.txt (modelnet40_ply_hdf5_2048, {MODELNET40_URL}), nor \
         training_objectdataset.h5 and test_objectdataset.h5 (ScanObjectNN), nor .off .ply .obj .stl .pcd .xyz .npy .mcap files",
        dir.display()
    )]
    NoModels {
        /// Directory that was searched.
        dir: PathBuf,
    },
    /// A tree of loose files is divided, but has none in one of the splits.
    #[error("{}: of its {files} files none is of the {split} split; put some under {split}/", dir.display())]
    EmptySplit {
        /// Directory that was searched.
        dir: PathBuf,
        /// The split.
        split: Split,
        /// Number of files in the other split.
        files: usize,
    },
    /// A loose file was refused.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// The clouds would take too much memory.
    #[error("{}: its clouds would take more than 8 GiB of memory; use a part of it", path.display())]
    BeyondMemory {
        /// File or directory concerned.
        path: PathBuf,
    },
    /// A file does not exist.
    #[error("no file {}; check the path, or unpack the data set again", path.display())]
    NoFile {
        /// File that was asked for.
        path: PathBuf,
    },
    /// The operating system refused to read or write.
    #[error("{}: {source}", path.display())]
    Io {
        /// File concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not HDF5, is truncated or is corrupt.
    #[error("{}: not a readable HDF5 file ({reason}); it may be truncated, fetch it again", path.display())]
    Corrupt {
        /// File concerned.
        path: PathBuf,
        /// What the HDF5 reader said.
        reason: String,
    },
    /// The file could not be written.
    #[error("{}: cannot write HDF5 ({reason})", path.display())]
    Write {
        /// File concerned.
        path: PathBuf,
        /// What the HDF5 writer said.
        reason: String,
    },
    /// A dataset is not in the file.
    #[error("{}: no dataset \"{dataset}\" ({expected}); the file holds: {found}", path.display())]
    NoDataset {
        /// File concerned.
        path: PathBuf,
        /// Dataset that was looked for.
        dataset: String,
        /// Shape and type it should have.
        expected: &'static str,
        /// Datasets of the file, with shapes.
        found: String,
    },
    /// A dataset has another shape or element type.
    #[error("{}: dataset \"{dataset}\" is {found}, expected {expected}", path.display())]
    WrongDataset {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: String,
        /// Shape and type it should have.
        expected: &'static str,
        /// Shape and type it has.
        found: String,
    },
    /// A dataset claims more elements than the file can hold.
    #[error("{}: dataset \"{dataset}\" claims {elements} elements, more than the file can hold; fetch it again", path.display())]
    TooLarge {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: String,
        /// Claimed number of elements.
        elements: u64,
    },
    /// Two datasets of one file disagree in their number of entries.
    #[error("{}: dataset \"{dataset}\" has {found} entries where \"{other}\" has {expected}", path.display())]
    Count {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: String,
        /// Its number of entries.
        found: usize,
        /// Dataset it is compared with.
        other: String,
        /// Number of entries there.
        expected: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("{}: dataset \"{dataset}\", entry {entry}, point {point} is NaN or infinite", path.display())]
    NotFinite {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: String,
        /// Index of the cloud.
        entry: usize,
        /// Index of the point in the cloud.
        point: usize,
    },
    /// A label is negative or does not fit.
    #[error("{}: dataset \"{dataset}\", entry {entry}: label {label} is not a category index", path.display())]
    BadLabel {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: String,
        /// Index of the cloud.
        entry: usize,
        /// The label.
        label: i64,
    },
    /// A pairs file without pairs.
    #[error("{}: there are no pairs", path.display())]
    NoPairs {
        /// File concerned.
        path: PathBuf,
    },
    /// A target, with or without its noise, is not in units of its radius.
    #[error(
        "{}: \"{dataset}\" of pair {entry} has radius {radius:.3}, and its mean is {off_centre:.3} from the origin, but lengths must be in radii \
         of the target: subtract its mean from target, raw and the translation, then divide these, source and view_point by its radius",
        path.display()
    )]
    NotNormalised {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: &'static str,
        /// Index of the pair.
        entry: usize,
        /// Distance of the target's mean from the origin.
        off_centre: f32,
        /// Distance of its farthest point from its mean.
        radius: f32,
    },
    /// The list of symmetries beside the pairs cannot be used.
    #[error("{}: not the symmetries of the pairs beside it: {reason}; mend the list, or move it away", path.display())]
    Symmetries {
        /// The list.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// An output would replace the list of symmetries.
    #[error("{}: lists the symmetries of the pairs beside it; write to another file", path.display())]
    OverSymmetries {
        /// The list.
        path: PathBuf,
    },
    /// A pose is not a finite rigid transform.
    #[error("{}: dataset \"{dataset}\", entry {entry} is not a finite rigid transform [R | t]", path.display())]
    NotRigid {
        /// File concerned.
        path: PathBuf,
        /// Dataset concerned.
        dataset: String,
        /// Index of the pose.
        entry: usize,
    },
    /// A view point is neither a finite point nor marked as absent.
    #[error(
        "{}: dataset \"view_point\", entry {entry} is no point: give three numbers up to 1e12, or three NaN for a source that is no view from one point",
        path.display()
    )]
    BadViewPoint {
        /// File concerned.
        path: PathBuf,
        /// Index of the view point.
        entry: usize,
    },
    /// Two clouds to be written into one dataset differ in their number of points.
    #[error("cannot save pairs: {what} {entry} has {found} points where the first has {expected}")]
    Ragged {
        /// Which clouds.
        what: &'static str,
        /// Index of the cloud.
        entry: usize,
        /// Its number of points.
        found: usize,
        /// Number of points of the first cloud.
        expected: usize,
    },
    /// Two lists to be written have different lengths.
    #[error("cannot save pairs: {found} {what} for {expected} source clouds")]
    Lengths {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Number of source clouds.
        expected: usize,
    },
}
