//! What can be wrong with a data set in BOP layout.

use crate::dataset::cloud_file::CloudError;
use crate::dataset::depth::DepthError;
use std::path::PathBuf;

/// Where the layout and its data sets are published.
pub const BOP_URL: &str = "https://bop.felk.cvut.cz/datasets";

/// Why a data set in BOP layout was refused: which file, what was expected there, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum BopError {
    /// A file or folder of the layout does not exist.
    #[error(
        "{} is missing ({expected}); see {BOP_URL} for the layout, or make a set with `host-train bop-synth`",
        path.display()
    )]
    Missing {
        /// What was looked for.
        path: PathBuf,
        /// What it should hold.
        expected: &'static str,
    },
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
        /// File concerned.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
        /// Fields or format the file should have.
        expected: &'static str,
    },
    /// A depth image or a mask was refused.
    #[error(transparent)]
    Depth(#[from] DepthError),
    /// A model's mesh was refused.
    #[error(transparent)]
    Mesh(#[from] CloudError),
    /// A scene or an estimate names an object without a model.
    #[error("{} names object {object}, of which {} has no model", origin.display(), models.display())]
    NoModel {
        /// File that names it.
        origin: PathBuf,
        /// The object's id.
        object: u32,
        /// Folder of the models.
        models: PathBuf,
    },
    /// No annotated object could be used.
    #[error("{}: {what}", path.display())]
    Empty {
        /// Folder or file concerned.
        path: PathBuf,
        /// What there is none of.
        what: &'static str,
    },
}
