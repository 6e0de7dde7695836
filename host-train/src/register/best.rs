//! The best of several registrations of one pair, each from a start of its own, and the poses next to it.

use crate::dataset::Point;
use crate::register::{Memory, Registered};
use reagent_core::evidence::Evidence;
use reagent_core::pipeline::{self, Answer, Task};
use reagent_core::polish::{Refined, Refiner};
use reagent_core::verify::Ranked;
use reagent_core::{Error, Pose};

/// What is given out of several registrations, and what is next to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Number of the start from which it came.
    pub start: usize,
    /// The registration.
    pub found: Registered,
    /// The next best poses, as far as they were asked for, the most probable first.
    pub others: Vec<Other>,
}

/// A pose that was not given out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// The pose, and how the clouds fit under it.
    pub refined: Refined,
    /// That it is right: what would be said of it alone, and how much less probable it is than the pose given out.
    pub probability: f32,
    /// Number of the start from which it came.
    pub start: usize,
}

/// A registration, and the number of the task that it did.
type Tried = (usize, Registered);

/// Of several registrations of one pair, one a task, each from a start of its own: the one whose pose is the most probable, by fit
/// and by its start, and the next best poses besides, at most `count`, each another hypothesis, refined as [`Refiner::polish`]
/// does. Without fits, the first.
///
/// Poses are compared after few steps. Where more of them make one of the others more probable by itself than what was chosen, its
/// task is done again from there; if that confirms it, it is given out.
///
/// # Errors
/// Clouds that the core refuses.
pub fn best_and_others(
    memory: &mut Memory,
    clouds: [&[Point]; 2],
    tasks: &[Task<'_>],
    found: Vec<Registered>,
    count: usize,
) -> Result<Best, Error> {
    let mut tried: Vec<Tried> = found.into_iter().enumerate().collect();
    let mut first = 0;
    let mut others = Vec::new();
    if tried.len() > 1 || count > 0 {
        let mut refiner = refiner(memory, clouds, tasks)?;
        let candidates = candidates(&mut refiner, tasks, &tried)?;
        first = candidates.first().map_or(0, |&(place, _)| place);
    }
    if count > 0 {
        others = next_to(memory, clouds, tasks, &tried, first)?;
    }
    for _ in 0..count {
        let given = probability(&tried[first]);
        let Some(likelier) = others.first().filter(|other| other.probability > given) else {
            break;
        };
        let again = done_again(memory, clouds, tasks, &tried, likelier)?;
        if probability(&again) <= given {
            break;
        }
        tried.push(again);
        first = tried.len() - 1;
        others = next_to(memory, clouds, tasks, &tried, first)?;
    }
    let given = probability(&tried[first]);
    for other in &mut others {
        other.probability = other.probability.min(given);
    }
    others.truncate(count);
    let (start, found) = tried.swap_remove(first);
    Ok(Best {
        start,
        found,
        others,
    })
}

fn probability((_, found): &Tried) -> f32 {
    found.answer.probability.unwrap_or(0.0)
}

fn refiner<'w>(
    memory: &'w mut Memory,
    [source, target]: [&[Point]; 2],
    tasks: &[Task<'_>],
) -> Result<Refiner<'w>, Error> {
    let mut refiner = Refiner::new(source, target, &mut memory.workspace)?;
    // The sensor is the same whatever the start.
    if let Some(task) = tasks.first() {
        task.look(&mut refiner);
    }
    Ok(refiner)
}

/// The poses that all registrations compared, or the only one that each refined, with their places: the most probable first.
fn candidates(
    refiner: &mut Refiner<'_>,
    tasks: &[Task<'_>],
    tried: &[Tried],
) -> Result<Vec<(usize, Ranked)>, Error> {
    let mut candidates = Vec::new();
    for (place, (task, found)) in tried.iter().enumerate() {
        let Some(refinement) = &found.answer.refinement else {
            continue;
        };
        let before = candidates.len();
        let compared = refinement.ranked.into_iter().flatten();
        candidates.extend(compared.map(|ranked| (place, ranked)));
        if candidates.len() == before {
            let target_from_source = refinement.refined.target_from_source;
            let energy = refiner.energy(target_from_source, &tasks[*task].start)?;
            let only = Ranked {
                target_from_source,
                energy,
            };
            candidates.push((place, only));
        }
    }
    candidates.sort_by(|(_, a), (_, b)| a.energy.total_cmp(&b.energy));
    Ok(candidates)
}

/// Other hypotheses than that of the first, refined, the most probable first.
fn next_to(
    memory: &mut Memory,
    clouds: [&[Point]; 2],
    tasks: &[Task<'_>],
    tried: &[Tried],
    first: usize,
) -> Result<Vec<Other>, Error> {
    let refiner = &mut refiner(memory, clouds, tasks)?;
    let (task, given) = &tried[first];
    let given = given.answer.target_from_source;
    let given_energy = refiner.energy(given, &tasks[*task].start)?;
    let mut begun: Vec<Pose> = Vec::new();
    let mut named = vec![given];
    let mut others: Vec<Other> = Vec::new();
    for (place, candidate) in candidates(refiner, tasks, tried)? {
        let (start, found) = &tried[place];
        let from = candidate.target_from_source;
        if begun.iter().any(|&begun| refiner.is_same(from, begun)) {
            continue;
        }
        begun.push(from);
        let refined = refiner.polish(from)?;
        let pose = refined.target_from_source;
        if named.iter().any(|&named| refiner.is_same(pose, named)) {
            continue;
        }
        named.push(pose);
        let energy = refiner.energy(pose, &tasks[*start].start)?;
        let answer = &found.answer;
        let was_answer = refiner.is_same(pose, answer.target_from_source);
        let said = answer.refinement.filter(|_| was_answer);
        let evidence = Evidence {
            verified: true,
            // It was reached, and the best is more probable.
            support: 1,
            lead: 0.0,
            mirror_score: said.map_or(0.0, |said| said.evidence.mirror_score),
            ..Evidence::polished(&refined)
        };
        others.push(Other {
            refined,
            probability: evidence.probability() * (given_energy - energy).exp().min(1.0),
            start: *start,
        });
    }
    others.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Ok(others)
}

/// The task from which another pose came, done from where that is, without the policy's steps.
fn done_again(
    memory: &mut Memory,
    clouds: [&[Point]; 2],
    tasks: &[Task<'_>],
    tried: &[Tried],
    other: &Other,
) -> Result<Tried, Error> {
    let reached = other.refined.target_from_source;
    let task = &tasks[other.start];
    let go_on = || Ok::<(), Error>(());
    let refinement = pipeline::refine(&mut memory.workspace, clouds, reached, task, go_on)?;
    // The first registrations are in the order of their tasks.
    let (_, before) = &tried[other.start];
    let answer = match refinement {
        None => before.answer,
        Some(found) => Answer::refined(found, before.answer.policy)?,
    };
    let trace = before.trace.clone();
    Ok((other.start, Registered { answer, trace }))
}
