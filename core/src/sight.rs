//! What a policy looks at: all of both clouds, as in the paper, or only what may belong together.

use crate::cut::Cut;
use serde::{Deserialize, Serialize};

/// Which points of both clouds a policy looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sight {
    /// Every look at all points leaves out those of the source farther than this from the target's centre: masks of views reach
    /// over the object. [`Cut::NONE`], as in the paper, looks at everything.
    #[serde(default)]
    pub cut: Cut,
    /// Steps between choices of the target's points ([`Focus`](crate::focus::Focus)): those that have some of the source near
    /// them. 0, as in the paper, always looks at all.
    #[serde(default)]
    pub focus: u8,
}

impl Sight {
    /// Looks at everything, as in the paper.
    pub const ALL: Sight = Sight {
        cut: Cut::NONE,
        focus: 0,
    };

    /// Whether the target's points are chosen anew after `steps` steps.
    pub fn refocuses(self, steps: usize) -> bool {
        self.focus != 0 && steps.is_multiple_of(usize::from(self.focus))
    }
}
