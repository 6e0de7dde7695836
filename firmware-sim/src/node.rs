//! A simulated robot: fetches the fleet's policy, keeps it, and answers refine requests with it.

use crate::board::Board;
use crate::bridge;
use crate::policy::UpdateError;
use crate::service::{read_request, send_refusal, serve, small_frame};
use crate::updates::Updates;
use crate::view::View;
use ed25519_dalek::VerifyingKey;
use reagent_core::wire::{Message, Reason, Refusal, keys};
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use zenoh::handlers::RingChannel;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

/// Requests that wait while one runs; one more is refused as busy.
pub const QUEUE: usize = 4;
/// The robot id that `refine` takes for "whichever is there".
pub const ANY: &str = "any";

/// What a node is told at its start.
#[derive(Clone, Debug)]
pub struct NodeConfig {
    /// Fleet it belongs to.
    pub fleet: String,
    /// Its own name in the fleet.
    pub robot: String,
    /// Keys whose policies it takes; if empty, those of any key.
    pub trusted: Vec<VerifyingKey>,
    /// Where it keeps its policy over restarts.
    pub state: Option<PathBuf>,
}

/// Why a node did not start.
#[derive(Debug, Error)]
pub enum NodeError {
    /// A name cannot be part of a key expression.
    #[error("fleet {fleet:?}, robot {robot:?}: {reason}")]
    Name {
        /// As given.
        fleet: String,
        /// As given.
        robot: String,
        /// What is allowed.
        reason: reagent_core::Error,
    },
    /// The name is the one that means every robot.
    #[error("a robot cannot be called {ANY:?}: clients use it for whichever robot is there")]
    Reserved,
    /// The state directory cannot be used.
    #[error(transparent)]
    Store(#[from] UpdateError),
    /// The session failed.
    #[error("zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
}

/// A running node. Dropping it takes it off the network.
#[derive(Debug)]
pub struct Node {
    view: watch::Receiver<View>,
    tasks: [JoinHandle<()>; 2],
    _refine: Queryable<()>,
    _status: Queryable<()>,
    _alive: LivelinessToken,
}

impl Node {
    /// Starts a node on an open session. It answers at once, and serves as soon as it has a policy:
    /// the one it kept, or the one announced now or later.
    ///
    /// # Errors
    /// See [`NodeError`]; a damaged policy in the state directory is only logged.
    pub async fn start(session: Session, config: NodeConfig) -> Result<Node, NodeError> {
        Node::start_with(session, config, None).await
    }

    /// As [`Node::start`], with a board that does the work.
    ///
    /// # Errors
    /// As [`Node::start`].
    pub async fn start_with(
        session: Session,
        config: NodeConfig,
        board: Option<Board>,
    ) -> Result<Node, NodeError> {
        let NodeConfig { fleet, robot, .. } = &config;
        if robot == ANY {
            return Err(NodeError::Reserved);
        }
        let name = |reason| NodeError::Name {
            fleet: fleet.clone(),
            robot: robot.clone(),
            reason,
        };
        let refine_key = keys::refine(fleet, robot).map_err(name)?;
        let status_key = keys::status(fleet, robot).map_err(name)?;
        let alive_key = keys::alive(fleet, robot).map_err(name)?;
        if config.trusted.is_empty() {
            tracing::warn!("no trusted keys: a policy signed by any key is taken (see --trust)");
        }

        let (view, seen) = watch::channel(View::default());
        let view = Arc::new(view);
        let updates = Updates::new(session.clone(), config.clone(), view.clone()).await?;

        let (queue, requests) = mpsc::channel(QUEUE);
        let (policies, worker_view) = (updates.policies(), view.clone());
        let reply_key = refine_key.clone();
        tokio::task::spawn_blocking(move || match board {
            Some(board) => bridge::serve(board, requests, policies, &reply_key, &worker_view),
            None => serve(requests, policies, &reply_key, &worker_view),
        });
        let queue_view = view.clone();
        let refine = session
            .declare_queryable(refine_key.as_str())
            .complete(true)
            .callback(move |query| enqueue(query, &queue, &queue_view))
            .await?;

        let (answered, reply_key) = (seen.clone(), status_key.clone());
        let status = session
            .declare_queryable(status_key.as_str())
            .complete(true)
            .callback(move |query| {
                let frame = small_frame(&Message::Status(answered.borrow().status()));
                if let Err(error) = query.reply(reply_key.as_str(), frame).wait() {
                    tracing::warn!("status was not sent: {error}");
                }
            })
            .await?;
        let publishing = publish_status(session.clone(), status_key, seen.clone());

        let manifest_key = keys::manifest(fleet).map_err(name)?;
        let announced = session
            .declare_subscriber(manifest_key.as_str())
            .with(RingChannel::new(4))
            .await?;
        let alive = session
            .liveliness()
            .declare_token(alive_key.as_str())
            .await?;
        Ok(Node {
            view: seen,
            tasks: [
                tokio::spawn(publishing),
                tokio::spawn(updates.follow(manifest_key, announced)),
            ],
            _refine: refine,
            _status: status,
            _alive: alive,
        })
    }

    /// Takes the node off the network and waits until its flash is free for another.
    pub async fn stop(mut self) {
        for task in &mut self.tasks {
            task.abort();
            // Cancelled, as asked.
            task.await.ok();
        }
    }

    /// Watches the node's state.
    pub fn watch(&self) -> watch::Receiver<View> {
        self.view.clone()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        self.tasks.iter().for_each(JoinHandle::abort);
    }
}

/// Puts a request into the queue, or refuses it as busy.
fn enqueue(query: Query, queue: &mpsc::Sender<Query>, view: &watch::Sender<View>) {
    view.send_modify(|view| view.in_hand = view.in_hand.saturating_add(1));
    let (query, reason) = match queue.try_send(query) {
        Ok(()) => return,
        Err(TrySendError::Full(query)) => (query, Reason::Busy),
        Err(TrySendError::Closed(query)) => (query, Reason::Internal),
    };
    view.send_modify(View::count_refused);
    let payload = query.payload().map(|p| p.to_bytes()).unwrap_or_default();
    let id = read_request(&payload).map_or(0, |request| request.id);
    send_refusal(&query, Refusal { id, reason });
}

/// Publishes the status whenever it has changed; changes in quick succession are one publication.
async fn publish_status(session: Session, key: keys::Key, mut seen: watch::Receiver<View>) {
    loop {
        let frame = small_frame(&Message::Status(seen.borrow_and_update().status()));
        if let Err(error) = session.put(key.as_str(), frame).await {
            tracing::warn!("status was not published: {error}");
        }
        if seen.changed().await.is_err() {
            return;
        }
    }
}
