//! What can be said about a pose: from the steps that led to it, and from how the clouds fit under it.

use crate::dims::STEP_SIZES;
use crate::evidence::Evidence;
use crate::steps::{Action, STOP};
use core::fmt;

/// How many kinds of [`Verdict`] there are.
pub const VERDICTS: usize = Verdict::TooFewPoints as usize + 1;

/// What can be said about a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Verdict {
    /// The last step was "stop" on every axis: the policy sees nothing left to correct. Of a refined pose: it
    /// fits so well that it is probably right.
    Converged,
    /// The steps ran out while the policy still moved.
    StepLimit,
    /// The steps ran out while the policy went back and forth: the last step undid the one before.
    Oscillating,
    /// The steps ran out while the policy still took the largest: the pose is farther than the steps reach.
    OutOfRange,
    /// The clouds do not fit under the refined pose: it is probably wrong.
    PoorFit,
    /// One cloud is several times as large as the other: inches against millimetres, perhaps. The factor is
    /// [`crate::polish::Refined::extents_ratio`].
    SizesDiffer,
    /// One cloud has too few distinct points for any pose to be trusted.
    TooFewPoints,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Verdict::Converged => "converged",
            Verdict::StepLimit => "step limit",
            Verdict::Oscillating => "oscillating",
            Verdict::OutOfRange => "out of range",
            Verdict::PoorFit => "poor fit",
            Verdict::SizesDiffer => "sizes differ",
            Verdict::TooFewPoints => "too few points",
        })
    }
}

impl Verdict {
    /// Every one, in the order of [`crate::wire::Status::verdicts`].
    pub const ALL: [Verdict; VERDICTS] = [
        Verdict::Converged,
        Verdict::StepLimit,
        Verdict::Oscillating,
        Verdict::OutOfRange,
        Verdict::PoorFit,
        Verdict::SizesDiffer,
        Verdict::TooFewPoints,
    ];

    /// Of a policy, from its last two actions.
    pub(crate) fn of_actions(before: Action, last: Action) -> Verdict {
        let ids = |a: Action| a.translation.into_iter().chain(a.rotation);
        let largest = STEP_SIZES as u8 - 1;
        if last == Action::STOP {
            Verdict::Converged
        } else if ids(before).zip(ids(last)).all(|(a, b)| a + b == 2 * STOP) {
            Verdict::Oscillating
        } else if ids(last).any(|id| id == 0 || id == largest) {
            Verdict::OutOfRange
        } else {
            Verdict::StepLimit
        }
    }

    /// Verdict for a refined pose, from what speaks for and against it.
    pub fn of_evidence(evidence: &Evidence) -> Verdict {
        if evidence.sizes_differ() {
            Verdict::SizesDiffer
        } else if evidence.has_too_few_points() {
            Verdict::TooFewPoints
        } else if evidence.probability() >= 0.5 {
            Verdict::Converged
        } else {
            Verdict::PoorFit
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_tell_how_the_steps_ended() {
        let action = |t: u8, r: u8| Action {
            translation: [t, STOP, STOP],
            rotation: [STOP, r, STOP],
        };
        let of = Verdict::of_actions;
        assert_eq!(of(action(0, 10), Action::STOP), Verdict::Converged);
        assert_eq!(of(action(6, 3), action(4, 7)), Verdict::Oscillating);
        assert_eq!(of(action(0, 3), action(10, 7)), Verdict::Oscillating);
        assert_eq!(of(action(6, 3), action(10, 5)), Verdict::OutOfRange);
        assert_eq!(of(action(6, 3), action(4, 6)), Verdict::StepLimit);
    }
}
