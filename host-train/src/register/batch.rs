//! Many registrations over the threads of the current rayon pool. Each has its own working memory and arithmetic,
//! so that results depend neither on the order nor on the number of threads.

use rayon::prelude::*;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::register::{Outcome, Team};
use reagent_core::{Error, Frame, Policy, Pose, Registration};

/// One registration to do.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The cloud that is moved.
    pub source: &'a [[f32; 3]],
    /// The cloud that it is moved onto.
    pub target: &'a [[f32; 3]],
    /// Normalised frame in which the policy works.
    pub frame: Frame,
    /// Initial estimate of target_from_source.
    pub initial: Pose,
}

/// Registrations that a thread runs in lockstep ([`Team`]), if there are enough for all threads.
const TOGETHER: usize = 4;

/// Registers every job with `steps` steps each. Results are in the order of the jobs.
pub fn register(
    isa: Isa,
    policy: Policy<'_>,
    jobs: &[Job<'_>],
    steps: usize,
) -> Vec<Result<Outcome, Error>> {
    let memory = || [const { Scratch::new() }; TOGETHER];
    let share = jobs.len().div_ceil(rayon::current_num_threads());
    let together = share.clamp(1, TOGETHER);
    let groups: Vec<&[Job<'_>]> = jobs.chunks(together).collect();
    let groups = for_each(groups.len(), memory, |scratch, i| {
        let jobs = groups[i];
        let mut team = Team::with_isa(isa, policy, scratch);
        let mut registrations = [const { Registration::new() }; TOGETHER];
        let lanes = registrations.iter_mut().enumerate();
        let mut started: Vec<Result<(), Error>> = jobs
            .iter()
            .zip(lanes)
            .map(|(job, (lane, registration))| {
                let mut registrar = team.lane(lane).expect("as many lanes as registrations");
                let (source, target) = (job.source, job.target);
                registrar.start_in(registration, source, target, job.frame, job.initial)
            })
            .collect();
        for _ in 0..steps {
            for (started, step) in started.iter_mut().zip(team.step(&mut registrations)) {
                *started = (*started).and(step.map(|_| ()));
            }
        }
        let results = started.into_iter().zip(registrations);
        let results =
            results.map(|(started, registration)| started.map(|()| registration.outcome()));
        results.collect::<Vec<_>>()
    });
    groups.into_iter().flatten().collect()
}

/// Calls `f` for 0 to `count`, with working memory for each thread. Results are in order.
pub fn for_each<M, T: Send>(
    count: usize,
    memory: impl Fn() -> M + Sync + Send,
    f: impl Fn(&mut M, usize) -> T + Sync + Send,
) -> Vec<T> {
    (0..count)
        .into_par_iter()
        .with_max_len(1)
        .map_init(|| boxed(&memory), |memory, i| f(memory, i))
        .collect()
}

/// Not inlined: the working memory passes over the stack here, and must not add to the frame of every level at
/// which rayon splits the work.
#[inline(never)]
fn boxed<M>(memory: impl Fn() -> M) -> Box<M> {
    Box::new(memory())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::policy::WeightFile;
    use crate::protocol::{self, Protocol};
    use reagent_core::dims::STEPS_ONE_WAY;
    use reagent_core::{Decision, Registrar};

    #[test]
    fn results_depend_neither_on_threads_nor_on_order() {
        let pairs = protocol::draw(&procedural::models(5, 4), Protocol::M40Models, 6, 5);
        let mut jobs: Vec<Job<'_>> = pairs
            .source
            .iter()
            .zip(&pairs.target)
            .map(|(source, target)| Job {
                source: &source[..200],
                target: &target[..200],
                frame: Frame::IDENTITY,
                initial: Pose::IDENTITY,
            })
            .collect();
        jobs[2].source = &[];
        let parameters = WeightFile::pretrained().parameters(0).expect("f32");
        let integers = WeightFile::from_parameters_int8(&parameters, &pairs).expect("deployable");
        for file in [WeightFile::pretrained(), integers] {
            let file = file.deciding(Decision::BothWays);
            let on = |threads: usize, jobs: &[Job<'_>]| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let pool = pool.expect("a pool of threads");
                pool.install(|| register(Isa::best(), file.policy(), jobs, STEPS_ONE_WAY + 2))
            };
            let mut scratch = Scratch::new();
            let mut registrar = Registrar::new(file.policy(), &mut scratch);
            let expected: Vec<_> = jobs
                .iter()
                .map(|job| {
                    let (source, target) = (job.source, job.target);
                    let steps = STEPS_ONE_WAY + 2;
                    registrar.register(source, target, job.frame, job.initial, steps)
                })
                .collect();
            assert_eq!(expected[2], Err(Error::EmptyCloud));
            assert_eq!(expected.iter().filter(|result| result.is_ok()).count(), 5);
            for threads in [1, 2, 3, 8] {
                assert_eq!(on(threads, &jobs), expected);
            }
            jobs.reverse();
            let mut reversed = on(2, &jobs);
            jobs.reverse();
            reversed.reverse();
            assert_eq!(reversed, expected);
        }
        let none = register(Isa::best(), Policy::pretrained().expect("sound"), &[], 3);
        assert_eq!(none, []);
    }
}
