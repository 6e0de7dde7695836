//! What the robot remembers over power cuts: one small record, replaced as a whole.

use crate::layout::Slot;
use serde::{Deserialize, Serialize};

/// Key of the record in the map.
pub(crate) const KEY: u8 = 0;
/// Most bytes of an encoded record, and what the map needs beside.
pub(crate) const BUFFER: usize = 128;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// The slot that counts, once there is one.
    pub(crate) confirmed: Option<Slot>,
    /// Version of the newest policy that was ever confirmed.
    pub(crate) floor: u64,
    /// Whether the policy in the idle slot is being tried. Found at a start, it did not end well.
    pub(crate) on_trial: bool,
}

impl Record {
    /// The slot that does not count.
    pub(crate) fn idle(&self) -> Slot {
        self.confirmed.map_or(Slot::A, Slot::other)
    }
}
