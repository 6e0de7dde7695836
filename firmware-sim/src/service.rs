//! The refinement service: request frame in, pose or refusal out, one at a time.

use crate::frames::{Outlet, read_request, trace_frame};
use crate::policy::LoadedPolicy;
use crate::queue::{Job, Queue, Stop};
use crate::view::View;
use reagent_core::dims::MAX_POINTS;
use reagent_core::frame::check_cloud;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::pipeline::{self, Answer, Progress};
use reagent_core::polish::Workspace;
use reagent_core::pose::centroid;
use reagent_core::wire::{
    Cloud, CloudView, Fit, KernelName, PolicyId, Reason, RefineReply, Refusal, StepsView, Trace,
    step_bytes,
};
use reagent_core::{Error, Registrar, Verdict};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::runtime::Handle;
use tokio::sync::watch;

/// The policy has reached a pose from which its own differs by less than this angle, and this share of the target's radius:
/// the limits of a right pose.
const REACHED_RAD: f32 = 5.0_f32.to_radians();
const REACHED_RADII: f32 = 0.05;

/// Answers queued requests until the queue is closed, always with the newest policy. A policy that arrives while a request
/// runs is used from the next request on.
pub(crate) fn serve(
    queue: &Queue,
    mut policies: watch::Receiver<Option<Arc<LoadedPolicy>>>,
    outlet: &Outlet,
) {
    let mut scratch = Box::new(Scratch::new());
    let mut buffers = Buffers::new();
    loop {
        let loaded = policies.borrow_and_update().clone();
        let mut engine = Engine::start(loaded.as_deref(), &mut scratch);
        loop {
            let job = match next_work(queue, &mut policies) {
                Some(Work::Job(job)) => job,
                Some(Work::Policy) => break,
                None => return,
            };
            let payload = job.query.payload().map(|p| p.to_bytes());
            let payload = payload.unwrap_or_default();
            let engine = engine.as_mut().map_err(|reason| *reason);
            let answer = answer(engine, &mut buffers, &payload, &job);
            queue.done();
            match answer {
                Ok(answered) => {
                    outlet.settle(&job.query, Ok(answered.reply), answered.reached);
                    if let Some(trace) = answered.trace {
                        outlet.publish_trace(trace);
                    }
                }
                Err(Ended::Refused(refusal)) => outlet.settle(&job.query, Err(refusal), None),
                Err(Ended::TakenBack) => {
                    outlet.view.send_modify(View::count_taken_back);
                }
            }
        }
    }
}

/// What a worker does next.
#[allow(
    clippy::large_enum_variant,
    reason = "one at a time, and most are jobs"
)]
pub(crate) enum Work {
    /// Take up a new policy. It is checked and packed before the next request arrives, so that no request waits for it.
    Policy,
    Job(Job),
}

/// Waits for work; `None` when the queue is closed.
pub(crate) fn next_work(
    queue: &Queue,
    policies: &mut watch::Receiver<Option<Arc<LoadedPolicy>>>,
) -> Option<Work> {
    Handle::current().block_on(async {
        tokio::select! {
            biased;
            changed = policies.changed() => changed.ok().map(|()| Work::Policy),
            job = queue.next() => job.map(Work::Job),
        }
    })
}

/// A policy in use.
struct Engine<'w, 's> {
    registrar: Registrar<'w, 's>,
    policy: PolicyId,
}

impl<'w, 's> Engine<'w, 's> {
    /// Starts with that policy, or says why requests are refused.
    fn start(loaded: Option<&'w LoadedPolicy>, scratch: &'s mut Scratch) -> Result<Self, Reason> {
        let loaded = loaded.ok_or(Reason::NoPolicy)?;
        let policy = loaded.policy().map_err(|error| {
            tracing::error!(
                "the policy at hand is none: {error}; requests are refused until the next one"
            );
            Reason::PolicyDamaged
        })?;
        Ok(Engine {
            registrar: Registrar::new(policy, scratch),
            policy: loaded.manifest().id(),
        })
    }
}

/// Working memory of registrations, aligned as the kernels need it.
struct Buffers {
    source: Box<[[f32; 3]]>,
    target: Box<[[f32; 3]]>,
    background: Box<[[f32; 3]]>,
    outward: Box<[[f32; 3]]>,
    workspace: Box<Workspace>,
}

impl Buffers {
    fn new() -> Self {
        let empty = || vec![[0.0; 3]; MAX_POINTS].into_boxed_slice();
        Buffers {
            source: empty(),
            target: empty(),
            background: empty(),
            outward: empty(),
            workspace: Box::new(Workspace::new()),
        }
    }
}

/// A pose, and what is told of it.
struct Answered {
    reply: RefineReply,
    /// Of a converged pose that was refined: whether the policy itself had reached it.
    reached: Option<bool>,
    /// The frame of its trace, if the request asks for one.
    trace: Option<Vec<u8>>,
}

/// Why there is no pose.
enum Ended {
    Refused(Refusal),
    TakenBack,
}

/// Why a registration did not end.
enum Interrupted {
    Stop(Ended),
    Failed(Error),
}

impl From<Error> for Interrupted {
    fn from(error: Error) -> Self {
        Interrupted::Failed(error)
    }
}

/// Registers the clouds of a request.
fn answer(
    engine: Result<&mut Engine<'_, '_>, Reason>,
    buffers: &mut Buffers,
    payload: &[u8],
    job: &Job,
) -> Result<Answered, Ended> {
    let request = read_request(payload).map_err(Ended::Refused)?;
    let id = request.id;
    let refused = |reason| Ended::Refused(Refusal { id, reason });
    let check = || {
        job.check().map_err(|stop| match stop {
            Stop::Deadline => refused(Reason::Deadline),
            Stop::TakenBack => Ended::TakenBack,
        })
    };
    check()?;
    let Engine { registrar, policy } = engine.map_err(refused)?;
    let started = Instant::now();
    let source =
        checked_copy(Cloud::Source, &request.source, &mut buffers.source).map_err(refused)?;
    let target =
        checked_copy(Cloud::Target, &request.target, &mut buffers.target).map_err(refused)?;
    let mut steps = Vec::new();
    // These need not be checked: what is not finite is ignored.
    let background = request.background.copy_into(&mut buffers.background);
    let points = background.map_err(|error| refused(Reason::of(error, Cloud::Background)))?;
    let outward = request.outward.copy_into(&mut buffers.outward);
    let directions = outward.map_err(|error| refused(Reason::of(error, Cloud::Target)))?;
    let task = request.task(
        &buffers.background[..points],
        &buffers.outward[..directions],
    );
    let watch = |progress: Progress<'_, '_>| match progress {
        Progress::Next => check().map_err(Interrupted::Stop),
        Progress::Step(step, registration) => {
            if request.trace {
                let pose = registration.target_from_source();
                steps.push(step_bytes(step.action, pose.to_rows()));
            }
            Ok(())
        }
    };
    let workspace = &mut buffers.workspace;
    let found = pipeline::register(registrar, workspace, [source, target], &task, watch);
    let found = found.map_err(|interrupted| match interrupted {
        Interrupted::Stop(ended) => ended,
        Interrupted::Failed(error) => refused(Reason::of(error, Cloud::Target)),
    })?;
    let mut reply = RefineReply {
        id,
        target_from_source: found.target_from_source.to_rows(),
        steps: found.policy.map_or(0, |policy| policy.steps as u8),
        mode: request.mode.resolved(),
        verdict: found.verdict,
        probability: found.probability,
        fit: found.refinement.as_ref().map(Fit::of),
        waited_micros: micros(started.duration_since(job.arrived)),
        micros: 0,
        policy_version: policy.version,
    };
    reply.micros = micros(started.elapsed());
    let trace = || {
        trace_frame(Trace {
            policy: *policy,
            kernels: KernelName::try_from(Isa::best().name()).unwrap_or_default(),
            request: payload,
            steps: StepsView::of(&steps),
            reply,
        })
    };
    Ok(Answered {
        reply,
        reached: reached(&found, source),
        trace: request.trace.then(trace),
    })
}

/// Of a converged pose that was refined after the policy's steps: whether the policy itself had reached it.
fn reached(found: &Answer, source: &[[f32; 3]]) -> Option<bool> {
    let policy = found.policy?.target_from_source;
    let refined = found.refinement.as_ref()?.refined;
    if found.verdict != Verdict::Converged {
        return None;
    }
    let given = found.target_from_source;
    let centroid = centroid(source);
    let apart = policy.apply(centroid).distance(given.apply(centroid));
    let near = REACHED_RADII * refined.covariance.radius;
    Some(policy.angle_to(&given) < REACHED_RAD && apart < near)
}

fn micros(time: Duration) -> u32 {
    u32::try_from(time.as_micros()).unwrap_or(u32::MAX)
}

/// Copies a cloud out of the frame and checks it.
fn checked_copy<'c>(
    cloud: Cloud,
    view: &CloudView<'_>,
    space: &'c mut [[f32; 3]],
) -> Result<&'c [[f32; 3]], Reason> {
    let points = view.copy_into(space).and_then(|count| {
        let points = &space[..count];
        check_cloud(points).map(|()| points)
    });
    points.map_err(|error| Reason::of(error, cloud))
}

#[cfg(all(test, feature = "demo"))]
mod tests {
    use super::*;
    use host_train::policy::{WeightFile, manifest};
    use std::path::Path;

    #[test]
    fn a_policy_that_was_damaged_in_memory_is_no_missing_one() {
        let file = WeightFile::bundled(Path::new("compact")).expect("bundled");
        let manifest = manifest::manifest(1, "compact", &file).expect("a sound policy");
        let mut loaded = LoadedPolicy::new(manifest, file.bytes()).expect("a sound policy");
        let mut scratch = Box::new(Scratch::new());
        let mut why = |loaded: Option<&LoadedPolicy>| Engine::start(loaded, &mut scratch).err();
        assert_eq!(why(None), Some(Reason::NoPolicy));
        assert_eq!(why(Some(&loaded)), None);
        loaded.flip_a_bit();
        assert_eq!(why(Some(&loaded)), Some(Reason::PolicyDamaged));
    }
}
