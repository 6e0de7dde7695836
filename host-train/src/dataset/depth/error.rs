//! What can be wrong with a depth image, its mask or its camera.

use crate::words::count;
use std::path::PathBuf;

/// Why a depth image was refused: which file or argument, what is wrong there, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum DepthError {
    /// The operating system refused to read or write.
    #[error("{}: {source}", path.display())]
    Io {
        /// File concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The contents are not what they should be.
    #[error("{}: {reason}; expected {expected}", path.display())]
    Malformed {
        /// File or argument concerned.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
        /// What is read.
        expected: &'static str,
    },
    /// An image claims more pixels than any depth camera has.
    #[error("{}: {width} x {height} pixels are more than the {limit} that are read", path.display())]
    TooLarge {
        /// Image concerned.
        path: PathBuf,
        /// Claimed columns.
        width: usize,
        /// Claimed rows.
        height: usize,
        /// Most pixels accepted.
        limit: usize,
    },
    /// A mask, or what a camera was calibrated for, differs in size from the depth image.
    #[error(
        "{}: {} x {} pixels, but the depth image {} has {} x {}",
        path.display(), found[0], found[1], depth.display(), expected[0], expected[1]
    )]
    Size {
        /// Mask or camera concerned.
        path: PathBuf,
        /// Its columns and rows.
        found: [usize; 2],
        /// The depth image.
        depth: PathBuf,
        /// Its columns and rows.
        expected: [usize; 2],
    },
    /// No pixel of the mask is set.
    #[error("{}: no pixel shows the object: none is above 0", path.display())]
    EmptyMask {
        /// Mask concerned.
        path: PathBuf,
    },
    /// Nothing was measured where the object is.
    #[error(
        "{}: none of the object's {} has a depth; 0, 65535 in 16 bits, negative numbers and NaN are none: is it the right image, and its mask?",
        path.display(), count(*pixels, "pixel", "pixels")
    )]
    NoDepth {
        /// The depth image.
        path: PathBuf,
        /// Pixels of the mask, or of the image where there is none.
        pixels: usize,
    },
}
