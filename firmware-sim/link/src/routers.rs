//! Routers that come and go.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
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
    let (count, lost) = (Mutex::new(0usize), AtomicBool::new(false));
    let listener = listener.callback(move |event| {
        let transport = event.transport();
        if transport.whatami() != WhatAmI::Router {
            return;
        }
        let router = transport.zid();
        let mut count = count.lock().expect("no holder panics");
        if event.kind() == SampleKind::Put {
            // What was told of a loss is told of its end.
            match lost.swap(false, Ordering::Relaxed) {
                true => tracing::warn!("connected to router {router} again"),
                false => tracing::info!("connected to router {router}"),
            }
            *count += 1;
        } else {
            lost.store(true, Ordering::Relaxed);
            tracing::warn!("lost router {router}; looking for it");
            *count = count.saturating_sub(1);
        }
        told(*count);
    });
    listener.await
}
