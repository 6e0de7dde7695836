//! A publisher's view of its fleet while it serves: the history, and metrics for others.

mod state;

use super::history::History;
use super::{Heard, PublishArgs, PublishError, Publisher, followed, refused, stored};
use reagent_core::wire::{Manifest, PolicyId, Release, Status, keys};
use reagent_link::certificate::{Certificate, Certificates};
use reagent_link::metrics::{Figures, Robot, Serving};
use reagent_link::routers::follow_routers;
use reagent_link::session::certificates;
use state::State;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use zenoh::Session;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};
use zenoh::session::TransportEventsListener;

/// How often robots are asked whether they are still there.
const ASK_INTERVAL: Duration = Duration::from_secs(10);

/// How often those that have gone are recorded.
const SETTLE_INTERVAL: Duration = Duration::from_secs(1);

/// Follows the robots of a publisher's fleet.
#[derive(Debug)]
pub(super) struct Witness {
    session: Session,
    fleet: String,
    public_key: [u8; 32],
    changes: Subscriber<FifoChannelHandler<Sample>>,
    /// Robots that come and go, if the router lets the trainer see it.
    alive: Subscriber<FifoChannelHandler<Sample>>,
    seen: Seen,
    _routers: TransportEventsListener<()>,
    _certificates: Arc<Certificates>,
    _serving: Option<Serving>,
}

#[derive(Clone, Debug)]
struct Seen(Arc<Mutex<State>>);

impl Seen {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().expect("no holder panics")
    }

    fn figures(&self, certificates: Vec<Certificate>) -> Figures {
        let robot = |(name, (status, online)): (&String, &(Status, bool))| Robot {
            name: name.clone(),
            status: *status,
            online: *online,
            duplicate: false,
        };
        let robots: Vec<_> = self.lock().robots.iter().map(robot).collect();
        Figures {
            wrong: self.lock().wrong(),
            robots,
            certificates,
        }
    }
}

impl Witness {
    /// Starts to follow the robots, and serves metrics if the arguments say so.
    pub(super) async fn start(
        publisher: &Publisher,
        args: &PublishArgs,
    ) -> Result<Witness, PublishError> {
        let history = args.history.as_deref().map(|path| {
            History::open(path).map_err(|error| PublishError::Record {
                path: path.into(),
                reason: error.to_string(),
            })
        });
        let seen = Seen(Arc::new(Mutex::new(State {
            newest: publisher.newest.clone(),
            in_fleet: Release::default(),
            announced: Release::default(),
            robots: BTreeMap::new(),
            history: history.transpose()?,
            routers: None,
            leaving: BTreeMap::new(),
            tells_takes: false,
        })));
        let certificates = Arc::new(certificates(&args.session)?);
        let (shown, held, counted) = (seen.clone(), certificates.clone(), seen.clone());
        let figures = move || shown.figures(held.read());
        let routers = follow_routers(&publisher.session, move |routers| {
            counted.lock().routers = Some(routers);
        });
        let fleet = publisher.fleet.clone();
        let alive = keys::all_alive(&fleet).map_err(refused(&fleet))?;
        let alive = publisher
            .session
            .liveliness()
            .declare_subscriber(alive.as_str());
        Ok(Witness {
            session: publisher.session.clone(),
            alive: alive.await?,
            fleet,
            public_key: publisher.key.verifying_key().to_bytes(),
            changes: publisher.follow_robots().await?,
            seen,
            _routers: routers.await?,
            _certificates: certificates,
            _serving: args.metrics.serve(figures).await?,
        })
    }

    /// Records what has been published.
    pub(super) fn published(&self, manifest: &Manifest) {
        if let Some(history) = &mut self.seen.lock().history {
            history.published(manifest, &self.public_key);
        }
    }

    /// Robots that ran this policy when they were last heard, whether they are there or not.
    pub(super) fn with_policy(&self, policy: PolicyId) -> Vec<String> {
        let seen = self.seen.lock();
        let robots = seen.robots.iter();
        let with = robots.filter(|(_, (status, _))| status.policy == Some(policy));
        with.map(|(robot, _)| robot.clone()).collect()
    }

    /// Records what robots report, without end.
    pub(super) async fn follow(&self) -> Result<Infallible, PublishError> {
        let mut asking = tokio::time::interval(ASK_INTERVAL);
        let mut settling = tokio::time::interval(SETTLE_INTERVAL);
        loop {
            tokio::select! {
                _ = settling.tick() => self.seen.lock().settle(Instant::now()),
                _ = asking.tick() => self.ask().await?,
                sample = self.changes.recv_async() => {
                    Heard::read(&sample?).iter().for_each(|heard| self.note(heard));
                }
                sample = self.alive.recv_async() => self.come_or_gone(&sample?),
            }
        }
    }

    /// Marks a robot that goes as offline at once; a robot that comes reports its status itself.
    fn come_or_gone(&self, sample: &Sample) {
        if sample.kind() == SampleKind::Delete
            && let Some(robot) = keys::robot_of(sample.key_expr().as_str())
        {
            self.seen.lock().leave(robot, Instant::now());
        }
    }

    /// Tells of robots that take the policy from now on.
    pub(super) fn tell_takes(&self) {
        self.seen.lock().tells_takes = true;
    }

    /// Asks all robots for their status and others for what they serve. A robot that does not answer is offline.
    pub(super) async fn ask(&self) -> Result<(), PublishError> {
        let manifests = keys::manifest(&self.fleet).map_err(refused(&self.fleet))?;
        let (there, served) = tokio::join!(
            followed::there(&self.session, &self.fleet),
            stored::announced(&self.session, &manifests)
        );
        let (there, served) = (there?, served?);
        let newest = served.iter().map(Manifest::release).max();
        newest
            .into_iter()
            .for_each(|newest| self.seen.lock().heard_of(newest));
        let known: Vec<_> = self.seen.lock().robots.keys().cloned().collect();
        let answered = |robot: &String| there.iter().any(|heard| heard.robot == *robot);
        for robot in known.iter().filter(|robot| !answered(robot)) {
            self.seen.lock().leave(robot, Instant::now());
        }
        there.iter().for_each(|heard| self.note(heard));
        if let Some(history) = &mut self.seen.lock().history {
            history.write();
        }
        Ok(())
    }

    /// Ends the history of a publisher that ends with an outcome.
    ///
    /// # Errors
    /// The outcome; `Record` if lines are lost.
    pub(super) fn end(&self, outcome: Result<(), PublishError>) -> Result<(), PublishError> {
        let history = &mut self.seen.lock().history;
        match (outcome, history.as_mut().map_or(Ok(()), History::end)) {
            (Err(failed), Err(lost)) => {
                tracing::error!("{lost}");
                Err(failed)
            }
            (outcome, written) => outcome.and(written),
        }
    }

    fn note(&self, heard: &Heard) {
        let mut seen = self.seen.lock();
        if let Some(told) = seen.note(heard) {
            reagent_link::print::stdout(format_args!("{told}\n"));
        }
        if let Some(history) = &mut seen.history {
            history.heard(heard);
        }
    }
}
