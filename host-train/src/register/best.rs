//! The best of several registrations of one pair, each from a start of its own, and the next best poses.

use crate::dataset::Point;
use crate::register::{Memory, Registered};
use reagent_core::evidence::Evidence;
use reagent_core::pipeline::{self, Answer, Task};
use reagent_core::polish::{Refined, Refiner};
use reagent_core::verify::Ranked;
use reagent_core::{Error, Pose};

/// The registration that is returned out of several, and the next best poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Number of the start that it came from.
    pub start: usize,
    /// The registration.
    pub found: Registered,
    /// The next best poses, as many as were asked for at most, the most probable first.
    pub others: Vec<Other>,
}

/// A pose that was found and not returned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other {
    /// The pose, and how the clouds fit under it.
    pub refined: Refined,
    /// Probability that it is right: that of the pose by itself, times its probability relative to the returned pose.
    pub probability: f32,
    /// Number of the start that it came from.
    pub start: usize,
}

/// The number of a task, and its registration.
type Tried = (usize, Registered);

/// Chooses among several registrations of one pair, one a task, each from a start of its own. Returns the one whose
/// pose is the most probable, by its fit and its start; without fits, the first. Adds at most `count` next best
/// poses, each another hypothesis, refined as [`Refiner::polish`] does.
///
/// Poses are compared after few iterations. Further iterations may make one of the others more probable by itself
/// than the chosen pose. Its task is then repeated from there, and if that confirms it, it is returned.
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
        others = other_hypotheses(memory, clouds, tasks, &tried, first)?;
    }
    for _ in 0..count {
        let given = probability(&tried[first]);
        let Some(likelier) = others.first().filter(|other| other.probability > given) else {
            break;
        };
        let again = repeat_from(memory, clouds, tasks, &tried, likelier)?;
        if probability(&again) <= given {
            break;
        }
        tried.push(again);
        first = tried.len() - 1;
        others = other_hypotheses(memory, clouds, tasks, &tried, first)?;
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
    // The sensor is the same for all starts.
    if let Some(task) = tasks.first() {
        task.tell_sensor(&mut refiner);
    }
    Ok(refiner)
}

/// The poses that each registration compared, or refined, with its place in `tried`: the most probable first.
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

/// Hypotheses other than that of registration `first`, refined, the most probable first.
fn other_hypotheses(
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
            // The pose was reached once, and the best is more probable.
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

/// Repeats the task that another pose came from, starting at that pose, without the policy's steps.
fn repeat_from(
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
    // The first registrations in `tried` are in the order of their tasks.
    let (_, before) = &tried[other.start];
    let answer = match refinement {
        None => before.answer,
        Some(found) => Answer::refined(found, before.answer.policy)?,
    };
    let trace = before.trace.clone();
    Ok((other.start, Registered { answer, trace }))
}
