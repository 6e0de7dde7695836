//! What a policy looks at: all of both clouds, as in the paper, or what may belong together.

use crate::cut::Cut;
use serde::{Deserialize, Serialize};

/// What is looked at of both clouds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sight {
    /// Points of the source that are seen farther from the target's centre are left out in every look at all points: for
    /// views, whose masks reach over the object. [`Cut::NONE`], as in the paper: everything is looked at.
    #[serde(default)]
    pub cut: Cut,
    /// Steps from one choice of the target's points to the next: those that have some of the source near them are looked at
    /// ([`Focus`](crate::focus::Focus)). 0, as in the paper: all are, always.
    #[serde(default)]
    pub focus: u8,
}

impl Sight {
    /// Everything, as in the paper.
    pub const ALL: Sight = Sight {
        cut: Cut::NONE,
        focus: 0,
    };

    /// Whether the target's points are chosen anew after so many steps.
    pub fn refocuses(self, steps: usize) -> bool {
        self.focus != 0 && steps.is_multiple_of(usize::from(self.focus))
    }
}
