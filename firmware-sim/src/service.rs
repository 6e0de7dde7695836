//! The refinement service: request frame in, pose or refusal out, one at a time.

use crate::policy::LoadedPolicy;
use crate::queue::{Job, Queue, Stop};
use crate::view::View;
use reagent_core::dims::MAX_POINTS;
use reagent_core::frame::check_cloud;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::pipeline::{self, Progress};
use reagent_core::polish::Workspace;
use reagent_core::wire::{
    self, Cloud, CloudView, Fit, KernelName, Message, PolicyId, Reason, RefineReply, RefineRequest,
    Refusal, STEP_BYTES, StepsView, Trace, keys, step_bytes,
};
use reagent_core::{Error, Registrar};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::runtime::Handle;
use tokio::sync::watch;
use zenoh::qos::CongestionControl;
use zenoh::query::Query;
use zenoh::{Session, Wait};

/// Where a robot's answers and traces go.
pub(crate) struct Outlet {
    pub(crate) session: Session,
    pub(crate) reply_key: keys::Key,
    pub(crate) trace_key: keys::Key,
    pub(crate) view: Arc<watch::Sender<View>>,
}

/// Answers queued requests until the queue is closed, always with the newest policy. A policy that
/// arrives while a request runs is used from the next request on.
pub(crate) fn serve(
    queue: &Queue,
    mut policies: watch::Receiver<Option<Arc<LoadedPolicy>>>,
    outlet: &Outlet,
) {
    let mut scratch = Box::new(Scratch::new());
    let mut buffers = Buffers::new();
    loop {
        let loaded = policies.borrow_and_update().clone();
        let mut engine = loaded.as_deref().and_then(|loaded| {
            let policy = loaded.policy().ok()?;
            Some(Engine {
                registrar: Registrar::new(policy, &mut scratch),
                policy: loaded.manifest().id(),
            })
        });
        loop {
            let job = match next_work(queue, &mut policies) {
                Some(Work::Job(job)) => job,
                Some(Work::Policy) => break,
                None => return,
            };
            let payload = job.query.payload().map(|p| p.to_bytes());
            let payload = payload.unwrap_or_default();
            let answer = answer(engine.as_mut(), &mut buffers, &payload, &job);
            queue.done();
            match answer {
                Ok((reply, trace)) => {
                    outlet.settle(&job.query, Ok(reply));
                    if let Some(trace) = trace {
                        outlet.publish_trace(trace);
                    }
                }
                Err(Ended::Refused(refusal)) => outlet.settle(&job.query, Err(refusal)),
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
    /// Take up the policy that has come: checked and packed before the next request, which so need not wait for it.
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

/// A policy at work.
struct Engine<'w, 's> {
    registrar: Registrar<'w, 's>,
    policy: PolicyId,
}

/// Working memory of registrations, in the alignment that the kernels read.
struct Buffers {
    source: Box<[[f32; 3]]>,
    target: Box<[[f32; 3]]>,
    workspace: Box<Workspace>,
}

impl Buffers {
    fn new() -> Self {
        let empty = || vec![[0.0; 3]; MAX_POINTS].into_boxed_slice();
        Buffers {
            source: empty(),
            target: empty(),
            workspace: Box::new(Workspace::new()),
        }
    }
}

/// Why there is no pose.
enum Ended {
    Refused(Refusal),
    TakenBack,
}

/// Why a verification did not end.
enum Interrupted {
    Stop(Ended),
    Failed(Error),
}

impl From<Error> for Interrupted {
    fn from(error: Error) -> Self {
        Interrupted::Failed(error)
    }
}

/// Registers the clouds of a request; its trace too, where it wants one.
fn answer(
    engine: Option<&mut Engine<'_, '_>>,
    buffers: &mut Buffers,
    payload: &[u8],
    job: &Job,
) -> Result<(RefineReply, Option<Vec<u8>>), Ended> {
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
    let Some(Engine { registrar, policy }) = engine else {
        return Err(refused(Reason::NoPolicy));
    };
    let started = Instant::now();
    let source = taken(Cloud::Source, &request.source, &mut buffers.source).map_err(refused)?;
    let target = taken(Cloud::Target, &request.target, &mut buffers.target).map_err(refused)?;
    let mut steps = Vec::new();
    let task = request.task();
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
    Ok((reply, request.trace.then(trace)))
}

/// The frame of a trace.
pub(crate) fn trace_frame(trace: Trace<'_>) -> Vec<u8> {
    let steps = trace.steps.iter().count() * STEP_BYTES;
    let mut frame = vec![0; wire::SMALL_FRAME_BYTES + trace.request.len() + steps];
    let length = wire::encode(&Message::Trace(trace), &mut frame).map_or(0, <[u8]>::len);
    frame.truncate(length);
    frame
}

fn micros(time: Duration) -> u32 {
    u32::try_from(time.as_micros()).unwrap_or(u32::MAX)
}

/// The request in a payload; a refusal without id where there is none.
pub(crate) fn read_request(payload: &[u8]) -> Result<RefineRequest<'_>, Refusal> {
    let reason = match wire::decode(payload) {
        Ok(Message::RefineRequest(request)) => return Ok(request),
        Ok(_) => Reason::Malformed,
        Err(error) => Reason::of(error, Cloud::Source),
    };
    Err(Refusal { id: 0, reason })
}

/// Copies a cloud out of the frame and checks it.
fn taken<'c>(
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

impl Outlet {
    /// Counts the answer to a query and sends it.
    pub(crate) fn settle(&self, query: &Query, answer: Result<RefineReply, Refusal>) {
        self.view.send_modify(|view| match answer {
            Ok(reply) => view.count_served(&reply),
            Err(_) => view.count_refused(),
        });
        let reply = match answer {
            Ok(reply) => reply,
            Err(refusal) => {
                tracing::info!("request {} refused: {}", refusal.id, refusal.reason);
                return send_refusal(query, refusal);
            }
        };
        let ms = f64::from(reply.micros) / 1e3;
        tracing::info!("request {}: {} in {ms:.1} ms", reply.id, reply.verdict);
        let frame = small_frame(&Message::RefineReply(reply));
        if let Err(error) = query.reply(self.reply_key.as_str(), frame).wait() {
            tracing::warn!("reply {} was not sent: {error}", reply.id);
        }
    }

    /// Publishes the frame of a trace.
    pub(crate) fn publish_trace(&self, frame: Vec<u8>) {
        let sent = self
            .session
            .put(self.trace_key.as_str(), frame)
            .congestion_control(CongestionControl::Block);
        if let Err(error) = sent.wait() {
            tracing::warn!("a trace was not published: {error}");
        }
    }
}

/// Answers a query with a refusal.
pub(crate) fn send_refusal(query: &Query, refusal: Refusal) {
    tracing::debug!("refused request {}: {}", refusal.id, refusal.reason);
    let frame = small_frame(&Message::Refusal(refusal));
    if let Err(error) = query.reply_err(frame).wait() {
        tracing::warn!("refusal {} was not sent: {error}", refusal.id);
    }
}

/// A frame of any message but a request.
pub(crate) fn small_frame(message: &Message<'_>) -> Vec<u8> {
    let mut buffer = [0; wire::SMALL_FRAME_BYTES];
    wire::encode(message, &mut buffer)
        .expect("small frames fit their buffer")
        .to_vec()
}
