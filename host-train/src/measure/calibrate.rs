//! Fits the probability that a verdict gives ([`reagent_core::verdict`]): a logistic model of a few values, on
//! pairs of training models drawn as they are, in parts, without noise, distorted, as views with and without their view points, and
//! with the target of another mesh.

mod fit;
mod kind;

pub use fit::{fit, probability};
pub use kind::Kind;

use super::method::task_of;
use super::metrics::GroundTruth;
use crate::dataset::Model;
use crate::dataset::pairs::PairSet;
use crate::views::Views;
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;
use reagent_core::evidence::FEATURES;
use reagent_core::net::Scratch;
use reagent_core::pipeline::{Mode, Progress, Refinement, Task, refine, register};
use reagent_core::polish::Workspace;
use reagent_core::{Error, Policy, Pose, Registrar};

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
    for kind in Kind::ALL {
        let set = kind.draw(models, views, count, seed);
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
    let go_on = |_: Progress<'_, '_>| Ok::<(), Error>(());
    let task = Task {
        mode: Mode::Fast,
        ..task_of(set.seen(i))
    };
    let reached = register(
        &mut registrar,
        &mut memory.1,
        [source, target],
        &task,
        go_on,
    )?;
    let initial = reached.target_from_source;
    let raw = set.raw.as_ref().map(|raw| &raw[i][..]);
    let truth = GroundTruth::new(source, target, raw, set.target_from_source[i])?;
    let mut row = |mode| -> Result<Row, Error> {
        let task = Task {
            mode,
            ..task_of(set.seen(i))
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
    let open = &found.undetermined;
    let given = found.refined.target_from_source;
    let slid = |given: Pose| {
        open.slide.is_some_and(|slide| {
            // Where the target's origin comes from, the truth puts it back.
            let off = -given.apply(true_pose.inverse().apply(Vec3::ZERO));
            let [least, most] = slide.range;
            let shift = off.dot(slide.direction).clamp(least, most);
            is_right(Pose {
                translation: given.translation + slide.direction * shift,
                ..given
            })
        })
    };
    let turned = |given: Pose| {
        open.axis.is_some_and(|axis| {
            let turn = turn_about(
                axis.direction,
                true_pose.rotation * given.rotation.transpose(),
            );
            let [least, most] = axis.range_rad;
            let rotation = Mat3::from_axis_angle(axis.direction, turn);
            let turned = Pose {
                rotation: rotation * given.rotation,
                translation: axis.point + rotation * (given.translation - axis.point),
            };
            (least..=most).contains(&turn) && (is_right(turned) || slid(turned))
        })
    };
    let mut named = core::iter::once(given).chain(open.copies(given));
    named.any(|pose| is_right(pose) || slid(pose) || turned(pose))
}

/// The part of a rotation about an axis, radians (swing and twist).
fn turn_about(axis: Vec3, rotation: Mat3) -> f32 {
    let q = Quat::from_mat3(&rotation);
    let half = Vec3::new(q.x, q.y, q.z).dot(axis).atan2(q.w);
    let turn = 2.0 * half;
    (turn + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU) - std::f32::consts::PI
}
