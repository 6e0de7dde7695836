//! What can be said about a pose: from the steps that led to it, and from how the clouds fit under it.

use crate::dims::STEP_SIZES;
use crate::polish::{Refined, Residual};
use crate::steps::{Action, STOP};
use crate::verify::Verified;
use core::fmt;

/// How many kinds of [`Verdict`] there are.
pub const VERDICTS: usize = Verdict::PoorFit as usize + 1;

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
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Verdict::Converged => "converged",
            Verdict::StepLimit => "step limit",
            Verdict::Oscillating => "oscillating",
            Verdict::OutOfRange => "out of range",
            Verdict::PoorFit => "poor fit",
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

    /// Of a refined pose that is right with a probability.
    pub fn of_probability(probability: f32) -> Verdict {
        if probability >= 0.5 {
            Verdict::Converged
        } else {
            Verdict::PoorFit
        }
    }
}

/// What speaks for and against a refined pose. Nothing of the policy's is in it, so that it holds for any policy and
/// without one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// How the clouds fit.
    pub residual: Residual,
    /// [`Refined::grip`].
    pub grip: f32,
    /// Whether the residual was explained, or other poses were tried.
    pub verified: bool,
    /// Residual over that of the best pose found that differs, 0 where none was looked for.
    pub rivalry: f32,
}

/// Values that the logistic model weighs.
pub const FEATURES: usize = 6;

/// Weights of [`Evidence::features`], fitted by `host-train calibrate --data DIR --count 400 --seed 7` on pairs of
/// training models with the bundled policy.
const WEIGHTS: [f32; FEATURES] = [-10.4621, -1.7997, -7.5765, 0.8172, -3.8885, 2.7964];

impl Evidence {
    /// Of a pose that was polished alone.
    pub fn polished(found: &Refined) -> Evidence {
        Evidence {
            residual: found.residual,
            grip: found.grip,
            verified: false,
            rivalry: 0.0,
        }
    }

    /// Of a pose that was compared with others.
    pub fn verified(found: &Verified) -> Evidence {
        let own = found.best.residual.mean();
        let rival = found.runner_up.map(|other| own / other.mean().max(1e-6));
        Evidence {
            verified: true,
            rivalry: rival.unwrap_or(0.0),
            ..Evidence::polished(&found.best)
        }
    }

    /// What the logistic model weighs: 1, logarithms of the larger and the smaller residual and of the grip,
    /// rivalry from .8 on in units of .2 (at most 1.5), and 1 for a verified pose.
    pub fn features(&self) -> [f32; FEATURES] {
        let log = |x: f32| libm::logf(x.max(0.01));
        let Residual { source, target } = self.residual;
        [
            1.0,
            log(source.max(target)),
            log(source.min(target)),
            log(self.grip),
            (5.0 * (self.rivalry - 0.8)).clamp(0.0, 1.5),
            f32::from(u8::from(self.verified)),
        ]
    }

    /// Calibrated probability that the pose is within 5 degrees and .05 target radii of the truth.
    pub fn probability(&self) -> f32 {
        let weighted = self.features().into_iter().zip(WEIGHTS).map(|(x, w)| x * w);
        1.0 / (1.0 + libm::expf(-weighted.sum::<f32>()))
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

    #[test]
    fn a_good_fit_is_probable_and_a_poor_one_is_not() {
        let evidence = |residual: f32, rivalry: f32| Evidence {
            residual: Residual {
                source: residual,
                target: residual,
            },
            grip: 0.15,
            verified: true,
            rivalry,
        };
        assert!(evidence(0.16, 0.0).probability() > 0.98);
        assert!(evidence(0.16, 0.6).probability() > 0.98);
        assert!(evidence(0.6, 0.98).probability() < 0.05);
        assert!(evidence(0.22, 1.0).probability() < evidence(0.22, 0.8).probability());
    }
}
