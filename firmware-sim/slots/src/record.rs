//! What the robot remembers across power cuts: one small record, replaced as a whole.

use crate::layout::Slot;
use serde::{Deserialize, Serialize};

/// Key of the record in the map.
pub(crate) const KEY: u8 = 0;
/// Most bytes of an encoded record, including what the map needs.
pub(crate) const BUFFER: usize = 128;

/// The release of the newest policy that was ever confirmed. No earlier one is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Floor {
    /// A greater epoch is later. Versions of different epochs are not compared.
    pub epoch: u32,
    /// Grows within an epoch.
    pub version: u64,
}

impl core::fmt::Display for Floor {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.epoch {
            0 => write!(f, "{}", self.version),
            epoch => write!(f, "{} of epoch {epoch}", self.version),
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// The slot that counts, once there is one.
    pub(crate) confirmed: Option<Slot>,
    /// See [`Floor`].
    pub(crate) floor: Floor,
    /// Whether the policy in the idle slot is on trial. If this is set at a start, the trial failed.
    pub(crate) on_trial: bool,
}

impl Record {
    /// The slot that does not count.
    pub(crate) fn idle(&self) -> Slot {
        self.confirmed.map_or(Slot::A, Slot::other)
    }
}

/// What one of the two copies of the record holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Copy {
    /// Nothing was ever written there.
    Erased,
    /// It cannot be read.
    Damaged,
    /// A record.
    Whole(Record),
}

/// The record that two copies hold, and which of them differ from it. The first copy is written first. If both are intact, it is at
/// least as new as the second. The higher floor of the two counts.
pub(crate) fn reconcile(copies: [Copy; 2]) -> Option<(Record, [bool; 2])> {
    let record = match copies {
        [Copy::Whole(first), Copy::Whole(second)] => Record {
            floor: first.floor.max(second.floor),
            ..first
        },
        [Copy::Whole(only), _] | [_, Copy::Whole(only)] => only,
        _ => return None,
    };
    Some((record, copies.map(|copy| copy != Copy::Whole(record))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_higher_floor_counts_and_what_differs_is_told() {
        let record = |version, confirmed| Record {
            confirmed: Some(confirmed),
            floor: Floor { epoch: 1, version },
            on_trial: false,
        };
        let (a, b) = (record(5, Slot::A), record(4, Slot::B));
        let whole = Copy::Whole;
        let cases = [
            ([whole(a), whole(a)], Some((a, [false, false]))),
            ([whole(a), whole(b)], Some((a, [false, true]))),
            (
                [whole(b), whole(a)],
                Some((record(5, Slot::B), [true, true])),
            ),
            ([whole(a), Copy::Erased], Some((a, [false, true]))),
            ([Copy::Damaged, whole(a)], Some((a, [true, false]))),
            ([Copy::Damaged, Copy::Erased], None),
            ([Copy::Erased, Copy::Erased], None),
        ];
        for (copies, expected) in cases {
            assert_eq!(reconcile(copies), expected, "{copies:?}");
        }
    }
}
