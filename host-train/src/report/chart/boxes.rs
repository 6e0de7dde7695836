//! Box statistics as Tukey draws them.

use crate::measure::metrics::quantile;

/// Outliers that are drawn at most for one box.
const OUTLIERS: usize = 60;

/// A coloured group: one box a category, none where there are no values.
#[derive(Clone, Debug)]
pub(crate) struct Boxes {
    /// Name in the legend.
    pub name: String,
    /// A box for each category.
    pub boxes: Vec<Option<BoxStats>>,
    /// Place of each box's colour in the palette.
    pub colours: Vec<usize>,
}

/// Quartiles, whiskers to the last value within 1.5 interquartile ranges, and what lies beyond.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BoxStats {
    /// First quartile, median, third quartile.
    pub quartiles: [f64; 3],
    /// Ends of the whiskers.
    pub whiskers: [f64; 2],
    /// Values beyond the whiskers; the farthest if there are many.
    pub outliers: Vec<f64>,
}

impl BoxStats {
    /// Statistics of the finite values; `None` if there are none.
    pub(crate) fn of(values: &[f64]) -> Option<BoxStats> {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let quartiles = [0.25, 0.5, 0.75].map(|q| quantile(sorted.clone(), q));
        let reach = 1.5 * (quartiles[2] - quartiles[0]);
        let within = |v: &&f64| **v >= quartiles[0] - reach && **v <= quartiles[2] + reach;
        // Between few values a quartile may lie beyond the last value within reach.
        let whiskers = [
            sorted.iter().find(within)?.min(quartiles[0]),
            sorted.iter().rev().find(within)?.max(quartiles[2]),
        ];
        let beyond = |v: &f64| *v < whiskers[0] || *v > whiskers[1];
        let mut outliers: Vec<f64> = sorted.iter().copied().filter(beyond).collect();
        if outliers.len() > OUTLIERS {
            // Evenly over their order, with both ends.
            let last = outliers.len() - 1;
            outliers = (0..OUTLIERS)
                .map(|i| outliers[i * last / (OUTLIERS - 1)])
                .collect();
        }
        Some(BoxStats {
            quartiles,
            whiskers,
            outliers,
        })
    }

    /// Everything that must lie on the axis.
    pub(crate) fn values(&self) -> impl Iterator<Item = f64> + Clone + '_ {
        let [low, high] = self.whiskers;
        [low, high].into_iter().chain(self.outliers.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whiskers_end_at_values_and_outliers_lie_beyond() {
        let stats = BoxStats::of(&[1.0, 2.0, 3.0, 4.0, 5.0, 50.0, f64::NAN]).expect("values");
        assert_eq!(stats.quartiles, [2.25, 3.5, 4.75]);
        assert_eq!(stats.whiskers, [1.0, 5.0]);
        assert_eq!(stats.outliers, [50.0]);
        let few = BoxStats::of(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.1]).expect("values");
        assert!(few.whiskers[1] >= few.quartiles[2], "{few:?}");
        assert_eq!(BoxStats::of(&[f64::NAN]), None);
        assert_eq!(BoxStats::of(&[7.0]).map(|s| s.whiskers), Some([7.0, 7.0]));
    }
}
