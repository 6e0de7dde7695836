//! Routers that come and go, in the log: what else a robot says then is heard by nobody.

use zenoh::Session;
use zenoh::config::WhatAmI;
use zenoh::sample::SampleKind;
use zenoh::session::TransportEventsListener;

/// Logs every router that this session finds and loses.
pub(crate) async fn follow_routers(
    session: &Session,
) -> zenoh::Result<TransportEventsListener<()>> {
    let info = session.info();
    let listener = info.transport_events_listener().history(true);
    let listener = listener.callback(|event| {
        let transport = event.transport();
        if transport.whatami() != WhatAmI::Router {
            return;
        }
        let router = transport.zid();
        match event.kind() {
            SampleKind::Put => tracing::info!("connected to router {router}"),
            SampleKind::Delete => tracing::warn!("lost router {router}; looking for it"),
        }
    });
    listener.await
}
