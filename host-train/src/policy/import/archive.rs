//! Tensors of a `torch.save` archive: a ZIP of `data.pkl` and one file of raw numbers for each storage.

use super::pickle::{Id, Pickle, Value};
use super::{ImportError, Tensor};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// A state dict's pickle is a few KiB; the optimiser's adds little.
const MAX_PICKLE: u64 = 16 << 20;
/// The whole network is 10.6 MB.
const MAX_STORAGE: u64 = 256 << 20;

/// An open checkpoint: the names of its tensors, and access to each of them.
pub(super) struct Archive {
    path: PathBuf,
    zip: ZipArchive<BufReader<File>>,
    /// Folder inside the archive, with its slash.
    prefix: String,
    pickle: Pickle,
    /// Name and value of each entry of the state dict.
    pub(super) entries: Vec<(String, Id)>,
}

impl Archive {
    /// Opens a checkpoint that is a state dict or holds one under `model_state_dict`.
    pub(super) fn open(path: &Path) -> Result<Archive, ImportError> {
        let file = File::open(path).map_err(|source| ImportError::Io {
            path: path.into(),
            source,
        })?;
        let mut reader = BufReader::new(file);
        let mut magic = [0u8; 4];
        if reader.read_exact(&mut magic).is_err() || magic != *b"PK\x03\x04" {
            return Err(ImportError::NotArchive { path: path.into() });
        }
        let broken = |reason: String| ImportError::Broken {
            path: path.into(),
            reason,
        };
        let mut zip = ZipArchive::new(reader).map_err(|e| broken(e.to_string()))?;
        let is_pickle = |name: &&str| {
            name.strip_suffix("data.pkl")
                .is_some_and(|p| p.is_empty() || p.ends_with('/'))
        };
        let names: Vec<String> = zip
            .file_names()
            .filter_map(Result::ok)
            .map(Into::into)
            .collect();
        let Some(name) = names.iter().map(String::as_str).find(is_pickle) else {
            return Err(broken("it has no data.pkl".into()));
        };
        let prefix = name.trim_end_matches("data.pkl").to_owned();
        if let Ok(order) = read(&mut zip, &format!("{prefix}byteorder"), 16)
            && order != b"little"
        {
            return Err(broken(
                "its numbers are big-endian; save it again on a little-endian machine".into(),
            ));
        }
        let bytes = read(&mut zip, name, MAX_PICKLE).map_err(broken)?;
        let pickle = Pickle::parse(&bytes).map_err(broken)?;
        let entries =
            state_dict(&pickle).ok_or_else(|| ImportError::NoStateDict { path: path.into() })?;
        Ok(Archive {
            path: path.into(),
            zip,
            prefix,
            pickle,
            entries,
        })
    }

    /// The tensor behind an entry of the state dict, contiguous and row-major.
    pub(super) fn tensor(&mut self, name: &str, id: Id) -> Result<Tensor, ImportError> {
        let bad = |reason: String| ImportError::BadTensor {
            path: self.path.clone(),
            name: name.into(),
            reason,
        };
        let layout = Layout::of(&self.pickle, id).map_err(bad)?;
        let entry = format!("{}data/{}", self.prefix, layout.storage);
        let bytes = read(&mut self.zip, &entry, MAX_STORAGE).map_err(bad)?;
        let (numbers, _) = bytes.as_chunks::<4>();
        let data = layout.gather(numbers).map_err(bad)?;
        Ok(Tensor {
            shape: layout.shape,
            data,
        })
    }
}

/// Reads one entry of at most `limit` bytes, whatever size the archive claims.
fn read(zip: &mut ZipArchive<BufReader<File>>, name: &str, limit: u64) -> Result<Vec<u8>, String> {
    let entry = zip.by_name(name).map_err(|e| format!("{name}: {e}"))?;
    let mut bytes = Vec::new();
    entry
        .take(limit + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| format!("{name}: {e}"))?;
    if bytes.len() as u64 > limit {
        return Err(format!("{name} is larger than {limit} bytes"));
    }
    Ok(bytes)
}

fn state_dict(pickle: &Pickle) -> Option<Vec<(String, Id)>> {
    let entries = |value: &Value| match value {
        Value::Dict(pairs) => pairs
            .iter()
            .map(|&(key, value)| match pickle.get(key) {
                Value::Text(text) => Some((text.clone(), value)),
                _ => None,
            })
            .collect::<Option<Vec<_>>>(),
        _ => None,
    };
    let outer = entries(pickle.root())?;
    match outer.iter().find(|(name, _)| name == "model_state_dict") {
        Some(&(_, inner)) => entries(pickle.get(inner)),
        None => Some(outer),
    }
}

/// Place of a tensor's numbers in a storage.
struct Layout {
    storage: String,
    numbers: usize,
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl Layout {
    /// Reads `_rebuild_tensor_v2(storage, offset, shape, strides, …)`, possibly wrapped in
    /// `_rebuild_parameter(tensor, …)`.
    fn of(pickle: &Pickle, mut id: Id) -> Result<Layout, String> {
        let sequence = |id: Id| match pickle.get(id) {
            Value::Sequence(items) => items.as_slice(),
            _ => &[],
        };
        let size = |id: Id| match pickle.get(id) {
            Value::Int(n) => usize::try_from(*n).map_err(|_| format!("a size of {n}")),
            _ => Err("a size that is not a number".to_owned()),
        };
        let call = |id: Id| match pickle.get(id) {
            &Value::Call(callable, arguments) => match pickle.get(callable) {
                Value::Global(name) => Some((name.as_str(), sequence(arguments))),
                _ => None,
            },
            _ => None,
        };
        if let Some(("torch._utils._rebuild_parameter", [tensor, ..])) = call(id) {
            id = *tensor;
        }
        let Some(("torch._utils._rebuild_tensor_v2", &[storage, offset, shape, strides, ..])) =
            call(id)
        else {
            return Err("it is not a dense tensor".into());
        };
        let &Value::Persistent(storage) = pickle.get(storage) else {
            return Err("its storage is not a persistent id".into());
        };
        let &[_, kind, key, _, numbers] = sequence(storage) else {
            return Err("its storage has another form than torch writes".into());
        };
        match pickle.get(kind) {
            Value::Global(kind) if kind == "torch.FloatStorage" => {}
            Value::Global(kind) => return Err(format!("its numbers are {kind}; only f32 is read")),
            _ => return Err("its storage has no type".into()),
        }
        let Value::Text(key) = pickle.get(key) else {
            return Err("its storage has no name".into());
        };
        let sizes = |id: Id| {
            sequence(id)
                .iter()
                .map(|&item| size(item))
                .collect::<Result<Vec<_>, _>>()
        };
        let layout = Layout {
            storage: key.clone(),
            numbers: size(numbers)?,
            offset: size(offset)?,
            shape: sizes(shape)?,
            strides: sizes(strides)?,
        };
        layout.check()
    }

    /// Checks that all elements lie in the storage, and that there are no more of them than it has.
    fn check(self) -> Result<Layout, String> {
        if self.shape.len() != self.strides.len() || self.shape.len() > 8 {
            return Err(format!(
                "shape {:?} with strides {:?}",
                self.shape, self.strides
            ));
        }
        let elements = self.shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
        let last = self
            .shape
            .iter()
            .zip(&self.strides)
            .try_fold(self.offset, |at, (&d, &stride)| {
                at.checked_add(stride.checked_mul(d.saturating_sub(1))?)
            });
        let fits = matches!((elements, last), (Some(n), Some(last)) if n == 0 || (n <= self.numbers && last < self.numbers));
        if fits {
            Ok(self)
        } else {
            Err(format!(
                "shape {:?} (strides {:?}, offset {}) does not fit its storage of {} numbers",
                self.shape, self.strides, self.offset, self.numbers
            ))
        }
    }

    fn gather(&self, numbers: &[[u8; 4]]) -> Result<Vec<f32>, String> {
        if numbers.len() < self.numbers {
            return Err(format!(
                "its storage is cut off: {} of {} numbers",
                numbers.len(),
                self.numbers
            ));
        }
        let elements = self.shape.iter().product();
        let mut index = vec![0usize; self.shape.len()];
        let mut data = Vec::with_capacity(elements);
        for _ in 0..elements {
            let at: usize = index
                .iter()
                .zip(&self.strides)
                .map(|(i, stride)| i * stride)
                .sum();
            data.push(f32::from_le_bytes(numbers[self.offset + at]));
            // Counts up with the last axis fastest.
            for (i, &size) in index.iter_mut().zip(&self.shape).rev() {
                *i += 1;
                if *i < size {
                    break;
                }
                *i = 0;
            }
        }
        Ok(data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(offset: usize, shape: &[usize], strides: &[usize]) -> Result<Layout, String> {
        Layout {
            storage: "0".into(),
            numbers: 12,
            offset,
            shape: shape.into(),
            strides: strides.into(),
        }
        .check()
    }

    fn numbers() -> Vec<[u8; 4]> {
        (0..12).map(|i| (i as f32).to_le_bytes()).collect()
    }

    #[test]
    fn offsets_and_strides_are_honoured() {
        let gather = |layout: Result<Layout, String>| {
            layout.and_then(|l| l.gather(&numbers())).expect("fits")
        };
        assert_eq!(
            gather(layout(0, &[3, 2], &[1, 3])),
            [0., 3., 1., 4., 2., 5.]
        );
        assert_eq!(
            gather(layout(6, &[2, 3], &[3, 1])),
            [6., 7., 8., 9., 10., 11.]
        );
        assert_eq!(gather(layout(5, &[], &[])), [5.]);
        assert!(gather(layout(0, &[0, 4], &[4, 1])).is_empty());
    }

    #[test]
    fn what_lies_outside_the_storage_is_refused() {
        assert!(layout(7, &[2, 3], &[3, 1]).is_err());
        assert!(layout(0, &[2], &[1, 1]).is_err());
        assert!(layout(0, &[100_000, 100_000], &[0, 0]).is_err());
        assert!(layout(0, &[usize::MAX, 2], &[1, 1]).is_err());
        assert!(layout(1, &[2], &[usize::MAX]).is_err());
        let cut = layout(0, &[3, 4], &[4, 1]).and_then(|l| l.gather(&numbers()[..5]));
        assert!(cut.is_err_and(|e| e.contains("5 of 12")));
    }
}
