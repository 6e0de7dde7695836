//! Routers that come and go.

use std::sync::Mutex;
use zenoh::Session;
use zenoh::config::WhatAmI;
use zenoh::sample::SampleKind;
use zenoh::session::TransportEventsListener;

/// Logs every router that this session finds and loses, also those that are there already, and tells how many there are then.
///
/// # Errors
/// The session's.
pub async fn follow_routers(
    session: &Session,
    told: impl Fn(usize) + Send + Sync + 'static,
) -> zenoh::Result<TransportEventsListener<()>> {
    let info = session.info();
    let listener = info.transport_events_listener().history(true);
    // How many there are, and whether one was lost since the last came.
    let state = Mutex::new((0usize, false));
    let listener = listener.callback(move |event| {
        let transport = event.transport();
        if transport.whatami() != WhatAmI::Router {
            return;
        }
        let router = transport.zid();
        let (count, lost) = &mut *state.lock().expect("no holder panics");
        if event.kind() == SampleKind::Put {
            // What was told of a loss is told of its end.
            match std::mem::take(lost) {
                true => tracing::warn!(%router, "connected to router {router} again"),
                false => tracing::info!(%router, "connected to router {router}"),
            }
            *count += 1;
        } else {
            *lost = true;
            tracing::warn!(%router, "lost router {router}; looking for it");
            *count = count.saturating_sub(1);
        }
        told(*count);
    });
    listener.await
}
