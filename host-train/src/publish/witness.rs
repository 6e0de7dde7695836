//! What a publisher sees of its fleet while it serves: the history, and figures for others.

use super::history::History;
use super::{Heard, PublishArgs, PublishError, Publisher, robots};
use reagent_core::wire::{Manifest, Status};
use reagent_link::certificate::Certificate;
use reagent_link::metrics::{Figures, Robot, Serving};
use reagent_link::session::certificates;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use zenoh::Session;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

/// How often robots are asked whether they are there still.
const ASK_INTERVAL: Duration = Duration::from_secs(10);

/// Follows the robots of a publisher's fleet.
#[derive(Debug)]
pub(super) struct Witness {
    session: Session,
    fleet: String,
    public_key: [u8; 32],
    changes: Subscriber<FifoChannelHandler<Sample>>,
    seen: Seen,
    _serving: Option<Serving>,
}

#[derive(Clone, Debug)]
struct Seen(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    /// Robots as heard last, and whether they answered when they were asked last.
    robots: BTreeMap<String, (Status, bool)>,
    history: Option<History>,
}

impl Seen {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().expect("no holder panics")
    }

    fn figures(&self, certificates: &[Certificate]) -> Figures {
        let robot = |(name, (status, online)): (&String, &(Status, bool))| Robot {
            name: name.clone(),
            status: *status,
            online: *online,
            duplicate: false,
        };
        let robots: Vec<_> = self.lock().robots.iter().map(robot).collect();
        let away = robots.iter().filter(|robot| !robot.online);
        let away: Vec<_> = away.map(|robot| robot.name.as_str()).collect();
        let wrong = (!away.is_empty()).then(|| format!("offline: {}", away.join(", ")));
        Figures {
            robots,
            certificates: certificates.to_vec(),
            wrong,
        }
    }
}

impl Witness {
    /// Hears what robots say from here on, and shows it where the arguments say so.
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
            robots: BTreeMap::new(),
            history: history.transpose()?,
        })));
        let (shown, certificates) = (seen.clone(), certificates(&args.session)?);
        let figures = move || shown.figures(&certificates);
        Ok(Witness {
            session: publisher.session.clone(),
            fleet: publisher.fleet.clone(),
            public_key: publisher.key.verifying_key().to_bytes(),
            changes: publisher.follow_robots().await?,
            seen,
            _serving: args.metrics.serve(figures).await?,
        })
    }

    /// Notes what has been published.
    pub(super) fn published(&self, manifest: &Manifest) {
        if let Some(history) = &mut self.seen.lock().history {
            told(history.published(manifest, &self.public_key));
        }
    }

    /// Notes what robots say, without end.
    pub(super) async fn follow(&self) -> Result<Infallible, PublishError> {
        let mut asking = tokio::time::interval(ASK_INTERVAL);
        loop {
            tokio::select! {
                _ = asking.tick() => self.ask().await?,
                sample = self.changes.recv_async() => {
                    Heard::read(&sample?).iter().for_each(|heard| self.note(heard));
                }
            }
        }
    }

    /// Asks all robots how they are: who does not answer is away.
    pub(super) async fn ask(&self) -> Result<(), PublishError> {
        let there = robots::there(&self.session, &self.fleet).await?;
        for (_, online) in self.seen.lock().robots.values_mut() {
            *online = false;
        }
        there.iter().for_each(|heard| self.note(heard));
        Ok(())
    }

    fn note(&self, heard: &Heard) {
        let mut seen = self.seen.lock();
        seen.robots
            .insert(heard.robot.clone(), (heard.status, true));
        if let Some(history) = &mut seen.history {
            told(history.heard(heard));
        }
    }
}

/// A history that cannot be written is no reason to stop serving.
fn told(written: std::io::Result<()>) {
    if let Err(error) = written {
        tracing::error!("the history cannot be written: {error}");
    }
}
