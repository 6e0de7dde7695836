//! How probably a refined pose is right, judged by how the clouds fit under it and under other poses.

use crate::mirror::MIRRORED;
use crate::polish::{Refined, Residual};
use crate::verify::Verified;

/// Evidence for and against a refined pose. None of it comes from the policy, so it holds for any policy and without one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// How well the clouds fit.
    pub residual: Residual,
    /// [`Refined::inlier_rmse`], in target radii.
    pub inlier_rmse: f32,
    /// [`Refined::near`].
    pub near: f32,
    /// [`Refined::within`].
    pub within: f32,
    /// [`Refined::inside`].
    pub inside: f32,
    /// Standard deviation of the translation, in target radii ([`crate::covariance::Covariance::shift_deviation`]).
    pub shift_deviation: f32,
    /// [`Refined::distinct_points`].
    pub distinct_points: usize,
    /// [`Refined::extents_ratio`].
    pub extents_ratio: f32,
    /// [`Refined::seen_through`].
    pub seen_through: f32,
    /// [`Verified::mirror_score`]; 0 if no mirror image was tried.
    pub mirror_score: f32,
    /// Whether other poses were tried.
    pub verified: bool,
    /// [`Verified::support`]; 0 if no others were tried.
    pub support: usize,
    /// [`Verified::lead`]; infinite if no others were tried.
    pub lead: f32,
}

/// Distinct points below which no pose is called right.
pub const FEWEST_DISTINCT: usize = 64;
/// Size ratio above which a source is in another unit than the target, unless it holds the target
/// and much else. It does if its share of points near the target exceeds the first of `HELD`, and
/// either the target's residual is below the second or the near share of the points that may be
/// the object's exceeds the third. In another unit, at most a ninth of its points lie there.
pub const LARGEST_RATIO: f32 = 3.0;
const HELD: [f32; 3] = [0.15, 0.5, 0.75];
/// Size ratio below which a source is in another unit, or too small a part to place.
pub const SMALLEST_RATIO: f32 = 0.11;
/// See [`Evidence::is_seen_through`].
pub const SEEN_THROUGH: f32 = 0.05;
/// Residuals of source and target from which on that cloud has nothing in common with the other.
const SATURATED: [f32; 2] = [0.95, 0.992];
/// Highest probability of a pose: nothing is certain.
const MOST: f32 = 0.9999;
/// Highest probability of a pose if sizes, too few points, a mirror image, what was seen through it, or saturation speak against it.
const IMPROBABLE: f32 = 0.1;

/// Share of the source that may be the object's above which the rest counts as the object's too: its parts may reach beyond the
/// target. `LEAST_INSIDE` is the smallest share used, since fewer points tell too little.
const A_SCENE: f32 = 0.85;
const LEAST_INSIDE: f32 = 0.2;

/// Number of inputs of the logistic model.
pub const FEATURES: usize = 8;

/// Weights of [`Evidence::features`] for a pose that was only polished, and for one that was compared with others. They were
/// fitted by `host-train calibrate --data DIR --meshes MESHES --count 1000 --seed 7` to pairs drawn and rendered from training
/// meshes: whole clouds, parts, views from known points and others, few points, distorted sources and other objects.
const WEIGHTS: [[f32; FEATURES]; 2] = [
    [
        2.2416, 14.2063, -8.6733, -6.2773, -1.4459, -4.4270, 0.0, 0.0,
    ],
    [
        2.4778, 13.9041, -6.8715, -7.6327, -1.4681, -4.0509, 0.2861, -2.1367,
    ],
];

impl Evidence {
    /// Evidence on a pose that was only polished.
    pub fn polished(found: &Refined) -> Evidence {
        Evidence {
            residual: found.residual,
            inlier_rmse: found.inlier_rmse / found.covariance.radius,
            near: found.near,
            within: found.within,
            inside: found.inside,
            shift_deviation: found.covariance.shift_deviation(),
            distinct_points: found.distinct_points,
            extents_ratio: found.extents_ratio,
            seen_through: found.seen_through,
            mirror_score: 0.0,
            verified: false,
            support: 0,
            lead: f32::INFINITY,
        }
    }

    /// Evidence on a pose that was compared with others.
    pub fn verified(found: &Verified) -> Evidence {
        Evidence {
            mirror_score: found.mirror_score,
            verified: true,
            support: found.support,
            lead: found.lead,
            ..Evidence::polished(&found.best)
        }
    }

    /// Whether one cloud is several times as large as the other.
    pub fn sizes_differ(&self) -> bool {
        let [share, residual, of_inside] = HELD;
        let holds_the_target = self.near > share
            && (self.residual.target < residual || self.near > of_inside * self.inside);
        let largest = if holds_the_target {
            f32::MAX
        } else {
            LARGEST_RATIO
        };
        !(SMALLEST_RATIO..=largest).contains(&self.extents_ratio)
    }

    /// Whether a cloud has fewer than [`FEWEST_DISTINCT`] distinct points.
    pub fn has_too_few_points(&self) -> bool {
        self.distinct_points < FEWEST_DISTINCT
    }

    /// Whether the source fits better as its mirror image.
    pub fn is_mirrored(&self) -> bool {
        self.mirror_score > MIRRORED
    }

    /// Whether the camera looked through more of the target than of any right pose that was tried: the pose is wrong, or what is
    /// in view has less to it.
    pub fn is_seen_through(&self) -> bool {
        self.seen_through > SEEN_THROUGH
    }

    /// Whether one cloud has nothing in common with the other, or a residual is NaN.
    fn is_saturated(&self) -> bool {
        let Residual { source, target } = self.residual;
        let [most_source, most_target] = SATURATED;
        !(source < most_source && target < most_target)
    }

    /// Inputs of the logistic model, each of the order of 1: the constant 1; the shares of the source's points near the
    /// target's surface and in its neighbourhood, relative to those that may be the object's (noise is near, another shape is
    /// not); the target's residual; the log of the translation's deviation; the RMS distance of inliers from the surface; the
    /// log of 1 + support; the runner-up's probability relative to the pose's.
    pub fn features(&self) -> [f32; FEATURES] {
        // Unlike `min` and `max`, these keep NaN.
        let most = |x: f32, most: f32| if x > most { most } else { x };
        let least = |x: f32, least: f32| if x < least { least } else { x };
        let inside = most(least(self.inside, LEAST_INSIDE) / A_SCENE, 1.0);
        [
            1.0,
            self.near / inside,
            self.within / inside,
            self.residual.target,
            libm::logf(least(self.shift_deviation, 1e-5)) + 5.0,
            10.0 * most(self.inlier_rmse, 0.1),
            libm::logf(1.0 + self.support as f32),
            libm::expf(-0.5 * self.lead.max(0.0)),
        ]
    }

    /// Calibrated probability that the pose is within 5 degrees and .05 target radii of the truth or of a pose reported as
    /// fitting as well, or is indistinguishable from the truth (ADI below .02 diameters). It never reaches 1.
    pub fn probability(&self) -> f32 {
        let [alone, compared] = &WEIGHTS;
        let weights = if self.verified { compared } else { alone };
        let weighted = self.features().into_iter().zip(weights).map(|(x, w)| x * w);
        let probability = 1.0 / (1.0 + libm::expf(-weighted.sum::<f32>()));
        let speaks_against = self.sizes_differ()
            || self.has_too_few_points()
            || self.is_mirrored()
            || self.is_seen_through()
            || self.is_saturated();
        if speaks_against || probability.is_nan() {
            probability.min(IMPROBABLE)
        } else {
            probability.min(MOST)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evidence on a pose of a whole cloud that fits well and has no rival.
    const GOOD: Evidence = Evidence {
        residual: Residual {
            source: 0.4,
            target: 0.4,
        },
        inlier_rmse: 0.01,
        near: 0.95,
        within: 0.98,
        inside: 1.0,
        shift_deviation: 0.002,
        distinct_points: 1024,
        extents_ratio: 1.0,
        seen_through: 0.0,
        mirror_score: 0.0,
        verified: true,
        support: 12,
        lead: 8.0,
    };

    #[test]
    fn what_speaks_against_a_pose_makes_it_less_probable() {
        let best = GOOD.probability();
        assert!(best > 0.9, "{best}");
        for worse in [
            Evidence { near: 0.8, ..GOOD },
            Evidence {
                within: 0.7,
                near: 0.68,
                ..GOOD
            },
            Evidence {
                residual: Residual {
                    source: 0.4,
                    target: 0.9,
                },
                ..GOOD
            },
            Evidence {
                shift_deviation: 0.02,
                ..GOOD
            },
            Evidence { support: 1, ..GOOD },
            Evidence {
                inlier_rmse: 0.03,
                ..GOOD
            },
            Evidence { lead: 0.5, ..GOOD },
        ] {
            let probability = worse.probability();
            assert!(probability < best, "{probability} {best} {worse:?}");
        }
    }

    #[test]
    fn no_pose_is_certain() {
        let residual = Residual {
            source: 0.0,
            target: 0.0,
        };
        let perfect = Evidence {
            residual,
            inlier_rmse: 0.0,
            near: 1.0,
            within: 1.0,
            shift_deviation: 1e-6,
            support: 1000,
            lead: f32::INFINITY,
            ..GOOD
        };
        let probability = perfect.probability();
        assert!(0.999 < probability && probability < 1.0, "{probability}");
    }

    #[test]
    fn a_source_may_be_larger_where_it_holds_the_target() {
        let scene = Evidence {
            extents_ratio: 3.4,
            near: 0.3,
            within: 0.32,
            ..GOOD
        };
        assert!(!scene.sizes_differ());
        // A single view leaves most of the target unseen.
        let unseen = Residual {
            source: 0.7,
            target: 0.9,
        };
        let view = Evidence {
            residual: unseen,
            inside: 0.35,
            ..scene
        };
        assert!(!view.sizes_differ());
        let near_little = Evidence {
            inside: 0.8,
            ..view
        };
        assert!(near_little.sizes_differ());
        let in_inches = Evidence { near: 0.1, ..scene };
        assert!(in_inches.sizes_differ());
    }

    #[test]
    fn what_lies_too_far_away_to_be_the_objects_does_not_speak_against_a_pose() {
        let scene = Evidence {
            residual: Residual {
                source: 0.75,
                target: 0.75,
            },
            extents_ratio: 2.0,
            near: 0.38,
            within: 0.4,
            ..GOOD
        };
        let crowded = scene.probability();
        let with_a_table = Evidence {
            inside: 0.42,
            ..scene
        };
        let probability = with_a_table.probability();
        assert!(
            probability > 0.95 && crowded < 0.8,
            "{probability} {crowded}"
        );
    }

    #[test]
    fn what_cannot_be_is_improbable_whatever_fits() {
        let nothing_in_common = Residual {
            source: 0.2,
            target: 1.0,
        };
        for impossible in [
            Evidence {
                extents_ratio: 25.4,
                near: 0.1,
                ..GOOD
            },
            Evidence {
                distinct_points: 20,
                ..GOOD
            },
            Evidence {
                mirror_score: 9.0,
                ..GOOD
            },
            Evidence {
                seen_through: 0.2,
                ..GOOD
            },
            Evidence {
                residual: nothing_in_common,
                ..GOOD
            },
            Evidence {
                near: f32::NAN,
                ..GOOD
            },
            Evidence {
                inlier_rmse: f32::NAN,
                ..GOOD
            },
            Evidence {
                shift_deviation: f32::NAN,
                ..GOOD
            },
        ] {
            let probability = impossible.probability();
            assert!(probability <= IMPROBABLE, "{probability} {impossible:?}");
        }
    }
}
