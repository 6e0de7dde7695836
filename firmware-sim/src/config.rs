//! What a node is told at its start.

use crate::policy::Trust;
use std::path::PathBuf;

/// A node's names, keys and files.
#[derive(Clone, Debug)]
pub struct NodeConfig {
    /// Fleet it belongs to.
    pub fleet: String,
    /// Its own name in the fleet.
    pub robot: String,
    /// Whose policies it takes.
    pub trust: Trust,
    /// Where it keeps its policy over restarts.
    pub state: Option<PathBuf>,
}
