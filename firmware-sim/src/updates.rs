//! Following the fleet's policy: announcements in, verified policies out.

use crate::config::NodeConfig;
use crate::fetch::{Jitter, download};
use crate::later::Later;
use crate::policy::{LoadedPolicy, UpdateError, claimed, verified_manifest};
use crate::store::Store;
use crate::view::View;
use reagent_core::wire::{Manifest, PolicyId, WhyNot, keys};
use std::cmp::Reverse;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval};
use zenoh::Session;
use zenoh::handlers::RingChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::sample::Sample;

/// How often a robot checks that its state directory is still there.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);
/// How often it asks for manifests, since an announcement may have been lost.
const ASK_INTERVAL: Duration = Duration::from_secs(10);
/// Publishers answer within this time. The robot waits no longer for one that does not.
const ANSWER_TIME: Duration = Duration::from_secs(2);

/// Takes policies into use.
pub(crate) struct Updates {
    session: Session,
    config: NodeConfig,
    store: Store,
    jitter: Jitter,
    policies: watch::Sender<Option<Arc<LoadedPolicy>>>,
    view: Arc<watch::Sender<View>>,
    /// The announcement that was refused last, and why.
    refused: Option<(Vec<u8>, WhyNot)>,
    /// The manifests that answered the last query.
    answers: Vec<Vec<u8>>,
    /// Those that were refused for a reason that can pass.
    later: Later,
}

impl Updates {
    /// Starts with the policy in flash, if there is a good one.
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
            refused: None,
            answers: Vec::new(),
            later: Later::default(),
        };
        match updates.store.boot(&updates.config.trust).await {
            Ok(Some(kept)) => updates.swap(kept),
            Ok(None) => {}
            Err(error) => updates.refuse(None, error),
        }
        Ok(updates)
    }

    /// The policy in use, as it changes.
    pub(crate) fn policies(&self) -> watch::Receiver<Option<Arc<LoadedPolicy>>> {
        self.policies.subscribe()
    }

    /// Takes announced policies as they come. Also asks for manifests whenever a publisher appears, and from time to time, so that
    /// an announcement that this robot did not hear is not missed.
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
        let (mut looking, mut asking) = (interval(LOOK_INTERVAL), interval(ASK_INTERVAL));
        asking.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = looking.tick() => self.look_for_state(),
                _ = asking.tick() => self.ask(key).await?,
                sample = announced.recv_async() => {
                    self.consider(&sample?.payload().to_bytes()).await;
                }
                matching = publisher_there.recv_async() => {
                    self.answers.clear();
                    self.later = Later::default();
                    if matching?.matching() {
                        self.ask(key).await?;
                    }
                }
            }
        }
    }

    /// Reports once that the state directory is gone.
    fn look_for_state(&self) {
        let lost = self.store.check_in_place().err();
        self.view.send_if_modified(|view| {
            let news = lost.as_ref().filter(|_| !view.state_lost);
            if let Some(error) = news {
                tracing::error!("{error}");
                view.state_lost = true;
            }
            news.is_some()
        });
    }

    /// Asks all publishers for their manifests, and takes the newest policy that it can accept.
    async fn ask(&mut self, key: &keys::Key) -> zenoh::Result<()> {
        let asked = self.session.get(key.as_str()).target(QueryTarget::All);
        let asked = asked.consolidation(ConsolidationMode::None);
        let replies = asked.timeout(ANSWER_TIME).await?;
        let mut answers = Vec::new();
        while let Ok(reply) = replies.recv_async().await {
            let frame = reply.result().map(|sample| sample.payload().to_bytes());
            answers.extend(frame.map(|frame| frame.into_owned()));
        }
        answers.sort_by_cached_key(|frame| {
            let policy = claimed(frame);
            Reverse((policy.release(), policy.sha256))
        });
        answers.dedup();
        // Earlier answers have been considered already.
        let before = std::mem::replace(&mut self.answers, answers.clone());
        let again = self.later.due(Instant::now());
        let is_due = |frame: &&Vec<u8>| !before.contains(frame) || again.contains(frame);
        for frame in answers.iter().filter(is_due) {
            if self.consider(frame).await {
                break;
            }
        }
        Ok(())
    }

    /// Takes the announced policy if it is trusted, newer and whole. Returns whether it is in use then.
    async fn consider(&mut self, signed_manifest: &[u8]) -> bool {
        match self.update(signed_manifest).await {
            Ok(taken) => {
                if let Some(policy) = taken {
                    self.refused = None;
                    self.later = Later::default();
                    self.swap(policy);
                }
                true
            }
            // A policy that is both announced and asked for is refused only once.
            Err(error) => {
                if error.can_pass() {
                    self.later.put_off(signed_manifest, Instant::now());
                }
                let now = Some((signed_manifest.to_vec(), error.why()));
                if self.refused != now {
                    self.refused = now;
                    self.refuse(Some(claimed(signed_manifest)), error);
                }
                false
            }
        }
    }

    /// Decides whether the announced policy is taken: its signature is trusted, it is newer than every policy that was in use but
    /// not far ahead of them, and the roll-out has reached this robot. Then it is fetched and put into use ([`Store::take`]).
    /// `None` if it is in use already.
    async fn update(
        &mut self,
        signed_manifest: &[u8],
    ) -> Result<Option<LoadedPolicy>, UpdateError> {
        let trust = &self.config.trust;
        let manifest = verified_manifest(signed_manifest, trust)?;
        let in_use = self.view.borrow().policy.clone();
        if in_use.as_ref().map(Manifest::id) == Some(manifest.id()) {
            return Ok(None);
        }
        let (given, floor) = (manifest.release(), self.store.floor());
        // If two policies have the same version, the hash decides, so that all robots end with the same one. A robot whose policy
        // was damaged in flash takes the same version again.
        let order = |m: &Manifest| (m.release(), m.sha256);
        let last = in_use.as_ref().map_or(floor, |m| m.release().max(floor));
        if given < floor || in_use.is_some_and(|in_use| order(&manifest) <= order(&in_use)) {
            return Err(UpdateError::NotNewer { given, last });
        }
        if given.is_far_ahead_of(floor) {
            return Err(UpdateError::FarAhead { given, last });
        }
        if !manifest.reaches(&self.config.robot) {
            return Err(UpdateError::NotYet(given));
        }
        self.store.check_in_place()?;
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
        self.store.take(&manifest, trust).await.map(Some)
    }

    fn swap(&self, policy: LoadedPolicy) {
        let manifest = policy.manifest().clone();
        let (name, release) = (&manifest.name, manifest.release());
        let robot = &self.config.robot;
        tracing::info!(%robot, version = %release, "policy {name:?} version {release} verified and in use");
        self.policies.send_replace(Some(Arc::new(policy)));
        self.view.send_modify(|view| view.use_policy(manifest));
    }

    /// Reports a policy that was not taken: an announced one, or the one in flash.
    fn refuse(&self, policy: Option<PolicyId>, error: UpdateError) {
        let robot = &self.config.robot;
        match &error {
            UpdateError::Kept { .. } => tracing::error!(%robot, "{error}"),
            // Two publishers with different policies are no fault of the robot.
            UpdateError::NotNewer { .. } | UpdateError::NotYet(_) => {
                tracing::info!(%robot, "policy not taken: {error}")
            }
            _ => tracing::warn!(%robot, "policy not taken: {error}"),
        }
        self.view
            .send_modify(|view| view.refuse_policy(policy, error));
    }
}
