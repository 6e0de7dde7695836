//! The refinement service of a node whose controller is a board: frames and policies go over the board's line unchanged.

use crate::board::{Board, BoardError, Kind};
use crate::frames::{Outlet, read_request, trace_frame};
use crate::policy::{LoadedPolicy, UpdateError};
use crate::queue::{Queue, Stop};
use crate::service::{Work, next_work};
use crate::view::View;
use reagent_core::wire::{
    KernelName, Manifest, Reason, RefineReply, Refusal, STEP_BYTES, StepsView, Trace, step_bytes,
};
use std::ops::ControlFlow;
use std::sync::Arc;
use tokio::sync::watch;

/// Hands requests to the board until the queue is closed. Between requests it also hands over every new policy.
pub(crate) fn serve(
    mut board: Board,
    queue: &Queue,
    mut policies: watch::Receiver<Option<Arc<LoadedPolicy>>>,
    outlet: &Outlet,
) {
    let mut in_flash = None;
    policies.mark_changed();
    loop {
        match next_work(queue, &mut policies) {
            None => return,
            Some(Work::Policy) => {
                let loaded = policies.borrow_and_update().clone();
                if let Some(loaded) = loaded {
                    load(&mut board, &mut in_flash, &loaded, &outlet.view);
                }
            }
            Some(Work::Job(job)) => {
                let payload = job.query.payload().map(|p| p.to_bytes());
                let payload = payload.unwrap_or_default();
                let mut steps = Vec::new();
                let answer = job.check().ok().map(|()| {
                    let answer = board.refine(&payload, |taken| {
                        steps.push(step_bytes(taken.action, taken.target_from_source));
                        match job.check() {
                            Ok(()) => ControlFlow::Continue(()),
                            Err(_) => ControlFlow::Break(()),
                        }
                    });
                    if let Err(BoardError::Restarted) = answer {
                        policies.mark_changed();
                    }
                    answer.unwrap_or_else(|error| failed(&error, &payload))
                });
                queue.done();
                let answer = match (job.check(), answer) {
                    (Err(Stop::TakenBack), _) => {
                        outlet.view.send_modify(View::count_taken_back);
                        continue;
                    }
                    (_, Some(Ok(reply))) => Ok(reply),
                    (Ok(()), Some(refused)) => refused,
                    (Err(Stop::Deadline), _) | (_, None) => refusal(&payload, Reason::Deadline),
                };
                // Boards do not refine.
                outlet.settle(&job.query, answer, None);
                if let (Ok(reply), Some(manifest)) = (answer, &in_flash)
                    && read_request(&payload).is_ok_and(|request| request.trace)
                {
                    outlet.publish_trace(traced(board.kind(), manifest, &payload, &steps, reply));
                }
            }
        }
    }
}

/// The frame of a board's trace.
fn traced(
    kind: Kind,
    manifest: &Manifest,
    request: &[u8],
    steps: &[[u8; STEP_BYTES]],
    reply: RefineReply,
) -> Vec<u8> {
    trace_frame(Trace {
        policy: manifest.id(),
        kernels: KernelName::try_from(kind.name()).unwrap_or_default(),
        request,
        steps: StepsView::of(steps),
        reply,
    })
}

/// Writes a policy into the board's flash. If the board refuses it, the node does not claim to have it.
fn load(
    board: &mut Board,
    in_flash: &mut Option<Manifest>,
    loaded: &LoadedPolicy,
    view: &watch::Sender<View>,
) {
    let manifest = loaded.manifest();
    let version = manifest.version;
    match board.load(manifest, loaded.bytes()) {
        Ok(()) => {
            tracing::info!("policy version {version} is in the board's flash");
            *in_flash = Some(manifest.clone());
        }
        Err(error) => {
            tracing::warn!("policy version {version} is not in the board's flash: {error}");
            let kept = board.ask().ok().and_then(|(status, _)| status.policy);
            in_flash.take_if(|last| kept.is_none_or(|kept| kept.sha256 != last.sha256));
            view.send_modify(|view| {
                view.policy = in_flash.clone();
                view.refuse_policy(Some(manifest.id()), UpdateError::Board(error));
            });
        }
    }
}

fn failed(error: &BoardError, payload: &[u8]) -> Result<RefineReply, Refusal> {
    tracing::error!("{error}");
    let reason = match error {
        BoardError::Silent | BoardError::Restarted => Reason::Busy,
        _ => Reason::Internal,
    };
    refusal(payload, reason)
}

fn refusal(payload: &[u8], reason: Reason) -> Result<RefineReply, Refusal> {
    let id = read_request(payload).map_or(0, |request| request.id);
    Err(Refusal { id, reason })
}
