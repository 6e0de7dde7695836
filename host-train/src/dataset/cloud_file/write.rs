//! Writing clouds and meshes.

use super::extent::would_be_far;
use super::{CloudError, CloudFile, STANDARD, extension, npy, obj, off, pcd, ply, stl, table};
use crate::files;
use crate::pose64::Position;
use std::path::Path;

/// Refuses a path that [`write_cloud`] could not write for its extension.
pub fn check_output(path: &Path) -> Result<(), CloudError> {
    match extension(path).as_str() {
        "ply" | "pcd" | "xyz" | "npy" | "obj" | "off" | "stl" => Ok(()),
        _ if path == Path::new(STANDARD) || files::is_special(path) => Ok(()),
        _ => Err(CloudError::OutputExtension { path: path.into() }),
    }
}

/// Refuses a cloud without faces where the path's extension is one of meshes.
pub fn check_cloud(path: &Path, file: &CloudFile) -> Result<(), CloudError> {
    match extension(path).as_str() {
        "obj" | "off" | "stl" if file.faces.is_none() => {
            Err(CloudError::NoFaces { path: path.into() })
        }
        _ => Ok(()),
    }
}

/// Refuses a mesh for `.stl` that would lie far from the origin once its middle is there.
///
/// # Errors
/// [`CloudError::Rounded`].
pub fn check_place(path: &Path, file: &CloudFile, middle: Position) -> Result<(), CloudError> {
    let points = file.points.iter().copied();
    match extension(path) == "stl" && would_be_far(points, middle) {
        true => Err(CloudError::Rounded { path: path.into() }),
        false => Ok(()),
    }
}

/// Writes a cloud or mesh: `.ply` with all that it has; `.obj`, `.off` or `.stl` of a mesh; `.pcd` of a cloud with
/// all that it has; `.npy` (`[N, 3]` or, with normals, `[N, 6]`, float64); or lines of `.xyz`. Standard output
/// (`-`), devices and pipes get `.ply`.
pub fn write_cloud(path: &Path, file: &CloudFile) -> Result<(), CloudError> {
    check_output(path)?;
    check_cloud(path, file)?;
    let kind = extension(path);
    if kind == "stl" && file.origin() != [0.0; 3] {
        return Err(CloudError::Rounded { path: path.into() });
    }
    let bytes = match kind.as_str() {
        "pcd" => pcd::emit(file),
        "npy" => npy::emit(file),
        "xyz" => table::emit(file),
        "obj" => obj::emit(file),
        "off" => off::emit(file),
        "stl" => stl::emit(file),
        _ => ply::emit(file),
    };
    files::write(path, &bytes).map_err(|source| CloudError::Io {
        path: path.into(),
        source,
    })
}
