//! Errors while one condition is varied and the others stay: the paper's ablation figure, and beyond it.
//!
//! Every value is measured on the same models, points and directions ([`draw_under`]), so that curves differ by
//! what is varied, not by the luck of the draw.

use super::eval::{EvalError, EvalSettings, Row, evaluate};
use crate::dataset::Model;
use crate::measure::method::Contestant;
use crate::measure::metrics::Errors;
use crate::protocol::{Conditions, draw_under};
use reagent_core::dims::MAX_POINTS;
use serde::Serialize;
use std::collections::BTreeMap;

/// Clip of the noise in a sweep over its standard deviation (the paper's; elsewhere it is .05).
const NOISE_CLIP: f32 = 0.1;

/// The condition that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Vary {
    /// Standard deviation of the noise, clipped at .1
    Noise,
    /// Upper bound of the initial rotation about each axis, degrees
    Rotation,
    /// Upper bound of the initial translation along each axis
    Translation,
    /// Share of the source's points left on one side of a random plane
    Overlap,
    /// Points of each cloud
    Points,
    /// Share of the source's points replaced by points uniform in the unit ball
    Outliers,
}

impl Vary {
    /// Everything that can be varied.
    pub const ALL: [Vary; 6] = [
        Vary::Noise,
        Vary::Rotation,
        Vary::Translation,
        Vary::Overlap,
        Vary::Points,
        Vary::Outliers,
    ];

    /// Unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Vary::Noise | Vary::Translation => "normalised units",
            Vary::Rotation => "deg",
            Vary::Overlap | Vary::Outliers => "share",
            Vary::Points => "points",
        }
    }

    /// Values that are measured unless others are asked for.
    pub fn values(self) -> &'static [f64] {
        match self {
            Vary::Noise => &[0.0, 0.01, 0.02, 0.03, 0.04, 0.05],
            Vary::Rotation => &[15.0, 30.0, 45.0, 60.0, 75.0, 90.0],
            Vary::Translation => &[0.0, 0.25, 0.5, 0.75, 1.0],
            Vary::Overlap => &[1.0, 0.9, 0.8, 0.7, 0.6, 0.5],
            Vary::Points => &[64.0, 128.0, 256.0, 512.0, 1024.0, 2048.0],
            Vary::Outliers => &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5],
        }
    }

    /// `base` with this condition at `value`.
    ///
    /// # Errors
    /// A value outside the condition's range.
    pub fn at(self, value: f64, base: &Conditions) -> Result<Conditions, SweepError> {
        let (allowed, range) = match self {
            Vary::Noise => ((0.0..=1.0).contains(&value), "from 0 to 1"),
            Vary::Rotation => ((0.0..=180.0).contains(&value), "from 0 to 180 degrees"),
            Vary::Translation => ((0.0..=10.0).contains(&value), "from 0 to 10"),
            Vary::Overlap => (value > 0.0 && value <= 1.0, "above 0, to 1"),
            Vary::Points => (
                (8.0..=MAX_POINTS as f64).contains(&value) && value.fract() == 0.0,
                "whole, from 8 to 4096",
            ),
            Vary::Outliers => ((0.0..1.0).contains(&value), "from 0, below 1"),
        };
        if !allowed {
            return Err(SweepError::Value {
                vary: self,
                value,
                range,
            });
        }
        let mut conditions = *base;
        let narrow = value as f32;
        match self {
            Vary::Noise => {
                (conditions.noise_sigma, conditions.noise_clip) = (narrow, NOISE_CLIP);
            }
            Vary::Rotation => conditions.max_angle_deg = narrow,
            Vary::Translation => conditions.max_shift = narrow,
            Vary::Overlap => conditions.overlap = narrow,
            Vary::Points => conditions.points = value as usize,
            Vary::Outliers => conditions.outliers = narrow,
        }
        Ok(conditions)
    }
}

/// Why a sweep was refused.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A value outside its range.
    #[error("{value} is no value for {vary:?}: it must be {range}")]
    Value {
        /// What was to be varied.
        vary: Vary,
        /// The value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// A registration was refused.
    #[error("{vary:?} at {value}")]
    Eval {
        /// What was varied.
        vary: Vary,
        /// The value.
        value: f64,
        /// What went wrong.
        source: EvalError,
    },
}

/// Results of one method at one value.
#[derive(Clone, Debug, Serialize)]
pub struct At {
    /// The value.
    pub value: f64,
    /// Errors over all pairs, and times.
    pub summary: Row,
    /// Errors pair by pair.
    pub errors: Errors,
}

/// Results of all methods while one condition was varied.
#[derive(Clone, Debug, Serialize)]
pub struct Varied {
    /// The condition.
    pub vary: Vary,
    /// Unit of its values.
    pub unit: &'static str,
    /// Pairs at each value.
    pub pairs: usize,
    /// By method, its results in the order of the values.
    pub methods: BTreeMap<String, Vec<At>>,
}

/// The document that `sweep --json` writes.
#[derive(Debug, Serialize)]
pub struct Document {
    /// One entry for each condition that was varied.
    pub sweep: Vec<Varied>,
}

/// What pairs are drawn from, and the conditions where nothing is varied.
#[derive(Clone, Copy, Debug)]
pub struct Drawing<'a> {
    /// Models, at least one.
    pub models: &'a [Model],
    /// Conditions, but for the one that is varied.
    pub base: Conditions,
    /// Pairs at each value.
    pub count: usize,
    /// Seed of all draws.
    pub seed: u64,
}

/// Registers all pairs by every contestant at every value of one condition. `progress` is called once per registration.
///
/// # Errors
/// A value outside the condition's range, before anything is measured; whatever [`evaluate`] refuses.
pub fn sweep(
    drawing: &Drawing<'_>,
    vary: Vary,
    values: &[f64],
    contestants: &[Contestant<'_>],
    settings: &EvalSettings,
    progress: &(dyn Fn() + Sync),
) -> Result<Varied, SweepError> {
    let at = |&value: &f64| Ok((value, vary.at(value, &drawing.base)?));
    let conditions: Vec<(f64, Conditions)> = values.iter().map(at).collect::<Result<_, _>>()?;
    let mut methods: BTreeMap<String, Vec<At>> = BTreeMap::new();
    for (value, conditions) in conditions {
        let set = draw_under(drawing.models, &conditions, drawing.count, drawing.seed);
        let outcomes =
            evaluate(&set, contestants, settings, progress).map_err(|source| SweepError::Eval {
                vary,
                value,
                source,
            })?;
        for outcome in outcomes {
            methods.entry(outcome.name).or_default().push(At {
                value,
                summary: outcome.row,
                errors: outcome.errors,
            });
        }
    }
    Ok(Varied {
        vary,
        unit: vary.unit(),
        pairs: drawing.count,
        methods,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::measure::method::{Finish, Start};
    use crate::protocol::Protocol;

    fn base() -> Conditions {
        Conditions::of(Protocol::M40Models).expect("independent samples")
    }

    #[test]
    fn values_change_their_own_condition_and_are_checked() {
        for vary in Vary::ALL {
            let mut seen = Vec::new();
            for &value in vary.values() {
                let conditions = vary.at(value, &base()).expect("a default");
                assert!(!seen.contains(&conditions), "{vary:?} {value}");
                seen.push(conditions);
            }
            for value in [-0.1, f64::NAN, 1e9] {
                assert!(vary.at(value, &base()).is_err(), "{vary:?} {value}");
            }
        }
        assert!(Vary::Points.at(64.5, &base()).is_err());
        assert!(Vary::Overlap.at(0.0, &base()).is_err());
        assert!(Vary::Outliers.at(1.0, &base()).is_err());
    }

    #[test]
    fn initial_errors_follow_the_bound_of_the_offset_exactly() {
        let models: Vec<Model> = (0..4).map(|i| procedural::model(7, i)).collect();
        let contestants = [Contestant {
            name: "init".into(),
            method: Start::Identity.then(Finish::Nothing),
        }];
        let run = |vary, threads| {
            let settings = EvalSettings {
                steps: 1,
                threads,
                per_step: false,
            };
            let values = [0.25, 0.5, 1.0];
            let drawing = Drawing {
                models: &models,
                base: base(),
                count: 4,
                seed: 3,
            };
            sweep(&drawing, vary, &values, &contestants, &settings, &|| {}).expect("valid")
        };
        let varied = run(Vary::Overlap, 1);
        let lines = &varied.methods["init"];
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[0].errors.r_iso_deg, lines[2].errors.r_iso_deg);
        assert_eq!(
            lines[0].errors,
            run(Vary::Overlap, 2).methods["init"][0].errors
        );

        let varied = run(Vary::Translation, 1);
        let (half, whole) = (&varied.methods["init"][1], &varied.methods["init"][2]);
        assert_eq!(half.errors.r_iso_deg, whole.errors.r_iso_deg);
        assert_eq!((half.value, varied.pairs), (0.5, 4));
        for (a, b) in half.errors.t_iso.iter().zip(&whole.errors.t_iso) {
            assert!((b - 2.0 * a).abs() < 1e-5, "{a} {b}");
        }
    }
}
