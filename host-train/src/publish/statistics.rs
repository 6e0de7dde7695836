//! Exact tests on counts.

/// ln n! for every n up to `most`.
fn ln_factorials(most: u64) -> Vec<f64> {
    let mut sum = 0.0;
    let factorials = (1..=most).map(|n| {
        sum += (n as f64).ln();
        sum
    });
    std::iter::once(0.0).chain(factorials).collect()
}

/// Probability of at least `least` heads in `trials` throws of a fair coin.
pub(super) fn coin(least: u64, trials: u64) -> f64 {
    let ln = ln_factorials(trials);
    let choose = |k: u64| ln[trials as usize] - ln[k as usize] - ln[(trials - k) as usize];
    let all = trials as f64 * f64::ln(2.0);
    let p: f64 = (least..=trials).map(|k| (choose(k) - all).exp()).sum();
    p.min(1.0)
}

/// Probability that a group of `drawn` has at most `most` of the `marked` among `all`: Fisher's exact test, one-sided
/// (<https://doi.org/10.2307/2340521>).
pub(super) fn fisher(most: u64, drawn: u64, marked: u64, all: u64) -> f64 {
    let ln = ln_factorials(all);
    let choose = |n: u64, k: u64| ln[n as usize] - ln[k as usize] - ln[(n - k) as usize];
    let fewest = (drawn + marked).saturating_sub(all);
    let p: f64 = (fewest..=most.min(drawn).min(marked))
        .map(|k| {
            let ways = choose(marked, k) + choose(all - marked, drawn - k);
            (ways - choose(all, drawn)).exp()
        })
        .sum();
    p.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_sums_of_ways() {
        // Binomial coefficients, divided by 2^n or by those of the whole, by hand.
        for (found, expected) in [
            (coin(0, 0), 1.0),
            (coin(1, 1), 0.5),
            (coin(7, 8), 9.0 / 256.0),
            (coin(5, 10), 638.0 / 1024.0),
            (fisher(3, 4, 4, 8), 69.0 / 70.0),
            (fisher(0, 4, 4, 8), 1.0 / 70.0),
            (fisher(4, 4, 4, 8), 1.0),
            (fisher(1, 3, 4, 5), 0.0),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert!(coin(5000, 10_000) > 0.5 && coin(700, 1200) < 1e-6);
        assert!(fisher(40, 100, 900, 1000) < 1e-20);
    }
}
