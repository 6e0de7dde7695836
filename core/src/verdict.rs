//! What can be said about a pose, from the steps that led to it and from how the clouds fit under it.

use crate::dims::STEP_SIZES;
use crate::evidence::Evidence;
use crate::steps::{Action, STOP};
use core::fmt;

/// Number of kinds of [`Verdict`].
pub const VERDICTS: usize = Verdict::Mirrored as usize + 1;

/// What can be said about a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Verdict {
    /// The last step was "stop" on every axis: the policy sees nothing left to correct. For a refined pose: it fits so well
    /// that it is probably right.
    Converged,
    /// The steps ran out while the policy still moved.
    StepLimit,
    /// The steps ran out while the policy went back and forth: the last step undid the one before.
    Oscillating,
    /// The steps ran out while the policy still took the largest steps: the pose is farther away than the steps reach.
    OutOfRange,
    /// The clouds do not fit under the refined pose: it is probably wrong.
    PoorFit,
    /// One cloud is several times as large as the other, perhaps inches against millimetres. The factor is
    /// [`crate::polish::Refined::extents_ratio`].
    SizesDiffer,
    /// One cloud has too few distinct points for any pose to be trusted.
    TooFewPoints,
    /// The mirror image of the source fits better: a left-hand part for a
    /// right-hand one, a reversed axis, or a wrong pose of a symmetric shape.
    Mirrored,
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
            Verdict::Mirrored => "mirrored",
        })
    }
}

impl Verdict {
    /// All verdicts, in the order of [`crate::wire::Status::verdicts`].
    pub const ALL: [Verdict; VERDICTS] = [
        Verdict::Converged,
        Verdict::StepLimit,
        Verdict::Oscillating,
        Verdict::OutOfRange,
        Verdict::PoorFit,
        Verdict::SizesDiffer,
        Verdict::TooFewPoints,
        Verdict::Mirrored,
    ];

    /// Verdict on a policy's steps, from its last two actions.
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

    /// Verdict on a refined pose, from the evidence for and against it.
    pub fn of_evidence(evidence: &Evidence) -> Verdict {
        // Few points do not show a cloud's size either.
        if evidence.has_too_few_points() {
            Verdict::TooFewPoints
        } else if evidence.sizes_differ() {
            Verdict::SizesDiffer
        } else if evidence.is_mirrored() {
            Verdict::Mirrored
        } else if evidence.probability() >= 0.5 {
            Verdict::Converged
        } else {
            Verdict::PoorFit
        }
    }
}

/// A probability shown in percent, never rounded to certainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Percent(pub f32);

impl fmt::Display for Percent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match 100.0 * self.0 {
            percent if percent > 99.9 => f.write_str("over 99.9 %"),
            percent if percent > 99.0 => write!(f, "{percent:.1} %"),
            percent if percent < 1.0 => f.write_str("under 1 %"),
            percent => write!(f, "{percent:.0} %"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_probability_is_rounded_to_certainty() {
        for (probability, text) in [
            (0.0, "under 1 %"),
            (0.004, "under 1 %"),
            (0.01, "1 %"),
            (0.5, "50 %"),
            (0.99, "99 %"),
            (0.997, "99.7 %"),
            (0.9995, "over 99.9 %"),
            (1.0, "over 99.9 %"),
        ] {
            assert_eq!(std::format!("{}", Percent(probability)), text);
        }
    }

    #[test]
    fn three_pixels_are_too_few_points_and_not_another_unit() {
        let three = Evidence {
            residual: crate::polish::Residual {
                source: 1.0,
                target: 1.0,
            },
            inlier_rmse: 0.0,
            near: 0.0,
            within: 0.0,
            inside: 0.0,
            shift_deviation: 1.0,
            distinct_points: 3,
            extents_ratio: 1.0 / 46.2,
            seen_through: 0.0,
            mirror_score: 0.0,
            verified: true,
            support: 0,
            lead: 0.0,
        };
        assert_eq!(Verdict::of_evidence(&three), Verdict::TooFewPoints);
        let many = Evidence {
            distinct_points: 300,
            ..three
        };
        assert_eq!(Verdict::of_evidence(&many), Verdict::SizesDiffer);
    }

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
