//! The best of several registrations of one pair, each from a start of its own, and the poses next to it.

use crate::dataset::Point;
use crate::register::{Memory, Registered};
use glam::Vec3;
use reagent_core::Error;
use reagent_core::evidence::Evidence;
use reagent_core::polish::{Refined, Refiner};
use reagent_core::start::Start;
use reagent_core::verify::Ranked;

/// A pose that was not given out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// The pose, and how the clouds fit under it.
    pub refined: Refined,
    /// That it is right: what would be said of it alone, and how much less probable it is than the pose given out.
    pub probability: f32,
}

/// Of several registrations of one pair, each from a start of its own: the place of the one whose pose is the most probable, by
/// fit and by its start, and the next best poses besides, at most `count`, each another hypothesis, refined as
/// [`Refiner::polish`] does. `seen` is the view point and the background, if those are known. Without fits, the first.
///
/// # Errors
/// Clouds that the core refuses.
pub fn best_and_others(
    memory: &mut Memory,
    [source, target]: [&[Point]; 2],
    seen: Option<(Vec3, &[Point])>,
    found: &[(Start, Registered)],
    count: usize,
) -> Result<(usize, Vec<Other>), Error> {
    let mut refiner = Refiner::new(source, target, &mut memory.workspace)?;
    if let Some((view_point, background)) = seen {
        refiner.seen_before(view_point, background);
    }
    let mut candidates = Vec::new();
    for (place, (start, found)) in found.iter().enumerate() {
        let ranked = ranked(&mut refiner, start, found)?;
        candidates.extend(ranked.into_iter().map(|ranked| (place, ranked)));
    }
    candidates.sort_by(|(_, a), (_, b)| a.energy.total_cmp(&b.energy));
    let Some(&(best, first)) = candidates.first() else {
        return Ok((0, Vec::new()));
    };
    let mut named = vec![found[best].1.answer.target_from_source];
    let mut others: Vec<Other> = Vec::new();
    for (_, candidate) in candidates {
        if others.len() == count {
            break;
        }
        let refined = refiner.polish(candidate.target_from_source)?;
        let pose = refined.target_from_source;
        if named.iter().any(|&named| refiner.is_same(pose, named)) {
            continue;
        }
        named.push(pose);
        let evidence = Evidence {
            verified: true,
            // It was reached, and the best is more probable.
            support: 1,
            lead: 0.0,
            ..Evidence::polished(&refined)
        };
        others.push(Other {
            refined,
            probability: evidence.probability() * (first.energy - candidate.energy).exp(),
        });
    }
    Ok((best, others))
}

/// The poses that a registration compared, or the only one that it refined.
fn ranked(
    refiner: &mut Refiner<'_>,
    start: &Start,
    found: &Registered,
) -> Result<Vec<Ranked>, Error> {
    let Some(refinement) = &found.answer.refinement else {
        return Ok(Vec::new());
    };
    let compared: Vec<Ranked> = refinement.ranked.into_iter().flatten().collect();
    if !compared.is_empty() {
        return Ok(compared);
    }
    let target_from_source = refinement.refined.target_from_source;
    let energy = refiner.energy(target_from_source, start)?;
    Ok(vec![Ranked {
        target_from_source,
        energy,
    }])
}
