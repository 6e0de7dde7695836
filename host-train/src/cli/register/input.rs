//! A file and the cloud that is registered from it.

use crate::dataset::cloud_file::{CloudError, CloudFile, MAX_COORDINATE, read_file};
use crate::register::prepared::Prepared;
use anyhow::bail;
use std::path::Path;
use std::str::FromStr;

/// One of the two clouds.
#[derive(Debug)]
pub struct Input {
    /// The file's contents, scaled; `--out` writes all of them.
    pub file: CloudFile,
    /// The cloud that is registered.
    pub cloud: Prepared<'static>,
}

impl Input {
    /// Reads a file. The seed decides which points of a mesh's surface are drawn.
    ///
    /// # Errors
    /// A file that cannot be read, and clouds that the core refuses.
    pub fn read(
        path: &Path,
        scale: f64,
        points: Option<usize>,
        seed: u64,
    ) -> Result<Input, CloudError> {
        Input::of(read_file(path)?, path, scale, (points, seed))
    }

    /// The same for contents that were read already, from `path`.
    pub(in crate::cli) fn of(
        mut file: CloudFile,
        path: &Path,
        scale: f64,
        (points, seed): (Option<usize>, u64),
    ) -> Result<Input, CloudError> {
        for x in file.points.iter_mut().flatten() {
            *x *= scale;
        }
        if file
            .points
            .iter()
            .flatten()
            .any(|x| x.abs() > MAX_COORDINATE)
        {
            return Err(CloudError::Scaled {
                path: path.into(),
                scale,
            });
        }
        let cloud = Prepared::of_file(&file, path, points, seed)?;
        Ok(Input { file, cloud })
    }
}

/// Units of length, the source's and the target's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// Source unit, in target units.
    pub scale: f64,
}

impl FromStr for Units {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Units> {
        let metres = |name: &str| {
            Ok(match name {
                "mm" => 1e-3,
                "cm" => 1e-2,
                "m" => 1.0,
                "in" => 0.0254,
                "ft" => 0.3048,
                _ => bail!("\"{name}\" is no unit; give mm, cm, m, in or ft"),
            })
        };
        let (source, target) = text.split_once(':').unwrap_or((text, "m"));
        Ok(Units {
            scale: metres(source)? / metres(target)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::cloud_file::Note;

    #[test]
    fn units_name_a_scale() {
        let scale = |text: &str| text.parse::<Units>().expect("units").scale;
        assert_eq!(
            (scale("mm"), scale("ft:m"), scale("m:m")),
            (1e-3, 0.3048, 1.0)
        );
        assert!((scale("in:mm") - 25.4).abs() < 1e-12);
        assert!("inch".parse::<Units>().is_err() && "mm:".parse::<Units>().is_err());
    }

    #[test]
    fn clouds_are_scaled_shifted_and_thinned() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("c.xyz");
        let row = |i: usize| format!("{} {} 7\n", 5e6 + i as f64 * 1e-3, i % 7);
        std::fs::write(&path, (0..5000).map(row).collect::<String>()).expect("written");
        let input = Input::read(&path, 1.0, None, 1).expect("read");
        assert_eq!(
            (input.cloud.points().len(), input.cloud.all.len()),
            (2048, 5000)
        );
        let origin = input.cloud.origin;
        assert!((origin[0] - 5e6 - 2.5).abs() < 1e-9);
        let notes = [
            Note::Shifted { origin },
            Note::Thinned {
                from: 5000,
                to: 2048,
            },
        ];
        assert_eq!(input.cloud.notes, notes);
        let scaled = Input::read(&path, 0.5, Some(100), 1).expect("read");
        assert_eq!(
            (scaled.cloud.points().len(), scaled.file.points[0]),
            (100, [2.5e6, 0.0, 3.5])
        );
        let said = Input::read(&path, 1e7, None, 1)
            .expect_err("too large")
            .to_string();
        assert!(
            said.ends_with("c.xyz: multiplied by 10000000, coordinates are beyond 1e12"),
            "{said}"
        );
    }
}
