//! Loose clouds and meshes, one a file; the extension decides.
//!
//! | extension | what is read |
//! |---|---|
//! | `.ply` | vertices, normals and faces; ASCII, binary of either byte order |
//! | `.pcd` | points and normals; ASCII, binary, compressed; points with NaN are left out and counted |
//! | `.off`, `.obj`, `.stl` | vertices and faces; `.stl` ASCII or binary |
//! | `.xyz`, `.txt` | the first three numbers of each line |
//! | `.npy` | `[N, 3]` or more columns of float32 or float64 |
//!
//! Files are read whole; memory beside the result is a small multiple of the file's length, whatever its
//! header claims.

mod npy;
mod obj;
mod pcd;
mod ply;
mod stl;
mod text;

use super::Point;
use super::mesh::Mesh;
use crate::random::{Purpose, Rng, stream};
use glam::Vec3;
use reagent_core::Pose;
use std::path::{Path, PathBuf};

/// Points drawn from a mesh, as many as ModelNet40's clouds have.
pub const MESH_POINTS: usize = 2048;

/// A cloud, or a mesh where the file has faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudFile {
    /// Points, or vertices, in the file's units; all finite.
    pub points: Vec<Point>,
    /// Unit normals of the points or vertices, where the file gives one for each.
    pub normals: Option<Vec<Point>>,
    /// Vertex indices of each triangle (larger polygons are divided); `None` for a plain cloud.
    pub faces: Option<Vec<[u32; 3]>>,
    /// Invalid points left out: organised `.pcd` clouds mark pixels without depth by NaN.
    pub dropped: usize,
}

/// Points in a file's own units, to be registered.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Points, `[N, 3]`.
    pub points: Vec<Point>,
    /// Unit normals, `[N, 3]`, where they are known; of a mesh, those of its faces.
    pub normals: Option<Vec<Point>>,
}

impl Cloud {
    /// The cloud after a rigid transform.
    pub fn moved(&self, pose: &Pose) -> Cloud {
        let turned = |&n: &Point| (pose.rotation * Vec3::from(n)).to_array();
        Cloud {
            points: self
                .points
                .iter()
                .map(|&p| pose.apply(p.into()).to_array())
                .collect(),
            normals: self
                .normals
                .as_ref()
                .map(|normals| normals.iter().map(turned).collect()),
        }
    }
}

/// Why a file of points was refused.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// The extension is not one of those that are read.
    #[error("{}: unknown kind of file; give .ply .pcd .xyz .npy .off .obj or .stl", path.display())]
    Extension {
        /// File concerned.
        path: PathBuf,
    },
    /// Nothing of this extension is written.
    #[error("{}: clouds are written as .ply .pcd .xyz or .npy", path.display())]
    OutputExtension {
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
    /// All points of the cloud coincide.
    #[error("{}: all points coincide; there is nothing to register", path.display())]
    NoExtent {
        /// File concerned.
        path: PathBuf,
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
    let parse: fn(&[u8]) -> Result<CloudFile, String> = match extension(path).as_str() {
        "ply" => ply::parse,
        "pcd" => pcd::parse,
        "xyz" | "txt" => text::parse_xyz,
        "npy" => npy::parse,
        "off" => text::parse_off,
        "obj" => obj::parse,
        "stl" => stl::parse,
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

/// The extension in lower case; empty where there is none.
pub(super) fn extension(path: &Path) -> String {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.unwrap_or_default().to_ascii_lowercase()
}

/// Reads a file as a cloud in its own units: a plain cloud as it is, a mesh as [`MESH_POINTS`] points drawn
/// evenly from its surface, with the normals of its faces.
pub fn read_cloud(path: &Path, seed: u64) -> Result<Cloud, CloudError> {
    read_surface(path, &mut stream(seed, Purpose::Surface, 0))
}

/// As [`read_cloud`], with the draws of a given stream.
pub(super) fn read_surface(path: &Path, rng: &mut Rng) -> Result<Cloud, CloudError> {
    let file = read_file(path)?;
    if file.dropped > 0 {
        tracing::warn!(
            "{}: left out {} invalid points",
            path.display(),
            file.dropped
        );
    }
    let Some(faces) = file.faces else {
        return Ok(Cloud {
            points: file.points,
            normals: file.normals,
        });
    };
    let vertices = file.points.into_iter().map(Vec3::from).collect();
    let mesh = Mesh { vertices, faces };
    let drawn = mesh.sample_with_normals(MESH_POINTS, rng);
    if drawn.is_empty() {
        return Err(CloudError::NoArea { path: path.into() });
    }
    let (points, normals) = drawn.into_iter().unzip();
    Ok(Cloud {
        points,
        normals: Some(normals),
    })
}

/// Refuses a path that [`write_cloud`] could not write for its extension.
pub fn check_output(path: &Path) -> Result<(), CloudError> {
    match extension(path).as_str() {
        "ply" | "pcd" | "xyz" | "npy" => Ok(()),
        _ => Err(CloudError::OutputExtension { path: path.into() }),
    }
}

/// Writes a cloud: binary `.ply` or `.pcd`, `.npy` (`[N, 3]` or, with normals, `[N, 6]`), or the points only as
/// lines of `.xyz`.
pub fn write_cloud(path: &Path, cloud: &Cloud) -> Result<(), CloudError> {
    check_output(path)?;
    let count = cloud.points.len();
    let normals = cloud
        .normals
        .as_ref()
        .filter(|normals| normals.len() == count);
    let columns = if normals.is_some() { 6 } else { 3 };
    let rows = || -> Vec<u8> {
        let row = |i: usize| {
            cloud.points[i]
                .iter()
                .chain(normals.into_iter().flat_map(move |n| &n[i]))
        };
        (0..count)
            .flat_map(row)
            .flat_map(|x| x.to_le_bytes())
            .collect()
    };
    let bytes = match extension(path).as_str() {
        "pcd" => pcd::emit(&rows(), count, columns),
        "npy" => npy::emit(&rows(), count, columns),
        "xyz" => text::emit_xyz(&cloud.points),
        _ => ply::emit(&rows(), count, columns),
    };
    std::fs::write(path, bytes).map_err(|source| CloudError::Io {
        path: path.into(),
        source,
    })
}

impl CloudFile {
    fn checked(mut self, path: &Path) -> Result<CloudFile, CloudError> {
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
        let unit = |normal: Point| {
            let unit = Vec3::from(normal).try_normalize()?;
            Some(unit.to_array())
        };
        // One undefined normal, and those of the file are of no use.
        self.normals = self
            .normals
            .filter(|normals| normals.len() == vertices)
            .and_then(|normals| normals.into_iter().map(unit).collect());
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
