//! A client that stays connected: robots know whether it is there, and it knows how busy the robots are.

mod asked;

use super::robots::{Heard, Robots, Tried};
use super::{RefineError, STATUS_TIME, read_status, refine_from};
use crate::identity::number_of;
use asked::Asked;
use reagent_core::wire::{Cancel, Reason, RefineReply, RefineRequest, keys};
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::sync::{OnceCell, watch};
use tokio::time::{Instant, timeout_at};
use zenoh::Session;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::{Querier, QueryTarget};
use zenoh::sample::{SampleKind, SourceInfo};

/// Asks the robots of one fleet. A request whose future is dropped is taken back. If the client or its link is gone, all its
/// requests are, so that they block no robot's queue.
#[derive(Debug)]
pub struct Client {
    session: Session,
    fleet: String,
    /// The number by which robots see whether its session is there.
    number: u64,
    /// Asks robots for their status. Its identity also marks the session's requests.
    statuses: Querier<'static>,
    robots: Arc<Robots>,
    following: OnceCell<[Subscriber<()>; 2]>,
    _alive: LivelinessToken,
}

impl Client {
    /// A client of a fleet, on an open session of its own, by which robots know its requests.
    ///
    /// # Errors
    /// `Request` for a bad fleet name, `Zenoh`.
    pub async fn new(session: Session, fleet: &str) -> Result<Client, RefineError> {
        let number = number_of(session.zid());
        let named = |key: Result<keys::Key, _>| key.map_err(RefineError::Request);
        let key = named(keys::client_alive(fleet, number))?;
        let alive = session.liveliness().declare_token(key.as_str()).await?;
        let key = named(keys::all_status(fleet))?;
        let statuses = session.declare_querier(key.as_str().to_owned());
        let statuses = statuses.target(QueryTarget::All).timeout(STATUS_TIME);
        Ok(Client {
            statuses: statuses.await?,
            session,
            fleet: fleet.into(),
            number,
            robots: Arc::default(),
            following: OnceCell::new(),
            _alive: alive,
        })
    }

    /// The sender of the requests.
    fn source(&self) -> SourceInfo {
        SourceInfo::new(self.statuses.id(), 0)
    }

    /// The session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Sends a request to a robot and waits for its pose. If the robot is not there, or its link is lost before it answers, it is
    /// asked again as soon as it is there again, within the request's time.
    ///
    /// # Errors
    /// As [`super::refine`]; `NoRobot` once the request's time has passed.
    pub async fn refine(
        &self,
        robot: &str,
        request: &RefineRequest<'_>,
    ) -> Result<RefineReply, RefineError> {
        let started = Instant::now();
        let until = started + budget(request);
        loop {
            let heard = self.robots.times_heard(robot);
            let answer = self.ask(robot, &within(request, until)).await;
            let Err(RefineError::NoRobot { key, .. }) = answer else {
                return answer;
            };
            let back = async {
                self.follow_robots().await?;
                let is_back = |(): &()| self.robots.is_back(robot, heard);
                // The client holds the sender.
                self.changes().wait_for(is_back).await.ok();
                Ok::<_, RefineError>(())
            };
            match timeout_at(until, back).await {
                Ok(back) => back?,
                Err(_) => {
                    let waited = started.elapsed();
                    return Err(RefineError::NoRobot { key, waited });
                }
            }
        }
    }

    /// Sends a request to a robot once.
    async fn ask(
        &self,
        robot: &str,
        request: &RefineRequest<'_>,
    ) -> Result<RefineReply, RefineError> {
        let request = RefineRequest {
            client: self.number,
            ..*request
        };
        let mut asked = Asked::new(self, robot, Cancel::of(&request));
        let source = Some(self.source());
        let answer = refine_from(&self.session, source, &self.fleet, robot, &request).await;
        asked.answered = true;
        answer
    }

    /// Sends a request to the robot with the least to do. If that robot is busy, gone, without a policy or without memory for the
    /// mode, the next one is asked, within the request's time. If no robot is there, waits for one as long.
    ///
    /// # Errors
    /// As [`super::refine`]; a refusal if robots are there and all refuse; `NoRobot` once the request's time has passed.
    pub async fn refine_any(
        &self,
        request: &RefineRequest<'_>,
    ) -> Result<(String, RefineReply), RefineError> {
        let started = Instant::now();
        let until = started + budget(request);
        self.follow_robots().await?;
        let (mut tried, mut refusal) = (Vec::<Tried>::new(), None);
        loop {
            let all_refused = refusal.is_some() && tried.iter().all(Tried::refused);
            let wait_until = if all_refused { started } else { until };
            let Some(robot) = self.next(&tried, wait_until).await else {
                break;
            };
            if !tried.is_empty() && Instant::now() >= until {
                break;
            }
            let heard = self.robots.times_heard(&robot);
            let heard = match self.ask(&robot, &within(request, until)).await {
                Ok(reply) => return Ok((robot, reply)),
                Err(RefineError::NoRobot { .. }) => Some(heard),
                Err(error) if passed_over(&error) => {
                    refusal = Some(error);
                    None
                }
                Err(error) => {
                    if matches!(error, RefineError::Deadline { .. }) {
                        self.robots.silent(&robot);
                    }
                    return Err(error);
                }
            };
            tried.retain(|tried| tried.robot != robot);
            tried.push(Tried { robot, heard });
        }
        let key = keys::all_status(&self.fleet).map_err(RefineError::Request)?;
        Err(refusal.unwrap_or_else(|| RefineError::NoRobot {
            key: key.to_string(),
            waited: started.elapsed(),
        }))
    }

    /// The robot to ask next, if one is there before a time.
    async fn next(&self, tried: &[Tried], until: Instant) -> Option<String> {
        let mut next = None;
        let mut changes = self.changes();
        let found = changes.wait_for(|()| {
            next = self.robots.least(tried);
            next.is_some()
        });
        // Looks at least once, however late it is.
        timeout_at(until, found).await.ok()?.ok()?;
        next
    }

    /// Asks every robot for its status and follows its changes from here on. [`Client::refine_any`] does this, too.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn follow_robots(&self) -> Result<(), RefineError> {
        let following = self.following.get_or_try_init(|| self.follow()).await;
        following.map(|_| ())
    }

    /// Changes whenever a robot is heard or goes away.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.robots.changes.subscribe()
    }

    /// The robots that are or were there, sorted by name; none before [`Client::follow_robots`].
    pub fn heard(&self) -> Vec<Heard> {
        self.robots.all()
    }

    /// How long a robot has been away; `None` if it is there.
    pub fn away(&self, robot: &str) -> Option<Duration> {
        self.robots.away(robot)
    }

    /// Whether a robot has been heard.
    pub fn has_heard(&self, robot: &str) -> bool {
        self.robots.times_heard(robot) > 0
    }

    /// Asks every robot for its status and subscribes to every change from here on.
    async fn follow(&self) -> Result<[Subscriber<()>; 2], RefineError> {
        let named = |key: Result<keys::Key, _>| key.map_err(RefineError::Request);
        let status_key = named(keys::all_status(&self.fleet))?;
        let robots = self.robots.clone();
        let status = self
            .session
            .declare_subscriber(status_key.as_str())
            .callback(move |sample| {
                if let Some((robot, status)) = read_status(&sample) {
                    robots.heard(robot, status);
                }
            })
            .await?;
        let alive_key = named(keys::all_alive(&self.fleet))?;
        let (robots, session, fleet) = (
            self.robots.clone(),
            self.session.clone(),
            self.fleet.clone(),
        );
        let runtime = Handle::current();
        let alive = self
            .session
            .liveliness()
            .declare_subscriber(alive_key.as_str())
            .history(true)
            .callback(move |sample| {
                let Some(robot) = keys::robot_of(sample.key_expr().as_str()) else {
                    return;
                };
                if sample.kind() == SampleKind::Delete {
                    return robots.gone(robot);
                }
                // If only a router was away, the robot may publish nothing for a long time. So ask it.
                let ask = ask_status(session.clone(), fleet.clone(), robot.into(), robots.clone());
                runtime.spawn(ask);
            })
            .await?;
        self.ask_for_statuses().await?;
        Ok([status, alive])
    }

    /// Asks every robot for its status once more, since what they publish comes a moment late.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn ask_for_statuses(&self) -> Result<(), RefineError> {
        let robots = self.robots.lock().clone();
        let replies = self.statuses.get().await?;
        while let Ok(reply) = replies.recv_async().await {
            if let Some((robot, status)) = reply.result().ok().and_then(read_status) {
                let before = robots.get(robot).map_or(0, |known| known.departures);
                self.robots.answered(robot, status, before);
            }
        }
        Ok(())
    }
}

/// Asks one robot for its status.
async fn ask_status(session: Session, fleet: String, robot: String, robots: Arc<Robots>) {
    let Ok(key) = keys::status(&fleet, &robot) else {
        return;
    };
    let before = robots.departures(&robot);
    let asked = session.get(key.as_str()).timeout(STATUS_TIME).await;
    let Ok(replies) = asked else { return };
    while let Ok(reply) = replies.recv_async().await {
        if let Some((robot, status)) = reply.result().ok().and_then(read_status) {
            robots.answered(robot, status, before);
        }
    }
}

/// A request's own time.
fn budget(request: &RefineRequest<'_>) -> Duration {
    Duration::from_millis(request.budget_ms.into())
}

/// A request with the time that is left.
fn within<'a>(request: &RefineRequest<'a>, until: Instant) -> RefineRequest<'a> {
    let left = until.saturating_duration_since(Instant::now());
    RefineRequest {
        // Rounded up, so that the first robot is given all of it.
        budget_ms: u32::try_from(left.as_micros().div_ceil(1000)).unwrap_or(u32::MAX),
        ..*request
    }
}

/// Whether another robot may do better.
fn passed_over(error: &RefineError) -> bool {
    match error {
        RefineError::Refused { refusal, .. } => {
            matches!(
                refusal.reason,
                Reason::Busy
                    | Reason::NoPolicy
                    | Reason::PolicyDamaged
                    | Reason::FailedSelfTest
                    | Reason::Internal
                    | Reason::NoSuchMode(_)
                    | Reason::TooManyPoints(..)
                    | Reason::WrongVersion { .. }
            )
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::wire::{Cloud, Refusal};

    #[test]
    fn what_is_wrong_with_one_robot_does_not_end_the_search_for_another() {
        let refused = |reason| RefineError::Refused {
            robot: "arm1".into(),
            refusal: Refusal { id: 1, reason },
        };
        for of_the_robot in [
            Reason::PolicyDamaged,
            Reason::FailedSelfTest,
            Reason::TooManyPoints(Cloud::Source, 4096),
            Reason::WrongVersion { spoken: 8 },
        ] {
            assert!(passed_over(&refused(of_the_robot)), "{of_the_robot:?}");
        }
        for of_the_request in [Reason::Malformed, Reason::BadPose, Reason::Deadline] {
            assert!(!passed_over(&refused(of_the_request)), "{of_the_request:?}");
        }
    }
}
