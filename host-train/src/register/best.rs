//! The best of several registrations of one pair, each from a start of its own, and the poses next to it.

use crate::dataset::Point;
use crate::register::{Memory, Registered};
use glam::Vec3;
use reagent_core::evidence::Evidence;
use reagent_core::polish::{Refined, Refiner};
use reagent_core::verify::Ranked;
use reagent_core::{Error, Pose};

/// A pose that was not given out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// The pose, and how the clouds fit under it.
    pub refined: Refined,
    /// That it is right, had it been given out.
    pub probability: f32,
}

/// The place of the registration whose pose is the most probable, by fit and by its start.
pub fn best_of(found: &[Registered]) -> usize {
    let energy = |found: &Registered| ranked(found).next().map_or(f32::INFINITY, |r| r.energy);
    let energies = found.iter().map(energy).enumerate();
    let best = energies.min_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or(0, |(place, _)| place)
}

/// The most probable poses besides `given`, at most `count`, each another hypothesis, refined as [`Refiner::polish`]
/// does. `seen` is the view point and the background, if those are known.
///
/// # Errors
/// Clouds that the core refuses.
pub fn others(
    memory: &mut Memory,
    [source, target]: [&[Point]; 2],
    seen: Option<(Vec3, &[Point])>,
    found: &[Registered],
    given: Pose,
    count: usize,
) -> Result<Vec<Other>, Error> {
    let mut others: Vec<Other> = Vec::new();
    if count == 0 {
        return Ok(others);
    }
    let mut refiner = Refiner::new(source, target, &mut memory.workspace)?;
    if let Some((view_point, background)) = seen {
        refiner.seen_before(view_point, background);
    }
    let mut candidates: Vec<Ranked> = found.iter().flat_map(ranked).collect();
    candidates.sort_by(|a, b| a.energy.total_cmp(&b.energy));
    for candidate in candidates {
        if others.len() == count {
            break;
        }
        let refined = refiner.polish(candidate.target_from_source)?;
        let pose = refined.target_from_source;
        let mut named = others.iter().map(|other| other.refined.target_from_source);
        if refiner.is_same(pose, given) || named.any(|named| refiner.is_same(pose, named)) {
            continue;
        }
        let evidence = Evidence {
            verified: true,
            ..Evidence::polished(&refined)
        };
        others.push(Other {
            refined,
            probability: evidence.probability(),
        });
    }
    Ok(others)
}

/// The poses that a registration compared, the most probable first.
fn ranked(found: &Registered) -> impl Iterator<Item = Ranked> {
    let refinement = found.answer.refinement.as_ref();
    refinement
        .into_iter()
        .flat_map(|found| found.ranked)
        .flatten()
}
