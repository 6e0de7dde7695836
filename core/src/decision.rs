//! From the logits of an axis to its step.

use crate::dims::{AXES, LOGITS, STEP_SIZES};
use crate::steps::STEPS;

/// Which step of an axis is taken; the policy file says which.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decision {
    /// The most likely one, as in the paper; the first of equals.
    MostLikely,
    /// The one nearest to the mean step, which has the least expected squared error; the first of equals. Where steps
    /// to both sides are about as likely, as around an axis of symmetry, it stands still: the most likely one
    /// wanders there, in the same direction again and again.
    #[default]
    NearestToMean,
}

impl Decision {
    /// As the header of a policy file stores it.
    pub const fn header(self) -> u16 {
        match self {
            Decision::MostLikely => 0,
            Decision::NearestToMean => 1,
        }
    }

    /// The decision that a header announces.
    pub fn from_header(word: u16) -> Option<Decision> {
        [Decision::MostLikely, Decision::NearestToMean]
            .into_iter()
            .find(|decision| decision.header() == word)
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

    /// Step id of one axis. In f32 and in the order of the step table, with `expf` as in libm: the same bits everywhere.
    pub fn step(self, logits: &[f32; STEP_SIZES]) -> u8 {
        match self {
            Decision::MostLikely => first_least(logits.map(|logit| -logit)),
            Decision::NearestToMean => {
                let most = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let (mut sum, mut total) = (0.0, 0.0);
                for (step, logit) in STEPS.iter().zip(logits) {
                    let weight = libm::expf(logit - most);
                    sum += weight * step;
                    total += weight;
                }
                let mean = sum / total;
                first_least(STEPS.map(|step| (step - mean).abs()))
            }
        }
    }
}

/// Index of the least value, the first of equals.
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
        // Mean -.0135.
        assert_eq!([likely, mean].map(|d| d.step(&torn)), [0, 3]);
        let even = of(&[(0, 0.5), (10, 0.5)]);
        assert_eq!([likely, mean].map(|d| d.step(&even)), [0, STOP]);
        // Half of .03 and half of .09.
        let between = of(&[(8, 0.55), (9, 0.45)]);
        assert_eq!([likely, mean].map(|d| d.step(&between)), [8, 8]);
        let flat = [3.0; STEP_SIZES];
        assert_eq!([likely, mean].map(|d| d.step(&flat)), [0, STOP]);
    }

    #[test]
    fn heads_are_three_axes() {
        let mut logits = [0.0; LOGITS];
        for (axis, id) in [2, 10, 5].into_iter().enumerate() {
            logits[axis * STEP_SIZES + id] = 40.0;
        }
        for decision in [Decision::MostLikely, Decision::NearestToMean] {
            assert_eq!(decision.steps(&logits), [2, 10, 5]);
            assert_eq!(Decision::from_header(decision.header()), Some(decision));
        }
        assert_eq!(Decision::from_header(2), None);
    }
}
