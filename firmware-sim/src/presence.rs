//! Who else is there: robots of the same name, and clients that go away.

use crate::queue::Queue;
use crate::view::View;
use reagent_core::Error;
use reagent_core::wire::{self, Message, Status, keys};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::query::QueryTarget;
use zenoh::sample::SampleKind;

/// A running robot of this name answers within this time. One whose link has just died does not answer, and its successor need
/// not wait longer.
const ANSWER_TIME: Duration = Duration::from_secs(1);

/// The instances that answer a query of a status key now.
pub(crate) async fn instances(
    session: &Session,
    status_key: &keys::Key,
) -> zenoh::Result<Vec<u32>> {
    let replies = session
        .get(status_key.as_str())
        .target(QueryTarget::All)
        .timeout(ANSWER_TIME)
        .await?;
    let mut found = Vec::new();
    while let Ok(reply) = replies.recv_async().await {
        let sample = reply.result().ok();
        found.extend(sample.and_then(|s| read_status(&s.payload().to_bytes())));
    }
    Ok(found.into_iter().map(|status| status.instance).collect())
}

fn read_status(payload: &[u8]) -> Option<Status> {
    match wire::decode(payload) {
        Ok(Message::Status(status)) => Some(status),
        _ => None,
    }
}

/// Watches what is published as this robot's status, and reports it if another robot publishes there.
pub(crate) async fn watch_for_duplicates(
    session: &Session,
    status_key: &keys::Key,
    instance: u32,
    view: Arc<watch::Sender<View>>,
) -> zenoh::Result<Subscriber<()>> {
    let key = status_key.clone();
    session
        .declare_subscriber(status_key.as_str())
        .callback(move |sample| {
            let foreign = |status: Status| status.instance != instance;
            let duplicate = read_status(&sample.payload().to_bytes()).is_some_and(foreign);
            view.send_if_modified(|view| {
                let new = duplicate && !view.duplicate;
                if new {
                    tracing::error!("another robot publishes at {key}: give each its own name");
                    view.duplicate = true;
                }
                new
            });
        })
        .await
}

/// Takes requests back if their clients say so or are gone.
pub(crate) async fn follow_clients(
    session: &Session,
    fleet: &str,
    robot: &str,
    queue: Arc<Queue>,
) -> zenoh::Result<[Subscriber<()>; 2]> {
    let named = |key: Result<keys::Key, Error>| key.map_err(|error| error.to_string());
    let cancelled = queue.clone();
    let cancel = session
        .declare_subscriber(named(keys::cancel(fleet, robot))?.as_str())
        .callback(move |sample| {
            let session = sample.source_info().map(|source| source.source_id().zid());
            if let (Some(session), Ok(Message::Cancel(request))) =
                (session, wire::decode(&sample.payload().to_bytes()))
            {
                cancelled.take_back(request, session);
            }
        })
        .await?;
    let gone = session
        .liveliness()
        .declare_subscriber(named(keys::all_clients_alive(fleet))?.as_str())
        // Clients that are already there must be known, so that their end is noticed.
        .history(true)
        .callback(move |sample| {
            let number = keys::client_of(sample.key_expr().as_str());
            if let (SampleKind::Delete, Some(number)) = (sample.kind(), number) {
                queue.session_gone(number);
            }
        })
        .await?;
    Ok([cancel, gone])
}
