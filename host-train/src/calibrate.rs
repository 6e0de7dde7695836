//! Fits the probability that a verdict gives ([`reagent_core::verdict`]): a logistic model of a few values, on
//! pairs of training models drawn as they are, in parts, without noise, distorted, as views, and with the target of another mesh.

use crate::augment::{crop, random_direction};
use crate::dataset::pairs::PairSet;
use crate::dataset::{Model, Point};
use crate::measure::metrics::GroundTruth;
use crate::protocol::{Conditions, Protocol, draw, draw_under};
use crate::random::{Purpose, Rng, stream};
use crate::views::Views;
use glam::{Mat3, Quat, Vec3};
use nalgebra::{SMatrix, SVector};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use reagent_core::dims::STEPS;
use reagent_core::evidence::FEATURES;
use reagent_core::net::Scratch;
use reagent_core::pipeline::{Mode, Refinement, Task, refine};
use reagent_core::polish::Workspace;
use reagent_core::start::Start;
use reagent_core::{Error, Frame, Policy, Pose, Registrar};
use serde::Serialize;

/// Newton steps of the fit.
const NEWTON: usize = 30;
/// Weight of the squared weights in the fit.
const RIDGE: f64 = 0.1;
/// Bins of a reliability diagram.
const BINS: usize = 10;

/// One refined registration.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// What the model weighs.
    pub features: [f32; FEATURES],
    /// Whether the pose was right.
    pub right: bool,
    /// Probability by the weights built into the core.
    pub probability: f32,
}

/// How the pairs of a set were drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The noisy protocol.
    Noisy,
    /// The noisy protocol with few points, fewer of them in both clouds.
    Sparse,
    /// Equal clouds without noise.
    Clean,
    /// Sources of which a plane cuts off three tenths.
    Part,
    /// Parts of both clouds, each by a plane of its own.
    Parts,
    /// The noisy protocol with distorted sources.
    Rough,
    /// Parts of the source that are distorted.
    RoughPart,
    /// Targets of another mesh.
    Wrong,
    /// Parts of another mesh.
    WrongParts,
    /// Rendered views.
    View,
    /// Rendered views that are distorted.
    RoughView,
    /// Rendered views of another mesh.
    WrongView,
}

/// Points of each cloud in [`Kind::Sparse`], of a third of the pairs each.
const SPARSE: [usize; 3] = [64, 128, 256];
/// Share of a cloud of which a plane cuts off the rest.
const PART: f32 = 0.7;
/// Points of each cloud of a view.
const VIEW: usize = 1024;
/// Standard deviation of the noise of distorted sources, in sizes of the source: its logarithm is uniform.
const ROUGH_NOISE: [f32; 2] = [0.002, 0.015];
/// Largest bend of distorted sources, in sizes of the source.
const ROUGH_BEND: f32 = 0.02;

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 12] = [
        Kind::Noisy,
        Kind::Sparse,
        Kind::Clean,
        Kind::Part,
        Kind::Parts,
        Kind::Rough,
        Kind::RoughPart,
        Kind::Wrong,
        Kind::WrongParts,
        Kind::View,
        Kind::RoughView,
        Kind::WrongView,
    ];

    /// Whether the clouds are of different things, so that no pose is right.
    pub fn is_wrong(self) -> bool {
        matches!(self, Kind::Wrong | Kind::WrongParts | Kind::WrongView)
    }

    /// Whether the sources are single views.
    fn is_view(self) -> bool {
        matches!(self, Kind::View | Kind::RoughView | Kind::WrongView)
    }

    /// Draws `count` pairs.
    fn draw(self, models: &[Model], views: &Views, count: usize, seed: u64) -> PairSet {
        let noisy = Conditions::of(Protocol::M40Models).expect("it samples independently");
        let under = |conditions: Conditions, count| draw_under(models, &conditions, count, seed);
        let part = Conditions {
            overlap: PART,
            ..noisy
        };
        let mut set = match self {
            Kind::Noisy | Kind::Rough | Kind::Wrong => {
                draw(models, Protocol::M40Models, count, seed)
            }
            Kind::Clean => draw(models, Protocol::M40Clean, count, seed),
            Kind::Sparse => {
                let mut set = PairSet::default();
                for points in SPARSE {
                    set.extend(under(
                        Conditions { points, ..noisy },
                        count.div_ceil(SPARSE.len()),
                    ));
                }
                set
            }
            Kind::Part | Kind::Parts | Kind::RoughPart | Kind::WrongParts => under(part, count),
            Kind::View | Kind::RoughView | Kind::WrongView => {
                let mut set = PairSet::default();
                views.draw(count, VIEW, seed, &mut set);
                set
            }
        };
        if self.is_wrong() {
            let shift = 1.min(set.target.len());
            set.target.rotate_left(shift);
            if let Some(raw) = &mut set.raw {
                raw.rotate_left(shift);
            }
        }
        if matches!(self, Kind::Parts | Kind::WrongParts) {
            for (k, target) in (0..).zip(&mut set.target) {
                crop(&mut stream(seed, Purpose::Augment, k), target, PART);
            }
        }
        if matches!(self, Kind::Rough | Kind::RoughPart | Kind::RoughView) {
            for (k, source) in (0..).zip(&mut set.source) {
                distort(source, &mut stream(seed, Purpose::Augment, k));
            }
        }
        set
    }
}

/// Bends a cloud smoothly and adds noise: sensors are wrong in both ways, models too.
fn distort(points: &mut [Point], rng: &mut Rng) {
    const WAVES: usize = 4;
    let centre = points.iter().copied().map(Vec3::from).sum::<Vec3>() / points.len() as f32;
    // Of most points: pixels that fly lie metres away.
    let mut distances: Vec<f32> = points.iter().map(|&p| centre.distance(p.into())).collect();
    distances.sort_by(f32::total_cmp);
    let size = 4.0 * distances[distances.len() / 2];
    let [least, most] = ROUGH_NOISE.map(f32::ln);
    let noise = size * rng.random_range(least..most).exp();
    let bend = size * rng.random_range(0.0..ROUGH_BEND) / (WAVES as f32).sqrt();
    let waves: [_; WAVES] = std::array::from_fn(|_| {
        let along = random_direction(rng) * rng.random_range(2.0..10.0f32);
        let phase = rng.random_range(0.0..std::f32::consts::TAU);
        (along, phase, random_direction(rng) * bend)
    });
    for point in points {
        let mut p = Vec3::from(*point);
        let place = (p - centre) / size.max(f32::MIN_POSITIVE);
        for (along, phase, by) in waves {
            p += by * (along.dot(place) + phase).sin();
        }
        let normal = [(); 3].map(|()| -> f32 { StandardNormal.sample(rng) });
        *point = (p + Vec3::from(normal) * noise).to_array();
    }
}

/// Registers `count` pairs of each kind, with polishing and with verification: rows by kind and mode. Policies are for whole
/// clouds and for views.
///
/// # Errors
/// Clouds that the core refuses.
pub fn collect(
    [whole, of_views]: [Policy<'_>; 2],
    models: &[Model],
    views: &Views,
    count: usize,
    seed: u64,
) -> Result<Vec<(Kind, Mode, Vec<Row>)>, Error> {
    let mut all = Vec::new();
    for (number, kind) in (0..).zip(Kind::ALL) {
        let set = kind.draw(models, views, count, seed + number);
        let policy = if kind.is_view() { of_views } else { whole };
        let pairs: Result<Vec<[Row; 2]>, Error> = (0..set.source.len())
            .into_par_iter()
            .map_init(
                || Box::new((Scratch::new(), Workspace::new())),
                |memory, i| rows(policy, &set, i, kind, memory),
            )
            .collect();
        let pairs = pairs?;
        for (k, mode) in [Mode::Polish, Mode::Verify].into_iter().enumerate() {
            all.push((kind, mode, pairs.iter().map(|rows| rows[k]).collect()));
        }
    }
    Ok(all)
}

/// A pair polished and verified, from where the policy ends.
fn rows(
    policy: Policy<'_>,
    set: &PairSet,
    i: usize,
    kind: Kind,
    memory: &mut (Scratch, Workspace),
) -> Result<[Row; 2], Error> {
    let (source, target) = (&set.source[i], &set.target[i]);
    let mut registrar = Registrar::new(policy, &mut memory.0);
    let mut registration = registrar.start(source, target, Frame::IDENTITY, Pose::IDENTITY)?;
    for _ in 0..STEPS {
        registrar.step(&mut registration)?;
    }
    let initial = registration.target_from_source();
    let raw = set.raw.as_ref().map(|raw| &raw[i][..]);
    let truth = GroundTruth::new(source, target, raw, set.target_from_source[i])?;
    let mut row = |mode| -> Result<Row, Error> {
        let task = Task {
            mode,
            ..Task::new(Start::at(Pose::IDENTITY))
        };
        let go_on = || Ok::<(), Error>(());
        let found = refine(&mut memory.1, [source, target], initial, &task, go_on)?;
        let found = found.expect("neither mode is fast");
        Ok(Row {
            features: found.evidence.features(),
            right: !kind.is_wrong() && is_right(&truth, set.target_from_source[i], &found),
            probability: found.evidence.probability(),
        })
    };
    Ok([row(Mode::Polish)?, row(Mode::Verify)?])
}

/// ADI, in diameters, below which a pose cannot be told from the true one.
const INDISTINGUISHABLE: f64 = 0.02;

/// Whether a pose is right up to what is named as undetermined, or cannot be told from one that is.
fn is_right(truth: &GroundTruth<'_>, true_pose: Pose, found: &Refinement) -> bool {
    let is_right = |pose| {
        let errors = truth.measure(pose);
        errors.is_right() || errors.adi < INDISTINGUISHABLE
    };
    let given = found.refined.target_from_source;
    let open = &found.undetermined;
    is_right(given)
        || open.poses.iter().flatten().any(|&pose| is_right(pose))
        || open.axis.is_some_and(|axis| {
            let turn = turn_about(
                axis.direction,
                true_pose.rotation * given.rotation.transpose(),
            );
            let rotation = Mat3::from_axis_angle(axis.direction, turn);
            let turned = Pose {
                rotation: rotation * given.rotation,
                translation: axis.point + rotation * (given.translation - axis.point),
            };
            turn.abs() <= axis.half_angle_rad && is_right(turned)
        })
}

/// The part of a rotation about an axis, radians (swing and twist).
fn turn_about(axis: Vec3, rotation: Mat3) -> f32 {
    let q = Quat::from_mat3(&rotation);
    let half = Vec3::new(q.x, q.y, q.z).dot(axis).atan2(q.w);
    let turn = 2.0 * half;
    (turn + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU) - std::f32::consts::PI
}

/// Weights that make the rows most likely.
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

/// Probability of a row by given weights.
pub fn probability(row: &Row, weights: &[f64; FEATURES]) -> f64 {
    let terms = row.features.iter().zip(weights);
    logistic(terms.map(|(&x, w)| f64::from(x) * w).sum())
}

/// How well probabilities tell right from wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Registrations.
    pub count: usize,
    /// Share of them that were right.
    pub right: f64,
    /// Probability that a right one is held more probable than a wrong one: area under the ROC curve; NaN where all
    /// are right or none.
    pub auc: f64,
    /// Mean squared difference between probability and outcome (Brier's score).
    pub brier: f64,
    /// Mean, over all coverages, of the share of wrong ones among the most probable: area under the
    /// risk-coverage curve.
    pub risk_coverage: f64,
    /// Expected calibration error: mean difference of probability and share right, over ten bins.
    pub ece: f64,
    /// Of wrong ones, the share that is held right, with a probability of a half or more; NaN where there are none.
    pub wrong_held_right: f64,
    /// Of right ones, the same.
    pub right_held_right: f64,
    /// Mean probability, share right and count in ten bins of probability.
    pub bins: Vec<[f64; 3]>,
}

impl Quality {
    /// Of `(probability, right)`.
    pub fn of(mut outcomes: Vec<(f64, bool)>) -> Quality {
        outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let count = outcomes.len();
        let right = outcomes.iter().filter(|o| o.1).count();
        let (mut area, mut risk, mut wrong) = (0.0, 0.0, 0usize);
        // Ties count half in the area; in the curve they are taken in the order of the pairs.
        let mut start = 0;
        while start < count {
            let tied = |o: &&(f64, bool)| o.0 == outcomes[start].0;
            let length = outcomes[start..].iter().take_while(tied).count();
            let group = &outcomes[start..start + length];
            let wrong_here = group.iter().filter(|o| !o.1).count();
            let right_here = length - wrong_here;
            area += right_here as f64 * ((count - right - wrong) as f64 - 0.5 * wrong_here as f64);
            start += length;
            wrong += wrong_here;
        }
        wrong = 0;
        for (k, outcome) in outcomes.iter().enumerate() {
            wrong += usize::from(!outcome.1);
            risk += wrong as f64 / (k + 1) as f64;
        }
        let squared = |o: &(f64, bool)| (o.0 - f64::from(u8::from(o.1))).powi(2);
        let mut bins = vec![[0.0; 3]; BINS];
        for &(p, right) in &outcomes {
            let bin = &mut bins[((p * BINS as f64) as usize).min(BINS - 1)];
            bin[0] += p;
            bin[1] += f64::from(u8::from(right));
            bin[2] += 1.0;
        }
        for [p, right, count] in &mut bins {
            let per = 1.0 / count.max(1.0);
            (*p, *right) = (*p * per, *right * per);
        }
        let differences = bins.iter().map(|[p, right, of]| (p - right).abs() * of);
        let held = |right| {
            let of: Vec<f64> = outcomes
                .iter()
                .filter(|o| o.1 == right)
                .map(|o| o.0)
                .collect();
            of.iter().filter(|&&p| p >= 0.5).count() as f64 / of.len() as f64
        };
        Quality {
            count,
            ece: differences.sum::<f64>() / count as f64,
            wrong_held_right: held(false),
            right_held_right: held(true),
            right: right as f64 / count as f64,
            auc: area / (right * (count - right)) as f64,
            brier: outcomes.iter().map(squared).sum::<f64>() / count as f64,
            risk_coverage: risk / count as f64,
            bins,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_is_what_its_definitions_say() {
        let quality = |outcomes: &[(f64, bool)]| Quality::of(outcomes.to_vec());
        let perfect = quality(&[(0.9, true), (0.2, false), (0.8, true)]);
        assert_eq!((perfect.auc, perfect.count), (1.0, 3));
        assert!((perfect.risk_coverage - 1.0 / 9.0).abs() < 1e-12);
        assert_eq!(quality(&[(0.9, false), (0.2, true)]).auc, 0.0);
        let tied = quality(&[(0.5, false), (0.5, true), (0.5, true)]);
        assert_eq!(tied.auc, 0.5);
        assert!((tied.brier - 0.25).abs() < 1e-12);
        assert_eq!(tied.bins[5], [0.5, 2.0 / 3.0, 3.0]);
    }

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
