//! How well probabilities tell right from wrong.

use serde::Serialize;

/// Bins of a reliability diagram.
const BINS: usize = 10;

/// How well probabilities tell right from wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Number of registrations.
    pub count: usize,
    /// Share of them that were right.
    pub right: f64,
    /// Probability that a right registration gets a higher probability than a wrong one: area under the ROC curve;
    /// NaN unless there are both.
    pub auc: f64,
    /// Mean squared difference between probability and outcome (Brier score).
    pub brier: f64,
    /// Mean, over all coverages, of the share of wrong registrations among the most probable: area under the
    /// risk-coverage curve.
    pub risk_coverage: f64,
    /// Expected calibration error: mean difference between probability and share right, over ten bins.
    pub ece: f64,
    /// Share of the wrong registrations with a probability of a half or more; NaN if there are none.
    pub wrong_held_right: f64,
    /// The same share of the right registrations.
    pub right_held_right: f64,
    /// Mean probability, share right and count in ten bins of probability.
    pub bins: Vec<[f64; 3]>,
}

impl Quality {
    /// Measures the quality of pairs `(probability, right)`.
    pub fn of(mut outcomes: Vec<(f64, bool)>) -> Quality {
        outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let count = outcomes.len();
        let right = outcomes.iter().filter(|o| o.1).count();
        let (mut area, mut risk, mut wrong) = (0.0, 0.0, 0usize);
        // Ties count half in the ROC area; the risk-coverage curve takes them in the order of the pairs.
        let mut start = 0;
        while start < count {
            // A NaN equals itself here.
            let tied = |o: &&(f64, bool)| o.0.total_cmp(&outcomes[start].0).is_eq();
            let length = outcomes[start..].iter().take_while(tied).count();
            let group = &outcomes[start..start + length];
            let wrong_here = group.iter().filter(|o| !o.1).count();
            let right_here = length - wrong_here;
            area += right_here as f64 * ((count - right - wrong) as f64 - 0.5 * wrong_here as f64);
            start += length;
            wrong += wrong_here;
        }
        wrong = 0;
        for (k, outcome) in outcomes.iter().enumerate() {
            wrong += usize::from(!outcome.1);
            risk += wrong as f64 / (k + 1) as f64;
        }
        let squared = |o: &(f64, bool)| (o.0 - f64::from(u8::from(o.1))).powi(2);
        let mut bins = vec![[0.0; 3]; BINS];
        for &(p, right) in &outcomes {
            let bin = &mut bins[((p * BINS as f64) as usize).min(BINS - 1)];
            bin[0] += p;
            bin[1] += f64::from(u8::from(right));
            bin[2] += 1.0;
        }
        for [p, right, count] in &mut bins {
            let per = 1.0 / count.max(1.0);
            (*p, *right) = (*p * per, *right * per);
        }
        let differences = bins.iter().map(|[p, right, of]| (p - right).abs() * of);
        let held = |right| {
            let of: Vec<f64> = outcomes
                .iter()
                .filter(|o| o.1 == right)
                .map(|o| o.0)
                .collect();
            of.iter().filter(|&&p| p >= 0.5).count() as f64 / of.len() as f64
        };
        Quality {
            count,
            ece: differences.sum::<f64>() / count as f64,
            wrong_held_right: held(false),
            right_held_right: held(true),
            right: right as f64 / count as f64,
            auc: area / (right * (count - right)) as f64,
            brier: outcomes.iter().map(squared).sum::<f64>() / count as f64,
            risk_coverage: risk / count as f64,
            bins,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_is_what_its_definitions_say() {
        let quality = |outcomes: &[(f64, bool)]| Quality::of(outcomes.to_vec());
        let perfect = quality(&[(0.9, true), (0.2, false), (0.8, true)]);
        assert_eq!((perfect.auc, perfect.count), (1.0, 3));
        assert!((perfect.risk_coverage - 1.0 / 9.0).abs() < 1e-12);
        assert_eq!(quality(&[(0.9, false), (0.2, true)]).auc, 0.0);
        let tied = quality(&[(0.5, false), (0.5, true), (0.5, true)]);
        assert_eq!(tied.auc, 0.5);
        assert!((tied.brier - 0.25).abs() < 1e-12);
        assert_eq!(tied.bins[5], [0.5, 2.0 / 3.0, 3.0]);
        assert_eq!(quality(&[(f64::NAN, true), (0.5, false)]).count, 2);
    }
}
