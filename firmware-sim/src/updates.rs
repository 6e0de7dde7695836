//! Following the fleet's policy: announcements in, verified policies out.

use crate::fetch::fetch;
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
    store: Option<Store>,
    policies: watch::Sender<Option<Arc<LoadedPolicy>>>,
    view: Arc<watch::Sender<View>>,
}

impl Updates {
    /// Starts from the policy kept in the state directory, if there is a good one.
    pub(crate) fn new(
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

    /// The policy in use, as it changes.
    pub(crate) fn policies(&self) -> watch::Receiver<Option<Arc<LoadedPolicy>>> {
        self.policies.subscribe()
    }

    /// Takes announced policies as they come, and asks for the manifest whenever somebody appears
    /// who answers for it: an announcement made before this robot listened is not missed.
    pub(crate) async fn follow(
        self,
        key: keys::Key,
        announced: Subscriber<RingChannelHandler<Sample>>,
    ) {
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
