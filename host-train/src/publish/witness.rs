//! A publisher's view of its fleet while it serves: the history, and metrics for others.

use super::history::History;
use super::{Heard, Newest, PublishArgs, PublishError, Publisher, followed, refused, stored};
use reagent_core::wire::{Manifest, PolicyId, Release, Status, keys};
use reagent_link::certificate::{Certificate, Certificates};
use reagent_link::metrics::{Figures, Robot, Serving};
use reagent_link::routers::follow_routers;
use reagent_link::session::certificates;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use zenoh::Session;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};
use zenoh::session::TransportEventsListener;

/// How often robots are asked whether they are still there.
const ASK_INTERVAL: Duration = Duration::from_secs(10);

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

#[derive(Debug)]
struct State {
    /// The policy that is served here.
    newest: Newest,
    /// The newest release that a robot runs.
    in_fleet: Release,
    /// The newest release that anybody announces.
    announced: Release,
    /// Each robot's last status, and whether it is online.
    robots: BTreeMap<String, (Status, bool)>,
    history: Option<History>,
    /// Routers that the publisher is connected to; `None` before the first one.
    routers: Option<usize>,
}

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

impl State {
    /// What is wrong with the fleet or here, if anything is.
    fn wrong(&self) -> Option<String> {
        let history = self.history.as_ref().and_then(History::wrong);
        let wrong: Vec<_> = self.fleet_wrong().into_iter().chain(history).collect();
        (!wrong.is_empty()).then(|| wrong.join("; "))
    }

    fn fleet_wrong(&self) -> Option<String> {
        // Nothing is known of the robots then.
        if self.routers == Some(0) {
            return Some("no router".into());
        }
        let named = |is_wrong: &dyn Fn(&String, &Status, bool) -> bool| {
            let wrong = self.robots.iter();
            let wrong = wrong.filter(|(name, (status, online))| is_wrong(name, status, *online));
            wrong.map(|(name, _)| name.as_str()).collect::<Vec<_>>()
        };
        let mut wrong = vec![("offline".into(), named(&|_, _, online| !online))];
        if let Some((newest, _)) = &*self.newest.lock().expect("no holder panics") {
            let (id, served) = (Some(newest.id()), newest.release());
            let others = named(&|name, status, online| {
                online && status.policy != id && newest.reaches(name)
            });
            wrong.push((format!("without version {served}"), others));
            if self.in_fleet > served {
                let newer = format!("newer than version {served}, which is served here");
                let what = format!("version {} is in the fleet", self.in_fleet);
                return Some(format!("{what}, {newer}"));
            }
        }
        let wrong = wrong.iter().filter(|(_, robots)| !robots.is_empty());
        let wrong: Vec<_> = wrong
            .map(|(what, robots)| format!("{what}: {}", robots.join(", ")))
            .collect();
        (!wrong.is_empty()).then(|| wrong.join("; "))
    }

    /// Warns once about a release that robots run and that is newer than the one served here.
    fn found(&mut self, release: Release) {
        if release <= self.in_fleet {
            return;
        }
        self.in_fleet = release;
        if let Some(served) = self.served_before(release) {
            tracing::warn!(
                "version {release} is in the fleet, newer than version {served}, which is served here: robots take \
                 that one, and this publisher may end"
            );
        }
    }

    /// Warns once about a release that is announced and that is newer than the one served here. No robot may trust its key.
    fn heard_of(&mut self, release: Release) {
        if release <= self.announced.max(self.in_fleet) {
            return;
        }
        self.announced = release;
        if let Some(served) = self.served_before(release) {
            tracing::warn!(
                "somebody announces version {release}, newer than version {served}, which is served here: robots \
                 that trust its key take that one"
            );
        }
    }

    /// The release that is served here, if it is older.
    fn served_before(&self, release: Release) -> Option<Release> {
        let newest = self.newest.lock().expect("no holder panics");
        let served = newest.as_ref().map(|(newest, _)| newest.release());
        served.filter(|&served| served < release)
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
        loop {
            tokio::select! {
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
            && let Some((_, online)) = self.seen.lock().robots.get_mut(robot)
        {
            *online = false;
        }
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
        for (_, online) in self.seen.lock().robots.values_mut() {
            *online = false;
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
        seen.robots
            .insert(heard.robot.clone(), (heard.status, true));
        if let Some(policy) = &heard.status.policy {
            seen.found(policy.release());
        }
        if let Some(history) = &mut seen.history {
            history.heard(heard);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::WeightFile;
    use crate::publish::manifest;

    #[test]
    fn a_fleet_is_well_where_all_have_what_is_served_and_nobody_anything_newer() {
        let file = WeightFile::pretrained();
        let manifest = |version| manifest(version, "policy", &file).expect("a good policy");
        let mut state = State {
            newest: Newest::default(),
            in_fleet: Release::default(),
            announced: Release::default(),
            robots: BTreeMap::new(),
            history: None,
            routers: None,
        };
        let serve = |state: &State, manifest: Manifest| {
            *state.newest.lock().expect("no holder panics") = Some((manifest, Vec::new()));
        };
        let runs = |state: &mut State, robot: &str, version: u64| {
            let policy = manifest(version).id();
            let status = Status {
                policy: Some(policy),
                ..Status::default()
            };
            state.found(policy.release());
            state.robots.insert(robot.into(), (status, true));
        };
        runs(&mut state, "a", 10);
        runs(&mut state, "b", 10);
        assert_eq!(state.wrong(), None);
        serve(&state, manifest(11));
        runs(&mut state, "b", 11);
        assert_eq!(state.wrong().as_deref(), Some("without version 11: a"));
        state.robots.get_mut("b").expect("it was heard").1 = false;
        let both = "offline: b; without version 11: a";
        assert_eq!(state.wrong().as_deref(), Some(both));
        // Without a router nothing is known of the robots.
        state.routers = Some(1);
        assert_eq!(state.wrong().as_deref(), Some(both));
        state.routers = Some(0);
        assert_eq!(state.wrong().as_deref(), Some("no router"));
        state.routers = Some(1);
        runs(&mut state, "b", 11);
        // This one goes to other robots first.
        serve(
            &state,
            Manifest {
                reach: 0,
                ..manifest(11)
            },
        );
        assert_eq!(state.wrong(), None);
        serve(&state, manifest(11));
        state.robots.clear();
        runs(&mut state, "b", 11);
        // Nobody runs it: robots may not trust its key.
        state.heard_of(manifest(12).release());
        assert_eq!(state.wrong(), None);
        runs(&mut state, "a", 12);
        let newer = "version 12 is in the fleet, newer than version 11, which is served here";
        assert_eq!(state.wrong().as_deref(), Some(newer));
    }
}
