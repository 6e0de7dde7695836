//! One registration of two clouds in the user's own units.

mod all_points;
pub mod background;
pub mod batch;
pub mod best;
pub mod dense;
pub mod deviations;
pub mod document;
pub mod prepared;
#[cfg(not(target_family = "wasm"))]
pub mod replay;
pub mod request;
pub mod scale;
mod seen;
pub mod sentences;
mod surface;
pub mod thin;
pub mod trace;
#[cfg(not(target_family = "wasm"))]
pub mod track;
pub mod view;

use crate::dataset::Point;
use crate::pose64::{Pose64, Position};
use crate::register::thin::thin;
use crate::register::trace::Step;
use reagent_core::dims::MAX_POINTS;
use reagent_core::net::Scratch;
use reagent_core::order::put_in_order;
use reagent_core::pipeline::{self, Answer, Progress, Task};
use reagent_core::polish::Workspace;
use reagent_core::{Error, Frame, Policy, Pose, Registrar, start};

/// Names the sources of what registers, in a program that has this text in it: the page that `host-train page` writes must give the
/// poses of the command line.
pub const SOURCES: &str = concat!("reagent-sources-", env!("REAGENT_SOURCES"));

/// Number of points to which a cloud that exceeds the capacity is thinned.
pub const SUBSAMPLE: usize = 2048;

/// Where a registration starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// From the clouds as they lie.
    Identity,
    /// From this target_from_source, a plain rigid transform.
    Pose(Pose64),
    /// Anywhere: nothing is known, and the source may be turned in any way.
    None,
}

impl Start {
    /// The pose before the first step, between coordinates relative to two origins.
    pub fn near(&self, source_origin: Position, target_origin: Position) -> Pose {
        let pose = match self {
            Start::Pose(pose) => pose,
            Start::Identity | Start::None => &Pose64::IDENTITY,
        };
        pose.near(source_origin, target_origin)
    }

    /// The same as a start for the core.
    pub fn start(&self, source_origin: Position, target_origin: Position) -> start::Start {
        match self {
            Start::None => start::Start::Anywhere,
            _ => start::Start::at(self.near(source_origin, target_origin)),
        }
    }
}

/// A finished registration.
#[derive(Clone, Debug, PartialEq)]
pub struct Registered {
    /// The pose, and what can be said about it.
    pub answer: Answer,
    /// Every step that the policy took.
    pub trace: Vec<Step>,
}

/// Working memory of one thread.
#[derive(Debug)]
pub struct Memory {
    /// Memory of the policy.
    pub scratch: Scratch,
    /// Memory of the refinement and verification after it.
    pub workspace: Workspace,
}

impl Memory {
    /// Empty working memory.
    pub const fn new() -> Memory {
        Memory {
            scratch: Scratch::new(),
            workspace: Workspace::new(),
        }
    }
}

impl Default for Memory {
    fn default() -> Memory {
        Memory::new()
    }
}

/// Registers `source [N, 3]` to `target [M, 3]`, both in the same unit of length
/// ([`reagent_core::pipeline::register`]). Allocates its memory, and keeps every step.
///
/// # Errors
/// Clouds or a start that the core refuses.
pub fn register(
    policy: Policy<'_>,
    source: &[Point],
    target: &[Point],
    task: &Task<'_>,
) -> Result<Registered, Error> {
    register_in(&mut Box::new(Memory::new()), policy, source, target, task)
}

/// The same in memory that the caller gives.
///
/// # Errors
/// As [`register`].
pub fn register_in(
    memory: &mut Memory,
    policy: Policy<'_>,
    source: &[Point],
    target: &[Point],
    task: &Task<'_>,
) -> Result<Registered, Error> {
    let Memory { scratch, workspace } = memory;
    let mut registrar = Registrar::new(policy, scratch);
    let mut trace = Vec::new();
    let record = recorder(&mut trace, Frame::of(target)?);
    let clouds = [source, target];
    let answer = pipeline::register(&mut registrar, workspace, clouds, task, record)?;
    Ok(Registered { answer, trace })
}

/// An observer that keeps every step that the policy takes.
fn recorder<'c>(
    trace: &mut Vec<Step>,
    frame: Frame,
) -> impl FnMut(Progress<'_, 'c>) -> Result<(), Error> {
    move |progress| {
        if let Progress::Step(step, registration) = progress {
            let pose = registration.target_from_source();
            trace.push(Step::new(registration.steps(), step, frame, pose));
        }
        Ok(())
    }
}

/// A cloud as it is sent to a robot, neighbours next to each other: a robot without memory to sort it saves half the time.
pub fn in_order(mut points: Vec<Point>) -> Vec<Point> {
    put_in_order(&mut points);
    points
}

/// A cloud within the core's capacity: the cloud itself, or [`SUBSAMPLE`] of its points ([`thin::thin`]).
pub fn within_capacity(points: &[Point]) -> Vec<Point> {
    match points.len() {
        ..=MAX_POINTS => points.to_vec(),
        _ => thin(points, SUBSAMPLE),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::nn::{Parameters, Shape};
    use crate::policy::WeightFile;
    use crate::random::{Purpose, stream};
    use rand::RngExt;
    use reagent_core::pipeline::Mode;

    fn task(mode: Mode, steps: usize) -> Task<'static> {
        Task {
            mode,
            steps,
            ..Task::new(start::Start::at(Pose::IDENTITY))
        }
    }

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
        let one = register(file.policy(), &source, &target, &task(Mode::Fast, 4)).expect("valid");
        let two = register(
            file.policy(),
            &doubled(&source),
            &doubled(&target),
            &task(Mode::Fast, 4),
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
        let (a, b) = (one.answer.target_from_source, two.answer.target_from_source);
        assert_eq!(a.rotation, b.rotation);
        assert!((b.translation - 2.0 * a.translation).length() < 1e-5);
    }

    #[test]
    fn bad_clouds_are_refused() {
        let file =
            WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 4)).expect("deployable");
        let good = cloud(0);
        let run =
            |s: &[Point], t: &[Point]| register(file.policy(), s, t, &task(Mode::Verify, 1)).err();
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
