//! Loose clouds and meshes: `.ply`, `.pcd`, `.xyz`, `.off`, `.obj`, `.stl`. The extension decides.

mod obj;
mod pcd;
mod ply;
mod stl;
mod text;

use super::Point;
use super::mesh::Mesh;
use crate::random::{Purpose, stream};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Points drawn from a mesh, as many as ModelNet40's clouds have.
pub const MESH_POINTS: usize = 2048;

/// A cloud, or a mesh where the file has faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudFile {
    /// Points, or vertices, in the file's units; all finite.
    pub points: Vec<Point>,
    /// Vertex indices of each triangle (larger polygons are divided); `None` for a plain cloud.
    pub faces: Option<Vec<[u32; 3]>>,
    /// Invalid points left out: organised `.pcd` clouds mark pixels without depth by NaN.
    pub dropped: usize,
}

/// Why a file of points was refused.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// The extension is not one of those that are read.
    #[error("{}: unknown kind of file; give .ply .pcd .xyz .off .obj or .stl", path.display())]
    Extension {
        /// File concerned.
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
    /// The contents are not what the extension says, or end early.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// File concerned.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
    },
    /// No valid points.
    #[error("{}: no points ({dropped} invalid ones were left out)", path.display())]
    Empty {
        /// File concerned.
        path: PathBuf,
        /// NaN points that were left out.
        dropped: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("{}: point {index} has a NaN or infinite coordinate; drop invalid points first", path.display())]
    NotFinite {
        /// File concerned.
        path: PathBuf,
        /// Index of the first such point.
        index: usize,
    },
    /// A face names a vertex that does not exist.
    #[error("{}: face {face} names vertex {vertex} of {vertices}", path.display())]
    BadFace {
        /// File concerned.
        path: PathBuf,
        /// Index of the triangle.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// All faces of the mesh are degenerate.
    #[error("{}: the mesh has no area to sample points from", path.display())]
    NoArea {
        /// File concerned.
        path: PathBuf,
    },
}

/// Reads a cloud or mesh and checks it: at least one point, all finite, no face out of range.
pub fn read_file(path: &Path) -> Result<CloudFile, CloudError> {
    let extension = path
        .extension()
        .and_then(|e| e.to_str())
        .map(str::to_ascii_lowercase);
    let parse: fn(&[u8]) -> Result<CloudFile, String> = match extension.as_deref() {
        Some("ply") => ply::parse,
        Some("pcd") => pcd::parse,
        Some("xyz" | "txt") => text::parse_xyz,
        Some("off") => text::parse_off,
        Some("obj") => obj::parse,
        Some("stl") => stl::parse,
        _ => return Err(CloudError::Extension { path: path.into() }),
    };
    let bytes = std::fs::read(path).map_err(|source| CloudError::Io {
        path: path.into(),
        source,
    })?;
    let file = parse(&bytes).map_err(|reason| CloudError::Malformed {
        path: path.into(),
        reason,
    })?;
    file.checked(path)
}

/// Reads a file as a cloud in its own units: a plain cloud as it is, a mesh as [`MESH_POINTS`] points drawn
/// evenly from its surface.
pub fn read_cloud(path: &Path, seed: u64) -> Result<Vec<Point>, CloudError> {
    let file = read_file(path)?;
    if file.dropped > 0 {
        tracing::warn!(
            "{}: left out {} invalid points",
            path.display(),
            file.dropped
        );
    }
    let Some(faces) = file.faces else {
        return Ok(file.points);
    };
    let vertices = file.points.into_iter().map(Vec3::from).collect();
    let mesh = Mesh { vertices, faces };
    let points = mesh.sample(MESH_POINTS, &mut stream(seed, Purpose::Shape, 0));
    if points.is_empty() {
        return Err(CloudError::NoArea { path: path.into() });
    }
    Ok(points)
}

/// Writes a cloud as binary `.ply`.
pub fn write_ply(path: &Path, points: &[Point]) -> Result<(), CloudError> {
    std::fs::write(path, ply::emit(points)).map_err(|source| CloudError::Io {
        path: path.into(),
        source,
    })
}

impl CloudFile {
    fn checked(self, path: &Path) -> Result<CloudFile, CloudError> {
        let path = || path.to_path_buf();
        if self.points.is_empty() {
            return Err(CloudError::Empty {
                path: path(),
                dropped: self.dropped,
            });
        }
        if let Some(index) = self
            .points
            .iter()
            .position(|p| !p.iter().all(|x| x.is_finite()))
        {
            return Err(CloudError::NotFinite {
                path: path(),
                index,
            });
        }
        let vertices = self.points.len();
        for (face, corners) in self.faces.iter().flatten().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= vertices) {
                return Err(CloudError::BadFace {
                    path: path(),
                    face,
                    vertex,
                    vertices,
                });
            }
        }
        Ok(self)
    }
}

/// Divides a polygon into triangles from its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    let edges = polygon.windows(2).skip(1);
    edges.map(|edge| [polygon[0], edge[0], edge[1]])
}

#[cfg(test)]
mod tests;
