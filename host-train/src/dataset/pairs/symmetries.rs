//! What looks like the true poses: the list in FILE.json beside FILE.h5.

use crate::dataset::DatasetError;
use crate::files;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Symmetry of an object: an entry of the list in FILE.json beside FILE.h5.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Symmetry {
    /// Poses that look like the true one, itself included, plain transforms of the source, `[3][4]`.
    pub truths: Vec<[[f32; 4]; 3]>,
    /// Whether the object has a symmetry, so that the distance to the closest point counts (ADI).
    pub sym: bool,
}

impl Symmetry {
    /// Where the symmetries of a pairs file are listed.
    pub fn list_beside(pairs: &Path) -> PathBuf {
        pairs.with_extension("json")
    }

    /// Reads them; `None` if there is no such file, or it holds another JSON document than a list.
    pub(super) fn read_beside(
        pairs: &Path,
        count: usize,
    ) -> Result<Option<Vec<Symmetry>>, DatasetError> {
        let path = Symmetry::list_beside(pairs);
        if !path.exists() {
            return Ok(None);
        }
        let text = std::fs::read(&path).map_err(|source| DatasetError::Io {
            path: path.clone(),
            source,
        })?;
        if text.trim_ascii_start().first() != Some(&b'[') {
            return Ok(None);
        }
        let refused = |reason| DatasetError::Symmetries {
            path: path.clone(),
            reason,
        };
        let found: Vec<Symmetry> =
            serde_json::from_slice(&text).map_err(|error| refused(error.to_string()))?;
        if found.len() != count {
            let entries = found.len();
            return Err(refused(format!(
                "it has {entries} entries for {count} pairs"
            )));
        }
        Ok(Some(found))
    }

    /// Refuses outputs that would replace the list beside a pairs file.
    ///
    /// # Errors
    /// [`DatasetError::OverSymmetries`].
    pub fn keep_beside<'a>(
        pairs: &Path,
        outputs: impl IntoIterator<Item = &'a Option<PathBuf>>,
    ) -> Result<(), DatasetError> {
        let list = Symmetry::list_beside(pairs);
        let place = |path: &Path| files::place(path).ok().flatten();
        let kept = place(&list);
        let mut outputs = outputs.into_iter().flatten();
        match outputs.any(|path| kept.is_some() && place(path) == kept) {
            true => Err(DatasetError::OverSymmetries { path: list }),
            false => Ok(()),
        }
    }
}
