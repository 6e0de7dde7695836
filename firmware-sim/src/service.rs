//! The refinement service: request frame in, pose or refusal out, one at a time.

use crate::policy::LoadedPolicy;
use crate::view::View;
use reagent_core::dims::MAX_POINTS;
use reagent_core::net::Scratch;
use reagent_core::register::check_cloud;
use reagent_core::wire::{
    self, Cloud, CloudView, Message, Reason, RefineReply, RefineRequest, Refusal,
};
use reagent_core::{Frame, Policy, Pose, Registrar, Verdict};
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::{mpsc, watch};
use zenoh::Wait;
use zenoh::query::Query;

/// Answers queued requests until the queue is closed, always with the newest policy. A policy that
/// arrives while a request runs is used from the next request on.
pub(crate) fn serve(
    mut requests: mpsc::Receiver<Query>,
    mut policies: watch::Receiver<Option<Arc<LoadedPolicy>>>,
    reply_key: &str,
    view: &watch::Sender<View>,
) {
    let mut scratch = Box::new(Scratch::new());
    let mut clouds = Clouds::new();
    let mut waiting = None;
    loop {
        let loaded = policies.borrow_and_update().clone();
        let mut engine = loaded.as_deref().and_then(|loaded| {
            let policy = Policy::parse(loaded.bytes()).ok()?;
            let registrar = Registrar::new(policy, &mut scratch);
            Some((registrar, loaded.manifest().version))
        });
        loop {
            let Some(query) = waiting.take().or_else(|| requests.blocking_recv()) else {
                return;
            };
            if policies.has_changed().unwrap_or(false) {
                waiting = Some(query);
                break;
            }
            let payload = query.payload().map(|p| p.to_bytes()).unwrap_or_default();
            let answer = answer(engine.as_mut(), &mut clouds, &payload);
            settle(&query, reply_key, answer, view);
        }
    }
}

/// Buffers of the clouds being registered, in the alignment that the kernels read.
struct Clouds {
    source: Box<[[f32; 3]]>,
    target: Box<[[f32; 3]]>,
}

impl Clouds {
    fn new() -> Self {
        let empty = || vec![[0.0; 3]; MAX_POINTS].into_boxed_slice();
        Clouds {
            source: empty(),
            target: empty(),
        }
    }
}

fn answer(
    engine: Option<&mut (Registrar<'_, '_>, u64)>,
    clouds: &mut Clouds,
    payload: &[u8],
) -> Result<RefineReply, Refusal> {
    let request = read_request(payload)?;
    let refused = |reason| Refusal {
        id: request.id,
        reason,
    };
    let Some((registrar, policy_version)) = engine else {
        return Err(refused(Reason::NoPolicy));
    };
    let source = taken(Cloud::Source, &request.source, &mut clouds.source).map_err(refused)?;
    let target = taken(Cloud::Target, &request.target, &mut clouds.target).map_err(refused)?;
    let initial = request.initial.map_or(Pose::IDENTITY, Pose::from_rows);
    let started = Instant::now();
    let mut registration = Frame::of(target)
        .and_then(|frame| registrar.start(source, target, frame, initial))
        .map_err(|error| refused(Reason::of(error, Cloud::Target)))?;
    let mut steps = 0;
    // After a stop on every axis each further step would see the same and stop again.
    while steps < request.max_steps && registration.verdict() != Verdict::Converged {
        registrar.step(&mut registration);
        steps += 1;
    }
    Ok(RefineReply {
        id: request.id,
        target_from_source: registration.target_from_source().to_rows(),
        steps,
        verdict: registration.verdict(),
        micros: u32::try_from(started.elapsed().as_micros()).unwrap_or(u32::MAX),
        policy_version: *policy_version,
    })
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

/// Counts the answer to a query and sends it.
pub(crate) fn settle(
    query: &Query,
    reply_key: &str,
    answer: Result<RefineReply, Refusal>,
    view: &watch::Sender<View>,
) {
    view.send_modify(|view| match answer {
        Ok(_) => view.count_served(),
        Err(_) => view.count_refused(),
    });
    match answer {
        Ok(reply) => send_reply(query, reply_key, reply),
        Err(refusal) => send_refusal(query, refusal),
    }
}

/// Answers a query with a pose.
fn send_reply(query: &Query, key: &str, reply: RefineReply) {
    let frame = small_frame(&Message::RefineReply(reply));
    if let Err(error) = query.reply(key, frame).wait() {
        tracing::warn!("reply {} was not sent: {error}", reply.id);
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
