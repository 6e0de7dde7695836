//! The logistic model of a verdict's probability.

use super::Row;
use nalgebra::{SMatrix, SVector};
use reagent_core::evidence::FEATURES;

/// Newton steps of the fit.
const NEWTON: usize = 30;
/// Factor of the ridge penalty on the squared weights.
const RIDGE: f64 = 0.1;

/// Fits the weights by maximum likelihood with a ridge penalty.
pub fn fit<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> [f64; FEATURES] {
    let mut weights = SVector::<f64, FEATURES>::zeros();
    for _ in 0..NEWTON {
        let mut hessian = SMatrix::<f64, FEATURES, FEATURES>::identity() * RIDGE;
        let mut gradient = -weights * RIDGE;
        for row in rows.clone() {
            let x = SVector::<f64, FEATURES>::from_fn(|k, _| f64::from(row.features[k]));
            let p = logistic(weights.dot(&x));
            gradient += x * (f64::from(u8::from(row.right)) - p);
            hessian += x * x.transpose() * (p * (1.0 - p));
        }
        let Some(factor) = hessian.cholesky() else {
            break;
        };
        weights += factor.solve(&gradient);
    }
    weights.into()
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// The model's probability that a row is right.
pub fn probability(row: &Row, weights: &[f64; FEATURES]) -> f64 {
    let terms = row.features.iter().zip(weights);
    logistic(terms.map(|(&x, w)| f64::from(x) * w).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_recovers_the_model_that_drew_the_rows() {
        // Rows repeated as often as the model says they are right.
        let mut rows = Vec::new();
        for k in 0..21 {
            let x = k as f32 / 10.0 - 1.0;
            let p = logistic(f64::from(3.0 * x - 1.0));
            let mut features = [0.0; FEATURES];
            (features[0], features[1]) = (1.0, x);
            for n in 0..1000 {
                rows.push(Row {
                    features,
                    right: (f64::from(n) + 0.5) / 1000.0 < p,
                    probability: 0.5,
                });
            }
        }
        let weights = fit(rows.iter());
        assert!((weights[0] + 1.0).abs() < 0.02 && (weights[1] - 3.0).abs() < 0.02);
        assert!(weights[2..].iter().all(|w| w.abs() < 1e-9));
        assert!((probability(&rows[0], &weights) - logistic(-4.0)).abs() < 0.002);
    }
}
