//! Traces of evaluated pairs.

use super::{Header, Step, Traced};
use crate::dataset::pairs::PairSet;
use crate::eval::EvalError;
use crate::measure::method::{Contestant, Finish, Method, Start};
use reagent_core::net::Scratch;
use reagent_core::{Error, Frame, Pose, Registrar};

/// The first `count` pairs of a set as every policy among the contestants registers them in `steps` steps:
/// clouds as they are, from the identity, as [`crate::eval::evaluate`] does.
///
/// # Errors
/// [`EvalError::Pair`], with a cloud that the core refuses.
pub fn pairs(
    set: &PairSet,
    contestants: &[Contestant<'_>],
    steps: usize,
    count: usize,
) -> Result<Vec<Traced>, EvalError> {
    let mut scratch = Box::new(Scratch::new());
    let mut all = Vec::new();
    for contestant in contestants {
        let Method {
            start: Start::Policy(policy),
            finish: Finish::Nothing,
        } = contestant.method
        else {
            continue;
        };
        let mut registrar = Registrar::new(policy, &mut scratch);
        for index in 0..count.min(set.source.len()) {
            let (source, target) = (&set.source[index], &set.target[index]);
            let mut registration = registrar
                .start(source, target, Frame::IDENTITY, Pose::IDENTITY)
                .map_err(|source| EvalError::Pair { index, source })?;
            let step = |number| {
                let taken = registrar.step(&mut registration)?;
                let pose = registration.target_from_source();
                Ok(Step::new(number, &taken, Frame::IDENTITY, pose))
            };
            let taken: Result<_, Error> = (1..=steps).map(step).collect();
            all.push(Traced {
                header: Header {
                    name: format!("pair {index}"),
                    policy: contestant.name.clone(),
                    source: source.clone(),
                    target: target.clone(),
                    truth: Some(set.target_from_source[index].to_rows()),
                    initial: Pose::IDENTITY.to_rows(),
                },
                steps: taken.map_err(|source| EvalError::Pair { index, source })?,
            });
        }
    }
    Ok(all)
}
