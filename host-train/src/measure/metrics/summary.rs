//! Means, medians and areas under the curve over many pairs.

use super::PairMetrics;
use serde::Serialize;

/// Thresholds of the AUC: .001, .002 … .1 of the diameter. The paper's sum also has 0, which only an exact pose
/// meets; the authors' code starts at .001, as does this.
const THRESHOLDS: usize = 100;
const SPACING: f64 = 1e-3;
/// Recall counts a pair whose rotation error is below this, degrees …
const RECALL_R_DEG: f64 = 5.0;
/// … and whose translation error is below this, normalised units.
const RECALL_T: f64 = 0.05;

/// Whether recall counts a pair with these errors, in degrees and normalised units.
pub fn is_right(r_iso_deg: f64, t_iso: f64) -> bool {
    r_iso_deg < RECALL_R_DEG && t_iso < RECALL_T
}

impl PairMetrics {
    /// Whether recall counts this pair.
    pub fn is_right(&self) -> bool {
        is_right(self.r_iso_deg, self.t_iso)
    }
}

/// One row of the paper's tables, over all pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Mean of [`PairMetrics::r_mae_deg`].
    pub r_mae_deg: f64,
    /// Mean of [`PairMetrics::t_mae`].
    pub t_mae: f64,
    /// Mean of [`PairMetrics::r_iso_deg`].
    pub r_iso_deg: f64,
    /// Mean of [`PairMetrics::t_iso`].
    pub t_iso: f64,
    /// Area under the ADI recall curve up to a tenth of the diameter, percent.
    pub adi_auc_pct: f64,
    /// Mean of [`PairMetrics::chamfer_mod`].
    pub chamfer_mod: f64,
    /// Fraction of pairs below 5 degrees and .05 units.
    pub recall_r5_t005: f64,
    /// Median of [`PairMetrics::r_iso_deg`].
    pub r_iso_median_deg: f64,
    /// Median of [`PairMetrics::t_iso`].
    pub t_iso_median: f64,
    /// Median of [`PairMetrics::chamfer_mod`].
    pub chamfer_mod_median: f64,
    /// Area under the ADD recall curve up to a tenth of the diameter, percent.
    pub add_auc_pct: f64,
    /// Share of pairs with [`PairMetrics::ad`] below a tenth of the diameter, percent.
    pub ad10_pct: f64,
    /// The same below a twentieth.
    pub ad05_pct: f64,
    /// The same below a fiftieth.
    pub ad02_pct: f64,
    /// First quartile, median and third quartile of every error.
    pub quartiles: Quartiles,
}

/// First quartile, median and third quartile of each error of [`PairMetrics`], linearly interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quartiles {
    /// Of [`PairMetrics::r_mae_deg`], degrees.
    pub r_mae_deg: [f64; 3],
    /// Of [`PairMetrics::t_mae`].
    pub t_mae: [f64; 3],
    /// Of [`PairMetrics::r_iso_deg`], degrees.
    pub r_iso_deg: [f64; 3],
    /// Of [`PairMetrics::t_iso`].
    pub t_iso: [f64; 3],
    /// Of [`PairMetrics::chamfer_mod`], squared units.
    pub chamfer_mod: [f64; 3],
    /// Of [`PairMetrics::add`], diameters.
    pub add: [f64; 3],
    /// Of [`PairMetrics::adi`], diameters.
    pub adi: [f64; 3],
}

/// The errors of each pair, one list per metric, in the order of the pairs: for plots.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// [`PairMetrics::r_iso_deg`], degrees.
    pub r_iso_deg: Vec<f64>,
    /// [`PairMetrics::t_iso`].
    pub t_iso: Vec<f64>,
    /// [`PairMetrics::adi`], diameters.
    pub adi: Vec<f64>,
    /// [`PairMetrics::add`], diameters.
    pub add: Vec<f64>,
    /// [`PairMetrics::chamfer_mod`], squared units.
    pub chamfer_mod: Vec<f64>,
}

impl Errors {
    /// Lists the errors of `pairs`.
    pub fn of(pairs: &[PairMetrics]) -> Errors {
        let list = |f: fn(&PairMetrics) -> f64| pairs.iter().map(f).collect();
        Errors {
            r_iso_deg: list(|m| m.r_iso_deg),
            t_iso: list(|m| m.t_iso),
            adi: list(|m| m.adi),
            add: list(|m| m.add),
            chamfer_mod: list(|m| m.chamfer_mod),
        }
    }
}

impl Summary {
    /// Summarises the pairs; NaN throughout if there are none.
    pub fn of(pairs: &[PairMetrics]) -> Summary {
        let values = |f: fn(&PairMetrics) -> f64| pairs.iter().map(f).collect::<Vec<f64>>();
        let mean =
            |f: fn(&PairMetrics) -> f64| pairs.iter().map(f).sum::<f64>() / pairs.len() as f64;
        let quartiles = |f| [0.25, 0.5, 0.75].map(|q| quantile(values(f), q));
        let quartiles = Quartiles {
            r_mae_deg: quartiles(|m| m.r_mae_deg),
            t_mae: quartiles(|m| m.t_mae),
            r_iso_deg: quartiles(|m| m.r_iso_deg),
            t_iso: quartiles(|m| m.t_iso),
            chamfer_mod: quartiles(|m| m.chamfer_mod),
            add: quartiles(|m| m.add),
            adi: quartiles(|m| m.adi),
        };
        let recalled = |m: &&PairMetrics| m.is_right();
        let below = |most: f64| {
            100.0 * pairs.iter().filter(|m| m.ad < most).count() as f64 / pairs.len() as f64
        };
        Summary {
            r_mae_deg: mean(|m| m.r_mae_deg),
            t_mae: mean(|m| m.t_mae),
            r_iso_deg: mean(|m| m.r_iso_deg),
            t_iso: mean(|m| m.t_iso),
            adi_auc_pct: 100.0 * auc(&values(|m| m.adi)),
            chamfer_mod: mean(|m| m.chamfer_mod),
            recall_r5_t005: pairs.iter().filter(recalled).count() as f64 / pairs.len() as f64,
            r_iso_median_deg: quartiles.r_iso_deg[1],
            t_iso_median: quartiles.t_iso[1],
            chamfer_mod_median: quartiles.chamfer_mod[1],
            add_auc_pct: 100.0 * auc(&values(|m| m.add)),
            ad10_pct: below(0.10),
            ad05_pct: below(0.05),
            ad02_pct: below(0.02),
            quartiles,
        }
    }
}

/// Area under the recall curve, in [0, 1]: the mean over the thresholds .001 … .1 of the fraction of `errors` (in
/// diameters) that do not exceed the threshold.
pub fn auc(errors: &[f64]) -> f64 {
    let recalled = |k: usize| {
        let threshold = SPACING * k as f64;
        errors.iter().filter(|&&e| e <= threshold).count()
    };
    let sum: usize = (1..=THRESHOLDS).map(recalled).sum();
    sum as f64 / (errors.len() * THRESHOLDS) as f64
}

/// Linearly interpolated quantile, `q` in [0, 1]; NaN for no values.
pub(crate) fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else {
        return f64::NAN;
    };
    let place = q * last as f64;
    let below = place as usize;
    let above = (below + 1).min(last);
    values[below] + (place - below as f64) * (values[above] - values[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auc_counts_errors_up_to_and_including_the_threshold() {
        assert_eq!(auc(&[0.0, 0.0]), 1.0);
        assert_eq!(auc(&[0.2, f64::NAN]), 0.0);
        assert_eq!(auc(&[0.1]), 0.01);
        assert_eq!(auc(&[0.0, 0.0505]), 0.75);
    }

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(vec![3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(quantile(vec![4.0, 1.0], 0.5), 2.5);
        assert_eq!(quantile(vec![7.0], 0.95), 7.0);
        assert!(quantile(vec![], 0.5).is_nan());
    }

    #[test]
    fn recall_needs_both_errors_small() {
        let pair = |r_iso_deg, t_iso| PairMetrics {
            r_mae_deg: 0.0,
            t_mae: 0.0,
            r_iso_deg,
            t_iso,
            chamfer_mod: 0.0,
            add: 0.0,
            adi: 0.0,
            ad: 0.0,
        };
        let all = [
            pair(4.9, 0.049),
            pair(5.0, 0.0),
            pair(0.0, 0.05),
            pair(50.0, 1.0),
        ];
        let summary = Summary::of(&all);
        assert_eq!(summary.recall_r5_t005, 0.25);
        assert!((summary.r_iso_median_deg - 4.95).abs() < 1e-12);
    }
}
