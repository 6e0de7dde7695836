//! Writing clouds and meshes.

use super::extent::would_be_far;
use super::{CloudError, CloudFile, STANDARD, extension, npy, obj, off, pcd, ply, stl, table};
use crate::files;
use crate::pose64::Position;
use std::path::Path;

/// Refuses a path whose extension [`write_cloud`] could not write.
pub fn check_output(path: &Path) -> Result<(), CloudError> {
    match extension(path).as_str() {
        "ply" | "pcd" | "xyz" | "npy" | "obj" | "off" | "stl" => Ok(()),
        _ if path == Path::new(STANDARD) || files::is_special(path) => Ok(()),
        _ => Err(CloudError::OutputExtension { path: path.into() }),
    }
}

/// Refuses a cloud without faces if the path's extension is a mesh format.
pub fn check_cloud(path: &Path, file: &CloudFile) -> Result<(), CloudError> {
    match extension(path).as_str() {
        "obj" | "off" | "stl" if file.faces.is_none() => {
            Err(CloudError::NoFaces { path: path.into() })
        }
        _ => Ok(()),
    }
}

/// Refuses a mesh for `.stl` that would lie far from the origin with its middle there.
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

/// Writes a cloud or mesh. `.ply` gets everything that it has, as does `.pcd` for clouds; `.obj`, `.off` and `.stl`
/// are for meshes; `.npy` is `[N, 3]` or, with normals, `[N, 6]`, float64; `.xyz` is lines of text. Standard output
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
