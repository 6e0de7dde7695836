//! Whatever comes in, nothing panics and nothing untrue comes out: policy files, frames, numbers.
//!
//! Each property holds for some hundred cases of a fixed seed, and for the cases that failed once. To look further:
//! `PROPTEST_CASES=100000 PROPTEST_RNG_SEED=7 cargo test --release -p reagent-core --features pretrained-compact --test fuzz`.

mod frames;
mod numbers;
mod policies;

use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// This many cases, of the same seed everywhere, unless the environment asks for others.
fn cases(cases: u32) -> ProptestConfig {
    let asked = ProptestConfig::default();
    let is_set = |name| std::env::var_os(name).is_some();
    ProptestConfig {
        cases: match is_set("PROPTEST_CASES") {
            true => asked.cases,
            false => cases,
        },
        rng_seed: match is_set("PROPTEST_RNG_SEED") {
            true => asked.rng_seed,
            false => RngSeed::Fixed(21),
        },
        failure_persistence: None,
        ..asked
    }
}

/// A number of random bits, a frequent border case, or an ordinary one.
fn number() -> impl Strategy<Value = f32> {
    const BORDERS: [f32; 14] = [
        0.0,
        -0.0,
        1.0,
        1e-45,
        f32::MIN_POSITIVE,
        1e-20,
        1e12,
        1.000_1e12,
        1e19,
        3.4e38,
        f32::MAX,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    prop_oneof![
        any::<u32>().prop_map(f32::from_bits),
        prop::sample::select(&BORDERS[..]),
        -2.0f32..2.0,
    ]
}
