//! Seeded random streams: a stream depends on the seed and its purpose, never on the thread.

use rand::seq::index;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The generator used everywhere.
pub type Rng = ChaCha8Rng;

/// The default seed.
pub const SEED: u64 = 42;

/// Seeds of the points drawn from a source and from its target. They differ, because a mesh that is registered to
/// itself must not be sampled at the very same points.
pub const fn seeds(seed: u64) -> [u64; 2] {
    [seed, seed.wrapping_add(1)]
}

/// What a stream is for; each purpose has streams of its own.
#[derive(Clone, Copy, Debug)]
pub enum Purpose {
    /// Initial weights.
    Init = 1,
    /// Order of the samples in an epoch.
    Order = 2,
    /// Augmentation of one sample.
    Augment = 3,
    /// Actions sampled in roll-outs.
    Action = 4,
    /// Shuffling of the replay buffer.
    Shuffle = 5,
    /// Shapes of the procedural data set.
    Shape = 6,
    /// Pairs drawn for evaluation.
    Pairs = 7,
    /// Splits of a data set.
    Split = 8,
    /// Points drawn from the surfaces of loose meshes.
    Surface = 20,
    /// Scenes of the BOP generator.
    Scene = 21,
    /// Tuples of matches that a registration tests.
    Tuples = 22,
    /// One part of a pair drawn for a sweep.
    Sweep = 23,
}

/// The stream for `purpose`, number `index`, under `seed`.
pub fn stream(seed: u64, purpose: Purpose, index: u64) -> Rng {
    let mut key = [0u8; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8] = purpose as u8;
    let mut rng = Rng::from_seed(key);
    rng.set_stream(index);
    rng
}

/// Draws `k` items: without replacement if there are enough, otherwise every item once and the rest with replacement.
/// Empty input gives empty output.
pub fn resample<T: Copy>(rng: &mut Rng, items: &[T], k: usize) -> Vec<T> {
    let n = items.len();
    if n == 0 {
        return Vec::new();
    }
    let mut drawn: Vec<T> = index::sample(rng, n, k.min(n))
        .into_iter()
        .map(|i| items[i])
        .collect();
    drawn.extend((n..k).map(|_| items[rng.random_range(0..n)]));
    drawn
}
