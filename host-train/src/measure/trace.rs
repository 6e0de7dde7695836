//! Traces of evaluated pairs.

use super::eval::EvalError;
use super::method::{Contestant, Finish, Method, Start, task_of};
use crate::dataset::pairs::PairSet;
use crate::register::register;
use crate::register::trace::{FinalAnswer, Header, Traced};
use reagent_core::Pose;
use reagent_core::pipeline::{Mode, Task};

/// Traces of the first `count` pairs of a set, registered by every policy among the contestants in `steps` steps.
/// Clouds are not normalised and starts are the identity, as in [`super::eval::evaluate`].
///
/// # Errors
/// [`EvalError::Pair`], with a cloud that the core refuses.
pub fn pairs(
    set: &PairSet,
    contestants: &[Contestant<'_>],
    steps: usize,
    count: usize,
) -> Result<Vec<Traced>, EvalError> {
    let mut all = Vec::new();
    for contestant in contestants {
        let (policy, mode) = match contestant.method {
            Method {
                start: Start::Policy(policy),
                finish: Finish::Nothing,
            } => (policy, Mode::Fast),
            Method {
                start: Start::Policy(policy),
                finish: Finish::Core(mode),
            } => (policy, mode),
            _ => continue,
        };
        for index in 0..count.min(set.source.len()) {
            let (source, target) = (&set.source[index], &set.target[index]);
            let task = Task {
                mode,
                steps,
                ..task_of(set.seen(index))
            };
            let found = register(policy, source, target, &task)
                .map_err(|source| EvalError::Pair { index, source })?;
            all.push(Traced {
                header: Header {
                    name: format!("pair {index}"),
                    policy: contestant.name.clone(),
                    source: source.clone(),
                    target: target.clone(),
                    truth: Some(set.target_from_source[index].to_rows()),
                    initial: Pose::IDENTITY.to_rows(),
                    origins: None,
                },
                answer: FinalAnswer::of(&found.answer, mode),
                steps: found.trace,
            });
        }
    }
    Ok(all)
}
