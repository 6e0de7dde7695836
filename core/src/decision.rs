//! From the logits of an axis to its step.

use crate::dims::{AXES, LOGITS, STEP_SIZES, STEPS_ONE_WAY};
use crate::steps::STEPS;

/// How the step of an axis follows from its logits; the policy file says which way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decision {
    /// The most likely step, as in the paper; the first of equals.
    MostLikely,
    /// The step nearest to the mean, which has the least expected squared error; the first of equals. If steps to both sides
    /// are about as likely, as around an axis of symmetry, it stands still. The most likely step would wander there, in the
    /// same direction again and again.
    NearestToMean,
    /// As `NearestToMean`, but after the first [`STEPS_ONE_WAY`] steps with the mean of two views: how to move the source onto
    /// the target, and the opposite of how to move the target onto the source ([`both_ways`]). Preferences without a reason
    /// cancel out between the views. In the first steps, clouds are farther apart than training showed them in the second view.
    #[default]
    BothWays,
}

impl Decision {
    /// The decision as stored in the header of a policy file.
    pub const fn header(self) -> u16 {
        match self {
            Decision::MostLikely => 0,
            Decision::NearestToMean => 1,
            Decision::BothWays => 2,
        }
    }

    /// The decision that a header states.
    pub fn from_header(word: u16) -> Option<Decision> {
        let all = [
            Decision::MostLikely,
            Decision::NearestToMean,
            Decision::BothWays,
        ];
        all.into_iter().find(|decision| decision.header() == word)
    }

    /// Ways in which the heads look at the clouds after `steps` steps: 1, or 2 for [`both_ways`].
    pub fn ways(self, steps: usize) -> usize {
        match self {
            Decision::BothWays if steps >= STEPS_ONE_WAY => 2,
            _ => 1,
        }
    }

    /// Step ids of a head's three axes, from its logits.
    pub fn steps(self, logits: &[f32; LOGITS]) -> [u8; AXES] {
        let mut ids = [0; AXES];
        let (axes, _) = logits.as_chunks();
        for (id, axis) in ids.iter_mut().zip(axes) {
            *id = self.step(axis);
        }
        ids
    }

    /// Step id of one axis.
    pub fn step(self, logits: &[f32; STEP_SIZES]) -> u8 {
        match self {
            Decision::MostLikely => first_least(logits.map(|logit| -logit)),
            Decision::NearestToMean | Decision::BothWays => {
                let mean = mean(probabilities(logits));
                first_least(STEPS.map(|step| (step - mean).abs()))
            }
        }
    }

    /// Whether every axis of a head has a clear step: logits that are each off by at most `error` give the same one.
    pub fn is_clear(self, logits: &[f32; LOGITS], error: f32) -> bool {
        let (axes, _) = logits.as_chunks();
        axes.iter().all(|axis| self.is_clear_step(axis, error))
    }

    fn is_clear_step(self, logits: &[f32; STEP_SIZES], error: f32) -> bool {
        let (values, off) = match self {
            Decision::MostLikely => (logits.map(|logit| -logit), error),
            Decision::NearestToMean | Decision::BothWays => {
                let probabilities = probabilities(logits);
                let mean = mean(probabilities);
                let terms = STEPS.iter().zip(probabilities);
                let spread: f32 = terms.map(|(step, p)| p * (step - mean).abs()).sum();
                // Each weight is off by at most this share of itself, and so is their sum.
                let off = (libm::expf(2.0 * error) - 1.0) * spread;
                (STEPS.map(|step| (step - mean).abs()), off)
            }
        };
        let (mut first, mut second) = (f32::INFINITY, f32::INFINITY);
        for value in values {
            if value < first {
                (first, second) = (value, first);
            } else if value < second {
                second = value;
            }
        }
        second - first > 2.0 * off
    }
}

/// Softmax of an axis's logits. It runs in f32, in the order of the step table, with libm's `expf`: the same bits everywhere.
fn probabilities(logits: &[f32; STEP_SIZES]) -> [f32; STEP_SIZES] {
    let most = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let weights = logits.map(|logit| libm::expf(logit - most));
    let mut total = 0.0;
    for weight in weights {
        total += weight;
    }
    weights.map(|weight| weight / total)
}

/// Mean step of an axis.
fn mean(probabilities: [f32; STEP_SIZES]) -> f32 {
    let mut mean = 0.0;
    for (step, p) in STEPS.iter().zip(probabilities) {
        mean += p * step;
    }
    mean
}

/// Logits of a head with averaged probabilities: half from moving the source onto the target (`forth`), half from moving the
/// target onto the source with each step reversed (`back`).
pub fn both_ways(forth: &[f32; LOGITS], back: &[f32; LOGITS]) -> [f32; LOGITS] {
    let mut logits = [0.0; LOGITS];
    let (axes, _) = logits.as_chunks_mut::<STEP_SIZES>();
    let ((forth, _), (back, _)) = (forth.as_chunks(), back.as_chunks());
    for ((logits, forth), back) in axes.iter_mut().zip(forth).zip(back) {
        let [forth, mut back] = [forth, back].map(probabilities);
        back.reverse();
        for ((logit, forth), back) in logits.iter_mut().zip(forth).zip(back) {
            *logit = libm::logf((0.5 * (forth + back)).max(f32::MIN_POSITIVE));
        }
    }
    logits
}

/// Index of the smallest value, the first of equals.
fn first_least(values: [f32; STEP_SIZES]) -> u8 {
    let (mut least, mut id) = (f32::INFINITY, 0);
    for (i, &value) in values.iter().enumerate() {
        if value < least {
            (least, id) = (value, i as u8);
        }
    }
    id
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::steps::STOP;

    fn of(probabilities: &[(usize, f32)]) -> [f32; STEP_SIZES] {
        let mut logits = [-30.0; STEP_SIZES];
        for &(i, p) in probabilities {
            logits[i] = 7.0 + p.ln();
        }
        logits
    }

    #[test]
    fn who_is_certain_decides_alike_and_who_is_torn_stands_still() {
        let [likely, mean] = [Decision::MostLikely, Decision::NearestToMean];
        for i in 0..STEP_SIZES {
            let certain = of(&[(i, 1.0)]);
            assert_eq!([likely, mean].map(|d| d.step(&certain)), [i as u8; 2]);
        }
        let torn = of(&[(0, 0.45), (10, 0.4), (5, 0.15)]);
        // The mean is -.0135.
        assert_eq!([likely, mean].map(|d| d.step(&torn)), [0, 3]);
        let even = of(&[(0, 0.5), (10, 0.5)]);
        assert_eq!([likely, mean].map(|d| d.step(&even)), [0, STOP]);
        // The mean is nearer to .03 than to .09.
        let between = of(&[(8, 0.55), (9, 0.45)]);
        assert_eq!([likely, mean].map(|d| d.step(&between)), [8, 8]);
        let flat = [3.0; STEP_SIZES];
        assert_eq!([likely, mean].map(|d| d.step(&flat)), [0, STOP]);
    }

    #[test]
    fn a_choice_is_clear_as_long_as_no_small_error_changes_it() {
        let [likely, mean] = [Decision::MostLikely, Decision::NearestToMean];
        let close = of(&[(3, 0.5), (4, 0.4999)]);
        assert!(!likely.is_clear_step(&close, 1e-3) && likely.is_clear_step(&close, 1e-5));
        // The mean lies between the two steps and is clearly nearer to one of them.
        let third = of(&[(8, 0.7), (9, 0.3)]);
        assert!(mean.is_clear_step(&third, 1e-3));
        // The mean is .06, as far from .03 as from .09.
        let middle = of(&[(8, 0.5), (9, 0.5)]);
        assert!(!mean.is_clear_step(&middle, 1e-3));
        assert!(mean.is_clear_step(&of(&[(8, 1.0)]), 1e-3));
    }

    #[test]
    fn what_both_ways_prefer_for_no_reason_cancels_out() {
        let mut forth = [0.0; LOGITS];
        let (axes, _) = forth.as_chunks_mut();
        axes.copy_from_slice(&[
            of(&[(9, 1.0)]),
            of(&[(8, 0.6), (2, 0.4)]),
            of(&[(6, 0.9), (5, 0.1)]),
        ]);
        let mut back = forth;
        back.reverse();
        // Axes in their own order again, each reversed: the target sees the opposite of what the source sees.
        let (axes, _) = back.as_chunks_mut::<STEP_SIZES>();
        axes.reverse();
        let agreed = both_ways(&forth, &back);
        let probabilities_of = |logits: &[f32; LOGITS]| {
            let (axes, _) = logits.as_chunks();
            [0, 1, 2].map(|axis| probabilities(&axes[axis]))
        };
        for (found, expected) in probabilities_of(&agreed)
            .iter()
            .zip(probabilities_of(&forth))
        {
            assert!(
                found
                    .iter()
                    .zip(expected)
                    .all(|(f, e)| (f - e).abs() < 1e-6)
            );
        }
        // The target sees the same, not the opposite: both views cancel out.
        let torn = both_ways(&forth, &forth);
        assert_eq!(Decision::BothWays.steps(&torn), [STOP; AXES]);
    }

    #[test]
    fn both_ways_come_after_the_first_steps() {
        let of = |decision: Decision| [0, 3, 4, 9].map(|steps| decision.ways(steps));
        assert_eq!(of(Decision::BothWays), [1, 1, 2, 2]);
        assert_eq!(of(Decision::NearestToMean), [1; 4]);
        assert_eq!(of(Decision::MostLikely), [1; 4]);
    }

    #[test]
    fn heads_are_three_axes() {
        let mut logits = [0.0; LOGITS];
        for (axis, id) in [2, 10, 5].into_iter().enumerate() {
            logits[axis * STEP_SIZES + id] = 40.0;
        }
        for (i, decision) in [
            Decision::MostLikely,
            Decision::NearestToMean,
            Decision::BothWays,
        ]
        .into_iter()
        .enumerate()
        {
            assert_eq!(decision.steps(&logits), [2, 10, 5]);
            assert_eq!(decision.header(), i as u16);
            assert_eq!(Decision::from_header(i as u16), Some(decision));
        }
        assert_eq!(Decision::from_header(3), None);
    }
}
