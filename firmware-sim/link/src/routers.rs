//! Routers that come and go.

use zenoh::Session;
use zenoh::config::WhatAmI;
use zenoh::sample::SampleKind;
use zenoh::session::{TransportEventsListener, ZenohId};

/// Tells of every router that this session finds (true) and loses (false), also of those that are there already.
///
/// # Errors
/// The session's.
pub async fn follow_routers(
    session: &Session,
    told: impl Fn(ZenohId, bool) + Send + Sync + 'static,
) -> zenoh::Result<TransportEventsListener<()>> {
    let info = session.info();
    let listener = info.transport_events_listener().history(true);
    let listener = listener.callback(move |event| {
        let transport = event.transport();
        if transport.whatami() == WhatAmI::Router {
            told(*transport.zid(), event.kind() == SampleKind::Put);
        }
    });
    listener.await
}
