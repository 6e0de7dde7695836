//! Why a file of points was refused.

#[cfg(not(target_family = "wasm"))]
mod bag;

#[cfg(not(target_family = "wasm"))]
pub use bag::BagError;

use super::EXTENSIONS;
use crate::words::count;
use std::path::PathBuf;

/// Where there is a command line.
#[cfg(not(target_family = "wasm"))]
const OR_STANDARD: &str = ", or give - for standard input";
#[cfg(target_family = "wasm")]
const OR_STANDARD: &str = "";

/// Why a cloud or mesh file was refused, or not written.
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// The extension is not one of those that are read.
    #[error(
        "{}: unknown kind of file; convert it to one of .{}{OR_STANDARD}",
        path.display(), EXTENSIONS.join(" .")
    )]
    Extension {
        /// File concerned.
        path: PathBuf,
    },
    /// Nothing of this extension is written.
    #[error(
        "{}: clouds are written as .ply .pcd .xyz or .npy, meshes as .ply .obj .off or .stl too",
        path.display()
    )]
    OutputExtension {
        /// File concerned.
        path: PathBuf,
    },
    /// The extension is a mesh format, and there are no faces.
    #[error("{}: a cloud without faces is no mesh; write it as .ply .pcd .xyz or .npy", path.display())]
    NoFaces {
        /// File concerned.
        path: PathBuf,
    },
    /// Float32, the format's only type, would round coordinates far from the origin.
    #[error("{}: .stl has no digits for coordinates so far from the origin; write it as .ply .obj or .off", path.display())]
    Rounded {
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
    #[error("{}: no points{}", path.display(), invalid(*dropped))]
    Empty {
        /// File concerned.
        path: PathBuf,
        /// Invalid points that were left out.
        dropped: usize,
    },
    /// Scaled as asked, the cloud is too large.
    #[error("{}: multiplied by {scale}, coordinates are beyond 1e12", path.display())]
    Scaled {
        /// File concerned.
        path: PathBuf,
        /// The factor.
        scale: f64,
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
    /// The core refuses the points.
    #[error("{}: {source}", path.display())]
    Refused {
        /// File concerned.
        path: PathBuf,
        /// Why.
        source: reagent_core::Error,
    },
    /// A bag was refused.
    #[cfg(not(target_family = "wasm"))]
    #[error(transparent)]
    Bag(#[from] BagError),
    /// There are no faces, or all of them are degenerate.
    #[error("{}: no surface to draw points from: it has no faces, or none with an area", path.display())]
    NoArea {
        /// File concerned.
        path: PathBuf,
    },
}

/// The rest of the message if there were points, but all were invalid.
fn invalid(dropped: usize) -> String {
    match dropped {
        0 => String::new(),
        _ => format!(
            " but {} (NaN, infinite or beyond 1e12)",
            count(dropped, "invalid one", "invalid ones")
        ),
    }
}
