//! Loose clouds and meshes, one a file. The extension decides the format; standard input (`-`) is told by its contents.
//!
//! | extension | what is read |
//! |---|---|
//! | `.ply` | vertices with normals, colours and intensities, faces and strips; ASCII, binary of either byte order |
//! | `.pcd` | points with normals, colours and intensities; ASCII, binary, compressed |
//! | `.off`, `.obj` | vertices with colours and normals, and faces |
//! | `.stl` | faces; ASCII or binary |
//! | `.xyz`, `.txt`, `.asc`, `.csv`, `.pts` | lines of numbers, see the module `table` |
//! | `.npy` | `[N, 3]` or more columns of numbers, or `[3, N]` |
//! | `.mcap` | the first cloud of the bag's only topic with clouds, see the module `bag`; not in a browser |
//!
//! In every format, points that are NaN, infinite or beyond 1e12 are left out. Whatever was left out or had to be
//! interpreted is listed as a [`Note`]. Coordinates stay f64. Files other than bags are read whole; memory beside
//! the result is a small multiple of the file's length, whatever its header claims.

#[cfg(not(target_family = "wasm"))]
pub mod bag;
mod checks;
mod columns;
mod error;
mod extent;
mod fields;
mod lines;
mod note;
pub(crate) mod npy;
mod obj;
mod off;
mod pcd;
mod ply;
mod polygon;
mod stl;
mod table;
mod write;

pub use error::CloudError;
pub(crate) use extent::origin_of;
pub use note::Note;
pub use write::{check_cloud, check_output, check_place, write_cloud};

use super::Point;
use super::mesh::Mesh;
use super::winding::Winding;
use crate::pose64::{Pose64, Position};
use crate::random::{Purpose, Rng, stream};
use glam::Vec3;
use nalgebra::Vector3;
use std::io::Read;
use std::path::Path;

/// Points drawn from a mesh, as many as ModelNet40's clouds have.
pub const MESH_POINTS: usize = 2048;

/// Coordinates beyond this mark what a sensor did not see, for example 3.4e38; the core refuses them, too.
pub(crate) const MAX_COORDINATE: f64 = 1e12;

/// The path of standard input and output.
pub const STANDARD: &str = "-";

/// Extensions that are read.
pub const EXTENSIONS: &[&str] = &[
    "ply",
    "pcd",
    "xyz",
    "txt",
    "asc",
    "csv",
    "pts",
    "npy",
    "off",
    "obj",
    "stl",
    #[cfg(not(target_family = "wasm"))]
    "mcap",
];

/// A cloud, or a mesh if there are faces, in its own units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudFile {
    /// Points, or vertices, in the file's units; all finite.
    pub points: Vec<Position>,
    /// Unit normals of the points or vertices, if there is one for each.
    pub normals: Option<Vec<Point>>,
    /// Red, green and blue of the points or vertices.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Intensities of the points or vertices, as the file scales them.
    pub intensities: Option<Vec<f32>>,
    /// Vertex indices of each triangle (larger polygons are divided); `None` for a plain cloud.
    pub faces: Option<Vec<[u32; 3]>>,
    /// What the reader noticed.
    pub notes: Vec<Note>,
}

/// Reads a cloud or mesh and checks it: at least one point, all finite, no face out of range.
pub fn read_file(path: &Path) -> Result<CloudFile, CloudError> {
    let io = |source| CloudError::Io {
        path: path.into(),
        source,
    };
    let mut bytes = Vec::new();
    if path == Path::new(STANDARD) {
        std::io::stdin().read_to_end(&mut bytes).map_err(io)?;
        return parse(&bytes, kind_of(&bytes), path);
    }
    #[cfg(not(target_family = "wasm"))]
    if bag::is_bag(path) {
        return bag::read_first(path);
    }
    if path.is_dir() {
        return Err(io(std::io::ErrorKind::IsADirectory.into()));
    }
    is_read(path)?;
    read_bytes(&std::fs::read(path).map_err(io)?, path)
}

/// The same for a file's contents. The extension of `path` decides the format, and errors name the path.
///
/// # Errors
/// As [`read_file`].
pub fn read_bytes(bytes: &[u8], path: &Path) -> Result<CloudFile, CloudError> {
    is_read(path)?;
    parse(bytes, &extension(path), path)
}

/// Refuses an extension that is not read.
fn is_read(path: &Path) -> Result<(), CloudError> {
    match EXTENSIONS.contains(&extension(path).as_str()) {
        true => Ok(()),
        false => Err(CloudError::Extension { path: path.into() }),
    }
}

fn parse(bytes: &[u8], kind: &str, path: &Path) -> Result<CloudFile, CloudError> {
    let parse: fn(&[u8]) -> Result<CloudFile, String> = match kind {
        "ply" => ply::parse,
        "pcd" => pcd::parse,
        "npy" => npy::parse,
        "off" => off::parse,
        "obj" => obj::parse,
        "stl" => stl::parse,
        "mcap" => |_| Err("a bag is read from its file: name that".into()),
        _ => table::parse,
    };
    let malformed = |reason: String| CloudError::Malformed {
        path: path.into(),
        reason: match bytes.trim_ascii() {
            [] => "no points: the file is empty".into(),
            _ => reason,
        },
    };
    let file = parse(bytes).map_err(malformed)?;
    file.checked(path)
}

/// The extension that the contents correspond to.
fn kind_of(bytes: &[u8]) -> &'static str {
    let start = bytes.trim_ascii_start();
    let begins = |word: &[u8]| {
        start
            .get(..word.len())
            .is_some_and(|w| w.eq_ignore_ascii_case(word))
    };
    let first = start.split(|&b| b == b'\n').next().unwrap_or_default();
    if begins(b"ply") {
        "ply"
    } else if begins(b"# .PCD") || begins(b"VERSION") {
        "pcd"
    } else if begins(b"\x93NUMPY") {
        "npy"
    } else if begins(b"\x89MCAP") {
        "mcap"
    } else if first.len() < 32 && first.windows(3).any(|word| word == b"OFF") {
        "off"
    } else if begins(b"solid") {
        "stl"
    } else if ["v ", "o ", "g ", "mtllib "].iter().any(|word| {
        bytes.starts_with(word.as_bytes())
            || bytes
                .windows(word.len() + 1)
                .take(1024)
                .any(|w| w[0] == b'\n' && &w[1..] == word.as_bytes())
    }) {
        "obj"
    } else if bytes.iter().take(84).any(|&b| b == 0)
        && !matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..])
    {
        "stl"
    } else {
        "xyz"
    }
}

/// The extension in lower case; empty if there is none.
pub(crate) fn extension(path: &Path) -> String {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.unwrap_or_default().to_ascii_lowercase()
}

/// Reads a file as a cloud in its own units: a plain cloud as it is, a mesh as [`MESH_POINTS`] points drawn evenly
/// from its surface, with the normals of its faces. The reader's notes become warnings.
pub fn read_cloud(path: &Path, seed: u64) -> Result<CloudFile, CloudError> {
    read_surface(path, &mut stream(seed, Purpose::Surface, 0))
}

/// As [`read_cloud`], with draws from a given stream.
pub(super) fn read_surface(path: &Path, rng: &mut Rng) -> Result<CloudFile, CloudError> {
    let file = read_file(path)?;
    for note in &file.notes {
        tracing::warn!("{}: {note}", path.display());
    }
    file.sampled(MESH_POINTS, rng)
        .ok_or_else(|| CloudError::NoArea { path: path.into() })
}

impl CloudFile {
    /// A plain cloud of f32 points.
    pub fn of(points: &[Point]) -> CloudFile {
        CloudFile {
            points: points.iter().map(|p| p.map(f64::from)).collect(),
            ..CloudFile::default()
        }
    }

    /// Points relative to `origin`, in f32.
    pub fn relative_to(&self, origin: Position) -> Vec<Point> {
        let relative = |p: &Position| [0, 1, 2].map(|axis| (p[axis] - origin[axis]) as f32);
        self.points.iter().map(relative).collect()
    }

    /// The origin to which coordinates are relative in f32.
    pub fn origin(&self) -> Position {
        origin_of(self.points.iter().copied())
    }

    /// The mesh in f32, not shifted.
    pub fn mesh(&self) -> Mesh {
        self.mesh_relative_to([0.0; 3])
    }

    /// The mesh in f32, relative to `origin`.
    pub fn mesh_relative_to(&self, origin: Position) -> Mesh {
        Mesh {
            vertices: self
                .relative_to(origin)
                .into_iter()
                .map(Vec3::from)
                .collect(),
            faces: self.faces.clone().unwrap_or_default(),
        }
    }

    /// The winding of its faces, if they enclose a volume ([`Mesh::winding`]).
    pub fn winding(&self) -> Option<Winding> {
        self.mesh_relative_to(self.origin()).winding()
    }

    /// The cloud itself, or `count` points drawn evenly from the surface of a mesh, with the normals of its faces;
    /// `None` if the mesh has no area.
    pub fn sampled(self, count: usize, rng: &mut Rng) -> Option<CloudFile> {
        if self.faces.is_none() {
            return Some(self);
        }
        let origin = self.origin();
        let drawn = self
            .mesh_relative_to(origin)
            .sample_with_normals(count, rng);
        if drawn.is_empty() {
            return None;
        }
        let (points, normals): (Vec<Point>, Vec<Point>) = drawn.into_iter().unzip();
        let placed = |p: Point| [0, 1, 2].map(|axis| origin[axis] + f64::from(p[axis]));
        Some(CloudFile {
            points: points.into_iter().map(placed).collect(),
            normals: Some(normals),
            notes: self.notes,
            ..CloudFile::default()
        })
    }

    /// The same file after a rigid transform.
    pub fn moved(&self, pose: &Pose64) -> CloudFile {
        let turned = |&n: &Point| {
            let turned: Position = (pose.rotation * Vector3::from(n.map(f64::from))).into();
            turned.map(|x| x as f32)
        };
        CloudFile {
            points: self.points.iter().map(|&p| pose.apply(p)).collect(),
            normals: self
                .normals
                .as_ref()
                .map(|normals| normals.iter().map(turned).collect()),
            ..self.clone()
        }
    }
}

/// Whether there are normals and all are unit vectors.
fn are_units(normals: &[Point]) -> bool {
    let unit = |normal: &Point| (Vec3::from(*normal).length_squared() - 1.0).abs() < 0.02;
    !normals.is_empty() && normals.iter().all(unit)
}

/// Colours in bytes, from numbers up to 1, 255 or 65535; `None` for other ranges.
fn colours(values: &[Position]) -> Option<Vec<[u8; 3]>> {
    let largest = values.iter().flatten().copied().fold(0.0, f64::max);
    let scale = match largest {
        ..=1.0 => 255.0,
        ..=255.0 => 1.0,
        ..=65535.0 => 1.0 / 257.0,
        _ => return None,
    };
    let valid = values.iter().flatten().all(|&x| x >= 0.0);
    let bytes = values.iter().map(|c| c.map(|x| (x * scale).round() as u8));
    valid.then(|| bytes.collect())
}

#[cfg(test)]
mod tests;
