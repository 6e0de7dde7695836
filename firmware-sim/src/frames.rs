//! Frames of a robot on the network: reads requests, sends answers, refusals and traces.

use crate::view::View;
use reagent_core::wire::{
    self, Cloud, Message, Reason, RefineReply, RefineRequest, Refusal, STEP_BYTES, Trace, keys,
};
use std::sync::Arc;
use tokio::sync::watch;
use zenoh::qos::CongestionControl;
use zenoh::query::Query;
use zenoh::{Session, Wait};

/// Where a robot's answers and traces go.
pub(crate) struct Outlet {
    /// The robot's name, for the log.
    pub(crate) robot: String,
    pub(crate) session: Session,
    pub(crate) reply_key: keys::Key,
    pub(crate) trace_key: keys::Key,
    pub(crate) view: Arc<watch::Sender<View>>,
}

impl Outlet {
    /// Counts the answer to a query and sends it; `reached` is as for [`wire::Tally::count`].
    pub(crate) fn settle(
        &self,
        query: &Query,
        answer: Result<RefineReply, Refusal>,
        reached: Option<bool>,
    ) {
        self.view.send_modify(|view| match answer {
            Ok(reply) => view.count_served(&reply, reached),
            Err(_) => view.count_refused(),
        });
        let reply = match answer {
            Ok(reply) => reply,
            Err(refusal) => {
                tracing::info!(
                    robot = %self.robot,
                    request = refusal.id,
                    reason = %refusal.reason,
                    "request {} refused: {}", refusal.id, refusal.reason
                );
                return send_refusal(query, refusal);
            }
        };
        let ms = f64::from(reply.micros) / 1e3;
        tracing::info!(
            robot = %self.robot,
            request = reply.id,
            verdict = %reply.verdict,
            ms,
            "request {}: {} in {ms:.1} ms", reply.id, reply.verdict
        );
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

/// The request in a payload, or a refusal without an id if there is none.
pub(crate) fn read_request(payload: &[u8]) -> Result<RefineRequest<'_>, Refusal> {
    let reason = match wire::decode(payload) {
        Ok(Message::RefineRequest(request)) => return Ok(request),
        Ok(_) => Reason::Malformed,
        Err(error) => Reason::of(error, Cloud::Source),
    };
    Err(Refusal { id: 0, reason })
}

/// The frame of a trace.
pub(crate) fn trace_frame(trace: Trace<'_>) -> Vec<u8> {
    let steps = trace.steps.iter().count() * STEP_BYTES;
    let mut frame = vec![0; wire::SMALL_FRAME_BYTES + trace.request.len() + steps];
    let length = wire::encode(&Message::Trace(trace), &mut frame).map_or(0, <[u8]>::len);
    frame.truncate(length);
    frame
}

/// Answers a query with a refusal.
pub(crate) fn send_refusal(query: &Query, refusal: Refusal) {
    tracing::debug!("refused request {}: {}", refusal.id, refusal.reason);
    let frame = small_frame(&Message::Refusal(refusal));
    if let Err(error) = query.reply_err(frame).wait() {
        tracing::warn!("refusal {} was not sent: {error}", refusal.id);
    }
}

/// The frame of any message except a request or a trace.
pub(crate) fn small_frame(message: &Message<'_>) -> Vec<u8> {
    let mut buffer = [0; wire::SMALL_FRAME_BYTES];
    wire::encode(message, &mut buffer)
        .expect("small frames fit their buffer")
        .to_vec()
}
