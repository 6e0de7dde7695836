//! Logs routers that come and go. Without a router, nobody hears anything else that a robot says.

use crate::view::View;
use reagent_link::routers;
use std::sync::Arc;
use tokio::sync::watch;
use zenoh::Session;
use zenoh::session::TransportEventsListener;

/// Logs every router that this session finds and loses, and keeps count of them.
pub(crate) async fn follow_routers(
    session: &Session,
    view: Arc<watch::Sender<View>>,
) -> zenoh::Result<TransportEventsListener<()>> {
    let told = move |router, found| {
        match found {
            true => tracing::info!("connected to router {router}"),
            false => tracing::warn!("lost router {router}; looking for it"),
        }
        view.send_modify(|view| view.count_router(found));
    };
    routers::follow_routers(session, told).await
}
