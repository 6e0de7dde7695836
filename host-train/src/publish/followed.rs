//! The robots of a fleet as they report themselves. What they report while this session has no router is lost, so they are
//! also asked, again and again.

use super::robots::{Heard, there};
use super::{PublishError, refused};
use reagent_core::wire::{Status, keys};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{Instant, Interval, MissedTickBehavior, interval_at};
use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::query::{ConsolidationMode, QueryTarget};

/// How often robots are asked for their status.
const ASK_INTERVAL: Duration = Duration::from_secs(2);

/// What is known of a fleet's robots, as it changes.
pub(super) struct Followed {
    session: Session,
    status: keys::Key,
    /// The last status of each robot.
    pub(super) robots: BTreeMap<String, Status>,
    asking: Interval,
    reports: UnboundedReceiver<Heard>,
    reporting: UnboundedSender<Heard>,
    _published: Subscriber<()>,
}

impl Followed {
    /// Begins with robots that are known already, and with those that answer now.
    pub(super) async fn begin(
        session: &Session,
        fleet: &str,
        known: BTreeMap<String, Status>,
    ) -> Result<Followed, PublishError> {
        let status = keys::all_status(fleet).map_err(refused(fleet))?;
        let (reporting, reports) = unbounded_channel();
        let published = reporting.clone();
        let published = session
            .declare_subscriber(status.as_str())
            .callback(move |sample| report(&published, Heard::read(&sample)))
            .await?;
        let mut asking = interval_at(Instant::now() + ASK_INTERVAL, ASK_INTERVAL);
        asking.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut followed = Followed {
            session: session.clone(),
            status,
            robots: known,
            asking,
            reports,
            reporting,
            _published: published,
        };
        let there = there(session, fleet).await?;
        there.into_iter().for_each(|heard| followed.note(heard));
        Ok(followed)
    }

    /// Waits until robots have reported.
    pub(super) async fn changed(&mut self) -> Result<(), PublishError> {
        loop {
            tokio::select! {
                _ = self.asking.tick() => self.ask().await?,
                Some(heard) = self.reports.recv() => {
                    self.note(heard);
                    while let Ok(heard) = self.reports.try_recv() {
                        self.note(heard);
                    }
                    return Ok(());
                }
            }
        }
    }

    /// The robots, ordered by name.
    pub(super) fn heard(&self) -> Vec<Heard> {
        let heard = |(robot, status): (&String, &Status)| Heard {
            robot: robot.clone(),
            status: *status,
        };
        self.robots.iter().map(heard).collect()
    }

    fn note(&mut self, heard: Heard) {
        self.robots.insert(heard.robot, heard.status);
    }

    /// Asks all robots. Answers count as they come: one that waited for the last robot would be older than what its robot
    /// has published since.
    async fn ask(&mut self) -> Result<(), PublishError> {
        let answered = self.reporting.clone();
        let asked = self.session.get(self.status.as_str());
        let asked = asked.target(QueryTarget::All).timeout(ASK_INTERVAL);
        let asked = asked.consolidation(ConsolidationMode::None);
        asked
            .callback(move |reply| report(&answered, reply.result().ok().and_then(Heard::read)))
            .await?;
        Ok(())
    }
}

fn report(reporting: &UnboundedSender<Heard>, heard: Option<Heard>) {
    // Once nobody follows any more, it is not received.
    heard
        .into_iter()
        .for_each(|heard| drop(reporting.send(heard)));
}
