//! One registration of two clouds in the user's own units.

use crate::dataset::Point;
use crate::pose64::{Pose64, Position};
use crate::refine::{Mode, Refinement, refine};
use crate::thin::thin;
use crate::trace::Step;
use reagent_core::dims::MAX_POINTS;
use reagent_core::net::Scratch;
use reagent_core::polish::Workspace;
use reagent_core::{Error, Frame, Policy, Pose, Registrar, Verdict};

/// Points to which a cloud that exceeds the capacity is thinned.
pub const SUBSAMPLE: usize = 2048;

/// Where a registration starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// With the clouds as they lie.
    Identity,
    /// From this target_from_source, a plain rigid transform.
    Pose(Pose64),
    /// Nothing is known: the source may be turned in any way.
    None,
}

impl Start {
    /// The pose of the first step, between coordinates relative to two origins.
    pub fn near(&self, source_origin: Position, target_origin: Position) -> Pose {
        let pose = match self {
            Start::Pose(pose) => pose,
            Start::Identity | Start::None => &Pose64::IDENTITY,
        };
        pose.near(source_origin, target_origin)
    }
}

/// A finished registration.
#[derive(Clone, Debug, PartialEq)]
pub struct Registered {
    /// Plain rigid transform in the clouds' units.
    pub target_from_source: Pose,
    /// What can be said about it: by its probability where it was refined, else by the policy's last steps.
    pub verdict: Verdict,
    /// Every step that the policy took.
    pub trace: Vec<Step>,
    /// How the policy's steps ended, and with which pose.
    pub policy: (Verdict, Pose),
    /// What followed, unless the mode is [`Mode::Fast`].
    pub refinement: Option<Refinement>,
}

/// Registers `source [N, 3]` to `target [M, 3]`, both in the same unit of length, from `initial`. The policy
/// sees them in the target's frame: its mean at the origin, its farthest point at 1. Ends early where the
/// policy stops on every axis: it would do so again in every further step. Then what the mode says.
///
/// # Errors
/// Clouds or an initial pose that the core refuses.
pub fn register(
    policy: Policy<'_>,
    source: &[Point],
    target: &[Point],
    initial: Pose,
    steps: usize,
    mode: Mode,
) -> Result<Registered, Error> {
    let mut scratch = Box::new(Scratch::new());
    let frame = Frame::of(target)?;
    let mut registrar = Registrar::new(policy, &mut scratch);
    let mut registration = registrar.start(source, target, frame, initial)?;
    let mut trace = Vec::with_capacity(steps);
    while registration.steps() < steps && !registration.is_settled() {
        let taken = registrar.step(&mut registration)?;
        trace.push(Step::new(
            registration.steps(),
            &taken,
            frame,
            registration.target_from_source(),
        ));
    }
    let policy = (registration.verdict(), registration.target_from_source());
    let mut workspace = Box::new(Workspace::new());
    let refinement = refine(source, target, policy.1, mode, &mut workspace)?;
    let (verdict, target_from_source) = refinement.as_ref().map_or(policy, |found| {
        let verdict = Verdict::of_probability(found.evidence.probability());
        (verdict, found.refined.target_from_source)
    });
    Ok(Registered {
        target_from_source,
        verdict,
        trace,
        policy,
        refinement,
    })
}

/// A cloud within the core's capacity: itself, or [`SUBSAMPLE`] of its points ([`thin`]).
pub fn within_capacity(points: &[Point]) -> Vec<Point> {
    match points.len() {
        ..=MAX_POINTS => points.to_vec(),
        _ => thin(points, SUBSAMPLE),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::WeightFile;
    use crate::nn::{Parameters, Shape};
    use crate::random::{Purpose, stream};
    use rand::RngExt;

    fn cloud(index: u64) -> Vec<Point> {
        let rng = &mut stream(2, Purpose::Pairs, index);
        (0..64)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect()
    }

    /// The policy sees the same normalised clouds whatever the unit is, so it must take the same actions.
    #[test]
    fn the_unit_of_length_changes_translations_only() {
        let file =
            WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 4)).expect("deployable");
        let (source, target) = (cloud(0), cloud(1));
        let doubled = |cloud: &[Point]| {
            cloud
                .iter()
                .map(|p| p.map(|x| 2.0 * x))
                .collect::<Vec<Point>>()
        };
        let one = register(
            file.policy(),
            &source,
            &target,
            Pose::IDENTITY,
            4,
            Mode::Fast,
        )
        .expect("valid");
        let two = register(
            file.policy(),
            &doubled(&source),
            &doubled(&target),
            Pose::IDENTITY,
            4,
            Mode::Fast,
        )
        .expect("valid");
        let actions = |r: &Registered| {
            r.trace
                .iter()
                .map(|l| (l.translation_id, l.rotation_id))
                .collect::<Vec<_>>()
        };
        assert_eq!(actions(&one), actions(&two));
        assert_eq!(one.trace.len(), 4);
        let (a, b) = (one.target_from_source, two.target_from_source);
        assert_eq!(a.rotation, b.rotation);
        assert!((b.translation - 2.0 * a.translation).length() < 1e-5);
    }

    #[test]
    fn bad_clouds_are_refused() {
        let file =
            WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 4)).expect("deployable");
        let good = cloud(0);
        let run = |s: &[Point], t: &[Point]| {
            register(file.policy(), s, t, Pose::IDENTITY, 1, Mode::Verify).err()
        };
        assert_eq!(run(&[], &good), Some(Error::EmptyCloud));
        assert_eq!(
            run(&good, &good[..1]),
            Some(Error::TooFewPoints { points: 1 })
        );
        assert_eq!(run(&good, &[[0.5; 3]; 8]), Some(Error::NoExtent));
    }

    #[test]
    fn only_clouds_beyond_the_capacity_are_thinned() {
        let cloud = |n: usize| (0..n).map(|i| [i as f32, 0.0, 0.0]).collect::<Vec<Point>>();
        assert_eq!(within_capacity(&cloud(MAX_POINTS)).len(), MAX_POINTS);
        assert_eq!(within_capacity(&cloud(MAX_POINTS + 1)).len(), SUBSAMPLE);
    }
}
