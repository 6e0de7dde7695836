//! A simulated robot: fetches the fleet's policy, keeps it, and answers refine requests with it.

use crate::fetch::fetch;
use crate::policy::{LoadedPolicy, UpdateError, verified_manifest};
use crate::service::{read_request, send_refusal, serve, small_frame};
use crate::store::Store;
use crate::view::View;
use ed25519_dalek::VerifyingKey;
use reagent_core::wire::{Manifest, Message, Reason, Refusal, keys};
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::{Query, Queryable};
use zenoh::sample::Sample;
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
        let updates = Updates::new(session.clone(), config, view.clone())?;

        let (queue, requests) = mpsc::channel(QUEUE);
        let (policies, worker_view) = (updates.policies.subscribe(), view.clone());
        let reply_key = refine_key.clone();
        tokio::task::spawn_blocking(move || serve(requests, policies, &reply_key, &worker_view));
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

        let manifest_key = updates.manifest_key()?;
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

/// Follows the announcements of the fleet's policy.
struct Updates {
    session: Session,
    config: NodeConfig,
    store: Option<Store>,
    policies: watch::Sender<Option<Arc<LoadedPolicy>>>,
    view: Arc<watch::Sender<View>>,
}

impl Updates {
    fn new(
        session: Session,
        config: NodeConfig,
        view: Arc<watch::Sender<View>>,
    ) -> Result<Self, UpdateError> {
        let store = config.state.as_deref().map(Store::open).transpose()?;
        let updates = Updates {
            session,
            store,
            policies: watch::Sender::new(None),
            view,
            config,
        };
        match updates
            .store
            .as_ref()
            .map(|s| s.load(&updates.config.trusted))
        {
            Some(Ok(Some(kept))) => updates.swap(kept),
            Some(Err(error)) => updates.refused(error),
            Some(Ok(None)) | None => {}
        }
        Ok(updates)
    }

    fn manifest_key(&self) -> Result<keys::Key, NodeError> {
        let NodeConfig { fleet, robot, .. } = &self.config;
        keys::manifest(fleet).map_err(|reason| NodeError::Name {
            fleet: fleet.clone(),
            robot: robot.clone(),
            reason,
        })
    }

    /// Takes announced policies as they come, and asks for the manifest whenever somebody appears
    /// who answers for it: an announcement made before this robot listened is not missed.
    async fn follow(self, key: keys::Key, announced: Subscriber<RingChannelHandler<Sample>>) {
        if let Err(error) = self.try_follow(&key, announced).await {
            tracing::error!("no longer following policies: {error}");
        }
    }

    async fn try_follow(
        &self,
        key: &keys::Key,
        announced: Subscriber<RingChannelHandler<Sample>>,
    ) -> zenoh::Result<()> {
        let querier = self.session.declare_querier(key.as_str()).await?;
        let publisher_there = querier.matching_listener().await?;
        self.ask(key).await?;
        loop {
            tokio::select! {
                sample = announced.recv_async() => self.consider(&sample?.payload().to_bytes()).await,
                matching = publisher_there.recv_async() => {
                    if matching?.matching() {
                        self.ask(key).await?;
                    }
                }
            }
        }
    }

    async fn ask(&self, key: &keys::Key) -> zenoh::Result<()> {
        let replies = self.session.get(key.as_str()).await?;
        while let Ok(reply) = replies.recv_async().await {
            if let Ok(sample) = reply.result() {
                self.consider(&sample.payload().to_bytes()).await;
            }
        }
        Ok(())
    }

    /// Takes the announced policy if it is trusted, newer and whole.
    async fn consider(&self, signed_manifest: &[u8]) {
        match self.update(signed_manifest).await {
            Ok(Some(policy)) => self.swap(policy),
            Ok(None) => {}
            Err(error) => self.refused(error),
        }
    }

    async fn update(&self, signed_manifest: &[u8]) -> Result<Option<LoadedPolicy>, UpdateError> {
        let manifest = verified_manifest(signed_manifest, &self.config.trusted)?;
        if let Some(current) = &self.view.borrow().policy
            && manifest.version <= current.version
        {
            let (announced, current) = (manifest.version, current.version);
            tracing::debug!("policy version {announced} ignored, {current} is in use");
            return Ok(None);
        }
        let policy = self.fetch_verified(manifest).await?;
        if let Some(store) = &self.store {
            store.save(signed_manifest, &policy)?;
        }
        Ok(Some(policy))
    }

    async fn fetch_verified(&self, manifest: Manifest) -> Result<LoadedPolicy, UpdateError> {
        let bytes = fetch(&self.session, &self.config.fleet, &manifest).await?;
        LoadedPolicy::new(manifest, &bytes)
    }

    fn swap(&self, policy: LoadedPolicy) {
        let manifest = policy.manifest().clone();
        let (name, version) = (&manifest.name, manifest.version);
        tracing::info!("policy {name:?} version {version} verified and in use");
        self.policies.send_replace(Some(Arc::new(policy)));
        self.view.send_modify(|view| view.policy = Some(manifest));
    }

    fn refused(&self, error: UpdateError) {
        tracing::warn!("policy not taken: {error}");
        self.view.send_modify(|view| {
            view.updates_refused += 1;
            view.last_refusal = Some(Arc::new(error));
        });
    }
}
