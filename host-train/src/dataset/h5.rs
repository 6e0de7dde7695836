//! Reading and writing of numeric HDF5 datasets, with errors that say what is where.

use super::{DatasetError, MAX_BYTES, Point};
use hdf5_pure::{DType, Dataset, File};
use std::path::{Path, PathBuf};

/// Largest ratio of a dataset's bytes to the file's. Coordinates of real clouds compress two- or threefold, so a
/// larger claim is a corrupt header.
const MAX_EXPANSION: u64 = 32;

/// An open HDF5 file. Only the datasets that are asked for are read and decoded.
pub struct H5File {
    path: PathBuf,
    bytes: u64,
    file: File,
}

impl H5File {
    /// Opens `path` for reading.
    pub fn open(path: &Path) -> Result<H5File, DatasetError> {
        if !path.is_file() {
            return Err(DatasetError::NoFile { path: path.into() });
        }
        let io = |source| DatasetError::Io {
            path: path.into(),
            source,
        };
        let bytes = std::fs::metadata(path).map_err(io)?.len();
        std::fs::File::open(path).map_err(io)?;
        let file = File::open_streaming(path).map_err(|e| DatasetError::Corrupt {
            path: path.into(),
            reason: e.to_string(),
        })?;
        Ok(H5File {
            path: path.into(),
            bytes,
            file,
        })
    }

    /// Names of the datasets at the file's root.
    pub fn names(&self) -> Result<Vec<String>, DatasetError> {
        self.file.root().datasets().map_err(|e| self.corrupt(e))
    }

    /// A floating-point dataset of the given rank as `(shape, row-major values)`. Errors say that `expected` was
    /// expected. Values are not checked.
    pub fn read_f32(
        &self,
        name: &str,
        rank: usize,
        expected: &'static str,
    ) -> Result<(Vec<usize>, Vec<f32>), DatasetError> {
        let (dataset, shape) = self.find(name, expected)?;
        let dtype = dataset.dtype().map_err(|e| self.corrupt(e))?;
        if shape.len() != rank || !matches!(dtype, DType::F32 | DType::F64) {
            return Err(self.wrong(name, expected, &dataset));
        }
        let values = dataset.read_f32().map_err(|e| self.corrupt(e))?;
        self.complete(name, &shape, values.len())?;
        Ok((shape, values))
    }

    /// An integer dataset (any width, signed or not) as `(shape, row-major values)`.
    pub fn read_i64(
        &self,
        name: &str,
        expected: &'static str,
    ) -> Result<(Vec<usize>, Vec<i64>), DatasetError> {
        use DType::{I8, I16, I32, I64, U8, U16, U32, U64};
        let (dataset, shape) = self.find(name, expected)?;
        let dtype = dataset.dtype().map_err(|e| self.corrupt(e))?;
        if !matches!(dtype, I8 | I16 | I32 | I64 | U8 | U16 | U32 | U64) {
            return Err(self.wrong(name, expected, &dataset));
        }
        let values = dataset.read_i64().map_err(|e| self.corrupt(e))?;
        self.complete(name, &shape, values.len())?;
        Ok((shape, values))
    }

    /// Clouds `[N,P,3]` with `P >= 3`; every coordinate is checked to be finite.
    pub fn read_clouds(
        &self,
        name: &str,
        expected: &'static str,
    ) -> Result<Vec<Vec<Point>>, DatasetError> {
        let (shape, values) = self.read_f32(name, 3, expected)?;
        if shape[1] < 3 || shape[2] != 3 {
            return Err(DatasetError::WrongDataset {
                path: self.path.clone(),
                dataset: name.into(),
                expected,
                found: format!("{shape:?}"),
            });
        }
        let (points, _) = values.as_chunks::<3>();
        let clouds = points
            .chunks_exact(shape[1])
            .enumerate()
            .map(|(entry, cloud)| {
                match cloud.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
                    None => Ok(cloud.to_vec()),
                    Some(point) => Err(DatasetError::NotFinite {
                        path: self.path.clone(),
                        dataset: name.into(),
                        entry,
                        point,
                    }),
                }
            });
        clouds.collect()
    }

    /// Labels `[N]` or `[N,1]` of any integer type; there must be `count` of them.
    pub fn read_labels(
        &self,
        name: &str,
        count: usize,
        of: &str,
    ) -> Result<Vec<i64>, DatasetError> {
        let (shape, values) = self.read_i64(name, "[N,1] or [N], integer")?;
        if !matches!(shape[..], [_] | [_, 1]) {
            return Err(DatasetError::WrongDataset {
                path: self.path.clone(),
                dataset: name.into(),
                expected: "[N,1] or [N], integer",
                found: format!("{shape:?}"),
            });
        }
        self.same_count(name, values.len(), of, count)?;
        Ok(values)
    }

    /// Refuses a dataset whose number of entries differs from that of another.
    pub fn same_count(
        &self,
        name: &str,
        found: usize,
        of: &str,
        expected: usize,
    ) -> Result<(), DatasetError> {
        if found == expected {
            return Ok(());
        }
        Err(DatasetError::Count {
            path: self.path.clone(),
            dataset: name.into(),
            found,
            other: of.into(),
            expected,
        })
    }

    fn find(
        &self,
        name: &str,
        expected: &'static str,
    ) -> Result<(Dataset, Vec<usize>), DatasetError> {
        if !self.names()?.iter().any(|n| n == name) {
            return Err(DatasetError::NoDataset {
                path: self.path.clone(),
                dataset: name.into(),
                expected,
                found: self.contents(),
            });
        }
        let dataset = self.file.dataset(name).map_err(|e| self.corrupt(e))?;
        let shape = dataset.shape().map_err(|e| self.corrupt(e))?;
        let elements = shape.iter().fold(1u64, |n, &d| n.saturating_mul(d));
        let bytes = elements.saturating_mul(size_of::<f32>() as u64);
        if bytes > self.bytes.saturating_mul(MAX_EXPANSION) {
            return Err(DatasetError::TooLarge {
                path: self.path.clone(),
                dataset: name.into(),
                elements,
            });
        }
        if bytes > MAX_BYTES {
            return Err(DatasetError::BeyondMemory {
                path: self.path.clone(),
            });
        }
        let shape = shape.iter().map(|&d| d as usize).collect();
        Ok((dataset, shape))
    }

    fn complete(&self, name: &str, shape: &[usize], found: usize) -> Result<(), DatasetError> {
        let expected: usize = shape.iter().product();
        if found == expected {
            return Ok(());
        }
        Err(self.corrupt(format!(
            "dataset \"{name}\": {found} of {expected} elements"
        )))
    }

    fn contents(&self) -> String {
        let names = self.names().unwrap_or_default();
        let describe = |name: &String| match self.file.dataset(name) {
            Ok(dataset) => format!("{name} {}", description(&dataset)),
            Err(_) => name.clone(),
        };
        let parts: Vec<String> = names.iter().take(16).map(describe).collect();
        if parts.is_empty() {
            "nothing".into()
        } else {
            parts.join(", ")
        }
    }

    fn wrong(&self, name: &str, expected: &'static str, dataset: &Dataset) -> DatasetError {
        DatasetError::WrongDataset {
            path: self.path.clone(),
            dataset: name.into(),
            expected,
            found: description(dataset),
        }
    }

    fn corrupt(&self, reason: impl ToString) -> DatasetError {
        DatasetError::Corrupt {
            path: self.path.clone(),
            reason: reason.to_string(),
        }
    }
}

fn description(dataset: &Dataset) -> String {
    let shape = dataset
        .shape()
        .map_or_else(|_| "?".into(), |s| format!("{s:?}"));
    let dtype = dataset
        .dtype()
        .map_or_else(|_| "?".into(), |t| t.to_string());
    format!("{shape} {dtype}")
}
