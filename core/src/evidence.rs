//! How probably a refined pose is right, from how the clouds fit under it and under others.

use crate::polish::{Refined, Residual};
use crate::verify::Verified;

/// What speaks for and against a refined pose. Nothing of the policy's is in it, so that it holds for any policy and
/// without one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// How the clouds fit.
    pub residual: Residual,
    /// [`Refined::overlap`].
    pub overlap: f32,
    /// [`Refined::rotation_constraint`].
    pub rotation_constraint: f32,
    /// [`Refined::distinct_points`].
    pub distinct_points: usize,
    /// [`Refined::extents_ratio`].
    pub extents_ratio: f32,
    /// Whether other poses were tried.
    pub verified: bool,
    /// [`Verified::margin`].
    pub margin: Option<f32>,
    /// Whether a turn about an axis is named as undetermined ([`crate::verify::Undetermined::axis`]).
    pub axis_is_open: bool,
}

/// Distinct points below which no pose is called right.
pub const FEWEST_DISTINCT: usize = 32;
/// A source more times larger than the target is in another unit: a view and its background are not so large.
pub const LARGEST_RATIO: f32 = 3.0;
/// A source smaller than this share of the target is in another unit, or too small a part to place.
pub const SMALLEST_RATIO: f32 = 0.11;
/// Residuals from which on a side has nothing in common with the other.
const SATURATED: [f32; 2] = [0.95, 0.992];
/// Most that is said of a pose against which one of these speaks.
const IMPROBABLE: f32 = 0.1;

/// Values that the logistic model weighs.
pub const FEATURES: usize = 9;

/// Weights of [`Evidence::features`], fitted on pairs drawn and rendered from training meshes: whole clouds, views, crops,
/// few points and other objects. `host-train calibrate` fits the same model, of fewer kinds.
const WEIGHTS: [f32; FEATURES] = [
    1.6445, -9.5542, 4.5911, 1.8837, 0.2814, 1.3522, -1.9555, 1.1808, 3.2878,
];

impl Evidence {
    /// Of a pose that was polished alone.
    pub fn polished(found: &Refined) -> Evidence {
        Evidence {
            residual: found.residual,
            overlap: found.overlap,
            rotation_constraint: found.rotation_constraint,
            distinct_points: found.distinct_points,
            extents_ratio: found.extents_ratio,
            verified: false,
            margin: None,
            axis_is_open: false,
        }
    }

    /// Of a pose that was compared with others.
    pub fn verified(found: &Verified) -> Evidence {
        Evidence {
            verified: true,
            margin: found.margin,
            axis_is_open: found.undetermined.axis.is_some(),
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

    /// Whether one cloud has nothing in common with the other, or a residual is no number.
    fn is_saturated(&self) -> bool {
        let Residual { source, target } = self.residual;
        let [most_source, most_target] = SATURATED;
        !(source < most_source && target < most_target)
    }

    /// What the logistic model weighs: 1, logarithms of both residuals and of the share of the source that
    /// lies on nothing, of the rotation constraint where no axis is named, of the distinct points, the margin over
    /// other poses (up to 10 standard errors), and whether others were tried.
    pub fn features(&self) -> [f32; FEATURES] {
        let log = |x: f32| libm::logf(x.max(0.01));
        let verified = f32::from(u8::from(self.verified));
        let constraint = if self.axis_is_open {
            1.0 / 3.0
        } else {
            self.rotation_constraint
        };
        let margin = self.margin.unwrap_or(10.0).clamp(0.0, 10.0);
        [
            1.0,
            log(self.residual.source),
            log(self.residual.target),
            log(1.0 - self.overlap),
            log(constraint),
            libm::logf((self.distinct_points as f32).clamp(1.0, 1024.0)) - 6.0,
            verified * (1.0 - 0.1 * margin),
            verified,
            log(1.0 - self.residual.target),
        ]
    }

    /// Calibrated probability that the pose is within 5 degrees and .05 target radii of the truth, or of what is named
    /// as fitting as well.
    pub fn probability(&self) -> f32 {
        let weighted = self.features().into_iter().zip(WEIGHTS).map(|(x, w)| x * w);
        let probability = 1.0 / (1.0 + libm::expf(-weighted.sum::<f32>()));
        let speaks_against =
            self.sizes_differ() || self.has_too_few_points() || self.is_saturated();
        if speaks_against || probability.is_nan() {
            probability.min(IMPROBABLE)
        } else {
            probability
        }
    }
}
