//! Following the fleet's policy: announcements in, verified policies out.

use crate::fetch::{Jitter, download};
use crate::node::NodeConfig;
use crate::policy::{LoadedPolicy, UpdateError, verified_manifest};
use crate::store::Store;
use crate::view::View;
use reagent_core::wire::{Manifest, keys};
use std::sync::Arc;
use tokio::sync::watch;
use zenoh::Session;
use zenoh::handlers::RingChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

/// Takes policies into use.
pub(crate) struct Updates {
    session: Session,
    config: NodeConfig,
    store: Store,
    jitter: Jitter,
    policies: watch::Sender<Option<Arc<LoadedPolicy>>>,
    view: Arc<watch::Sender<View>>,
}

impl Updates {
    /// Starts from the policy kept in flash, if there is a good one.
    pub(crate) async fn new(
        session: Session,
        config: NodeConfig,
        view: Arc<watch::Sender<View>>,
    ) -> Result<Self, UpdateError> {
        let mut updates = Updates {
            session,
            store: Store::open(config.state.as_deref()).await?,
            jitter: Jitter::of(&config.robot),
            policies: watch::Sender::new(None),
            view,
            config,
        };
        match updates.store.boot(&updates.config.trusted).await {
            Ok(Some(kept)) => updates.swap(kept),
            Ok(None) => {}
            Err(error) => updates.refused(error),
        }
        Ok(updates)
    }

    /// The policy in use, as it changes.
    pub(crate) fn policies(&self) -> watch::Receiver<Option<Arc<LoadedPolicy>>> {
        self.policies.subscribe()
    }

    /// Takes announced policies as they come, and asks for the manifest whenever somebody appears
    /// who answers for it: an announcement made before this robot listened is not missed.
    pub(crate) async fn follow(
        mut self,
        key: keys::Key,
        announced: Subscriber<RingChannelHandler<Sample>>,
    ) {
        if let Err(error) = self.try_follow(&key, announced).await {
            tracing::error!("no longer following policies: {error}");
        }
    }

    async fn try_follow(
        &mut self,
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

    async fn ask(&mut self, key: &keys::Key) -> zenoh::Result<()> {
        let replies = self.session.get(key.as_str()).await?;
        while let Ok(reply) = replies.recv_async().await {
            if let Ok(sample) = reply.result() {
                self.consider(&sample.payload().to_bytes()).await;
            }
        }
        Ok(())
    }

    /// Takes the announced policy if it is trusted, newer and whole.
    async fn consider(&mut self, signed_manifest: &[u8]) {
        match self.update(signed_manifest).await {
            Ok(Some(policy)) => self.swap(policy),
            Ok(None) => {}
            Err(error) => self.refused(error),
        }
    }

    async fn update(
        &mut self,
        signed_manifest: &[u8],
    ) -> Result<Option<LoadedPolicy>, UpdateError> {
        let trusted = &self.config.trusted;
        let manifest = verified_manifest(signed_manifest, trusted)?;
        let in_use = self.view.borrow().policy.clone();
        let (announced, floor) = (manifest.version, self.store.floor());
        // Of two policies that were given one version, all robots end with the same. One whose policy was damaged
        // in flash takes the same version again.
        let order = |m: &Manifest| (m.version, m.sha256);
        let known = in_use.is_some_and(|in_use| order(&manifest) <= order(&in_use));
        if known || announced < floor {
            tracing::debug!("policy version {announced} ignored: {floor} is or was in use");
            return Ok(None);
        }
        let fleet = &self.config.fleet;
        let (slots, jitter) = (self.store.slots(), &mut self.jitter);
        download(
            &self.session,
            fleet,
            &manifest,
            signed_manifest,
            slots,
            jitter,
        )
        .await?;
        self.store.take(&manifest, trusted).await.map(Some)
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
