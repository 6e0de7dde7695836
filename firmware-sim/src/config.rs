//! What a node needs to know when it starts.

use crate::policy::Trust;
use std::path::PathBuf;

/// A node's names, keys and files.
#[derive(Clone, Debug)]
pub struct NodeConfig {
    /// Fleet it belongs to.
    pub fleet: String,
    /// Its own name in the fleet.
    pub robot: String,
    /// Whose policies it accepts.
    pub trust: Trust,
    /// Where it keeps its policy across restarts.
    pub state: Option<PathBuf>,
}
