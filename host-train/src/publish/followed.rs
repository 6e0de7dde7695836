//! The robots of a fleet as they report themselves. What they report while this session has no router is lost, so they are
//! also asked, again and again.

use super::{Heard, PublishError, refused};
use reagent_core::wire::{Status, keys};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{Instant, Interval, MissedTickBehavior, interval_at};
use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::query::{ConsolidationMode, QueryTarget};

/// Time within which online robots report their status.
const ANSWER_TIME: Duration = Duration::from_secs(2);
/// How often robots are asked for their status.
const ASK_INTERVAL: Duration = Duration::from_secs(2);
/// A robot that leaves more questions in a row than these unanswered has left, or is cut off. Where a router restarts, robots
/// are back sooner.
const UNANSWERED: u32 = 5;

/// The online robots of a fleet, ordered by name.
pub(super) async fn there(session: &Session, fleet: &str) -> Result<Vec<Heard>, PublishError> {
    let key = keys::all_status(fleet).map_err(refused(fleet))?;
    let asked = session.get(key.as_str()).target(QueryTarget::All);
    let replies = asked.timeout(ANSWER_TIME).await?;
    let mut robots = Vec::new();
    while let Ok(reply) = replies.recv_async().await {
        robots.extend(reply.result().ok().and_then(Heard::read));
    }
    robots.sort_by(|a, b| a.robot.cmp(&b.robot));
    Ok(robots)
}

/// What is known of a fleet's robots, as it changes.
pub(super) struct Followed {
    session: Session,
    status: keys::Key,
    /// The last status of each robot.
    pub(super) robots: BTreeMap<String, Status>,
    /// Questions that each robot has left unanswered since it was heard last.
    unanswered: BTreeMap<String, u32>,
    /// Whether this session has ever had a router. One without has none to lose.
    has_had_router: bool,
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
            unanswered: known.keys().map(|robot| (robot.clone(), 0)).collect(),
            robots: known,
            has_had_router: false,
            asking,
            reports,
            reporting,
            _published: published,
        };
        followed.is_linked().await;
        let there = there(session, fleet).await?;
        there.into_iter().for_each(|heard| followed.note(heard));
        Ok(followed)
    }

    /// Waits until robots have reported, or may have left.
    pub(super) async fn changed(&mut self) -> Result<(), PublishError> {
        tokio::select! {
            _ = self.asking.tick() => self.ask().await?,
            Some(heard) = self.reports.recv() => {
                self.note(heard);
                while let Ok(heard) = self.reports.try_recv() {
                    self.note(heard);
                }
            }
        }
        Ok(())
    }

    /// Whether a robot that was there is there no longer.
    pub(super) fn has_left(&self, robot: &str) -> bool {
        self.unanswered
            .get(robot)
            .is_some_and(|&questions| questions > UNANSWERED)
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
        self.unanswered.insert(heard.robot.clone(), 0);
        self.robots.insert(heard.robot, heard.status);
    }

    /// Asks all robots. Answers count as they come: one that waited for the last robot would be older than what its robot
    /// has published since.
    async fn ask(&mut self) -> Result<(), PublishError> {
        // Without a router, that nobody answers tells nothing.
        if self.is_linked().await {
            self.unanswered
                .values_mut()
                .for_each(|questions| *questions += 1);
        }
        let answered = self.reporting.clone();
        let asked = self.session.get(self.status.as_str());
        let asked = asked.target(QueryTarget::All).timeout(ASK_INTERVAL);
        let asked = asked.consolidation(ConsolidationMode::None);
        asked
            .callback(move |reply| report(&answered, reply.result().ok().and_then(Heard::read)))
            .await?;
        Ok(())
    }

    async fn is_linked(&mut self) -> bool {
        let has_router = self.session.info().routers_zid().await.next().is_some();
        self.has_had_router |= has_router;
        has_router || !self.has_had_router
    }
}

fn report(reporting: &UnboundedSender<Heard>, heard: Option<Heard>) {
    // Once nobody follows any more, it is not received.
    heard
        .into_iter()
        .for_each(|heard| drop(reporting.send(heard)));
}
