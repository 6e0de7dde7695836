//! Logs routers that come and go. Without a router, nobody hears anything else that a robot says.

use crate::view::View;
use std::sync::Arc;
use tokio::sync::watch;
use zenoh::Session;
use zenoh::config::WhatAmI;
use zenoh::sample::SampleKind;
use zenoh::session::TransportEventsListener;

/// Logs every router that this session finds and loses, and keeps count of them.
pub(crate) async fn follow_routers(
    session: &Session,
    view: Arc<watch::Sender<View>>,
) -> zenoh::Result<TransportEventsListener<()>> {
    let info = session.info();
    let listener = info.transport_events_listener().history(true);
    let listener = listener.callback(move |event| {
        let transport = event.transport();
        if transport.whatami() != WhatAmI::Router {
            return;
        }
        let router = transport.zid();
        let found = event.kind() == SampleKind::Put;
        match found {
            true => tracing::info!("connected to router {router}"),
            false => tracing::warn!("lost router {router}; looking for it"),
        }
        view.send_modify(|view| view.count_router(found));
    });
    listener.await
}
