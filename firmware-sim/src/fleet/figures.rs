//! Times of a fleet, summarised.

use serde_json::{Value, json};

/// Times in milliseconds, in ascending order.
#[derive(Clone, Debug)]
pub(super) struct Times(Vec<f64>);

impl Times {
    pub(super) fn of(times_ms: impl Iterator<Item = f64>) -> Times {
        let mut times: Vec<f64> = times_ms.collect();
        times.sort_by(f64::total_cmp);
        Times(times)
    }

    /// The time within which this share of them lies; NaN if there are none.
    pub(super) fn percentile(&self, percent: usize) -> f64 {
        let place = (self.0.len() * percent).div_ceil(100).max(1) - 1;
        self.0.get(place).copied().unwrap_or(f64::NAN)
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "p50": self.percentile(50),
            "p95": self.percentile(95),
            "p99": self.percentile(99),
            "max": self.percentile(100),
        })
    }
}

impl std::fmt::Display for Times {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "p50 {:.2}, p95 {:.2}, p99 {:.2}, max {:.2} ms",
            self.percentile(50),
            self.percentile(95),
            self.percentile(99),
            self.percentile(100)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_times_that_were_measured() {
        let times = Times::of((1..=200).rev().map(f64::from));
        let found = [0, 50, 99, 100].map(|p| times.percentile(p));
        assert_eq!(found, [1.0, 100.0, 198.0, 200.0]);
        assert!(Times::of(std::iter::empty()).percentile(50).is_nan());
        assert_eq!(Times::of(std::iter::once(3.0)).percentile(99), 3.0);
    }
}
