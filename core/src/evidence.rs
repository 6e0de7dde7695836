//! How probably a refined pose is right, from how the clouds fit under it and under others.

use crate::polish::{Refined, Residual};
use crate::verify::Verified;

/// What speaks for and against a refined pose. Nothing of the policy's is in it, so that it holds for any policy and
/// without one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// How the clouds fit.
    pub residual: Residual,
    /// [`Refined::near`].
    pub near: f32,
    /// [`Refined::within`].
    pub within: f32,
    /// [`Refined::distinct_points`].
    pub distinct_points: usize,
    /// [`Refined::extents_ratio`].
    pub extents_ratio: f32,
    /// [`Verified::mirror_score`]; 0 where it was not looked for.
    pub mirror_score: f32,
    /// Whether other poses were tried.
    pub verified: bool,
}

/// Distinct points below which no pose is called right.
pub const FEWEST_DISTINCT: usize = 48;
/// A source more times larger than the target is in another unit: a view and its background are not so large.
pub const LARGEST_RATIO: f32 = 3.0;
/// A source smaller than this share of the target is in another unit, or too small a part to place.
pub const SMALLEST_RATIO: f32 = 0.11;
/// Standard errors from which on it is no chance that the mirror image fits better: more than of independent points, since
/// errors of neighbours are alike. Of right poses of training models, none had as many.
const MIRRORED: f32 = 5.0;
/// Residuals from which on a side has nothing in common with the other.
const SATURATED: [f32; 2] = [0.95, 0.992];
/// Most that is said of a pose against which one of these speaks.
const IMPROBABLE: f32 = 0.1;

/// Values that the logistic model weighs.
pub const FEATURES: usize = 6;

/// Weights of [`Evidence::features`], fitted by `host-train calibrate --data DIR --meshes MESHES --count 300 --seed 7` to pairs
/// drawn and rendered from training meshes: whole clouds, parts, views, few points, distorted sources and other objects.
const WEIGHTS: [f32; FEATURES] = [-0.7659, 1.0596, -1.3268, -0.4719, 3.2803, 1.7152];

impl Evidence {
    /// Of a pose that was polished alone.
    pub fn polished(found: &Refined) -> Evidence {
        Evidence {
            residual: found.residual,
            near: found.near,
            within: found.within,
            distinct_points: found.distinct_points,
            extents_ratio: found.extents_ratio,
            mirror_score: 0.0,
            verified: false,
        }
    }

    /// Of a pose that was compared with others.
    pub fn verified(found: &Verified) -> Evidence {
        Evidence {
            mirror_score: found.mirror_score,
            verified: true,
            ..Evidence::polished(&found.best)
        }
    }

    /// Whether one cloud is several times as large as the other.
    pub fn sizes_differ(&self) -> bool {
        !(SMALLEST_RATIO..=LARGEST_RATIO).contains(&self.extents_ratio)
    }

    /// Whether a cloud has fewer than [`FEWEST_DISTINCT`] distinct points.
    pub fn has_too_few_points(&self) -> bool {
        self.distinct_points < FEWEST_DISTINCT
    }

    /// Whether the source fits better as its mirror image.
    pub fn is_mirrored(&self) -> bool {
        self.mirror_score > MIRRORED
    }

    /// Whether one cloud has nothing in common with the other, or a residual is no number.
    fn is_saturated(&self) -> bool {
        let Residual { source, target } = self.residual;
        let [most_source, most_target] = SATURATED;
        !(source < most_source && target < most_target)
    }

    /// What the logistic model weighs: 1, and logarithms of
    /// the number of the source's points near the target's surface (in e⁶),
    /// the share of those in its neighbourhood that are not near it: noise is near, another shape is not,
    /// the share of the source outside of its neighbourhood,
    /// and what of the target is explained; then whether other poses were tried.
    pub fn features(&self) -> [f32; FEATURES] {
        let log = |x: f32| libm::logf(x.max(0.01));
        let points = (self.distinct_points as f32).clamp(1.0, 1024.0);
        [
            1.0,
            libm::logf((self.near * points).max(1.0)) - 6.0,
            log(1.0 - self.near / self.within.max(0.01)),
            log(1.0 - self.within),
            log(1.0 - self.residual.target),
            f32::from(u8::from(self.verified)),
        ]
    }

    /// Calibrated probability that the pose is within 5 degrees and .05 target radii of the truth, or of what is named
    /// as fitting as well, or cannot be told from it (ADI below .02 diameters).
    pub fn probability(&self) -> f32 {
        let weighted = self.features().into_iter().zip(WEIGHTS).map(|(x, w)| x * w);
        let probability = 1.0 / (1.0 + libm::expf(-weighted.sum::<f32>()));
        let speaks_against = self.sizes_differ()
            || self.has_too_few_points()
            || self.is_mirrored()
            || self.is_saturated();
        if speaks_against || probability.is_nan() {
            probability.min(IMPROBABLE)
        } else {
            probability
        }
    }
}
