//! A client that stays: robots know whether it is there, and it knows what robots have to do.

use super::{RefineError, read_status, refine};
use crate::service::small_frame;
use reagent_core::wire::{Cancel, Message, Reason, RefineReply, RefineRequest, Status, keys};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use tokio::sync::OnceCell;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// Asks the robots of one fleet. A request whose future is dropped is taken back, and so are all of them when
/// the client or its link is gone: they hold no robot's queue.
#[derive(Debug)]
pub struct Client {
    session: Session,
    fleet: String,
    number: u64,
    robots: Arc<Robots>,
    following: OnceCell<[Subscriber<()>; 2]>,
    _alive: LivelinessToken,
}

/// What is known of the fleet's robots.
#[derive(Debug, Default)]
struct Robots(Mutex<BTreeMap<String, Robot>>);

/// A robot that was heard.
#[derive(Clone, Debug)]
pub struct Heard {
    /// Its name.
    pub robot: String,
    /// Its status as heard last.
    pub status: Status,
    /// Two speak under this name in turns.
    pub duplicate: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Robot {
    /// As heard last; none of a robot that was asked without having been heard.
    status: Option<Status>,
    /// Who spoke under this name before whoever speaks now.
    former: Option<u32>,
    duplicate: bool,
    /// Requests of this client that it has not answered.
    asked: u16,
}

impl Robots {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Robot>> {
        self.0.lock().expect("no holder panics")
    }

    fn heard(&self, robot: &str, status: Status) {
        let mut robots = self.lock();
        let known = robots.entry(robot.into()).or_default();
        if let Some(last) = known.status.replace(status)
            && last.instance != status.instance
        {
            // A restart is heard once; of two robots the first speaks again.
            known.duplicate |= known.former == Some(status.instance);
            known.former = Some(last.instance);
        }
    }

    /// The robot with a policy that has the least to do, and of those the one that has served least, but for
    /// some. What it has of this client's may not be in its status yet.
    fn least(&self, but: &[String]) -> Option<String> {
        let load = |robot: &Robot| {
            let status = robot.status?;
            let in_hand = status.in_hand.max(robot.asked);
            Some((status.policy.is_none(), in_hand, status.served))
        };
        let robots = self.lock();
        let eligible = robots.iter().filter(|(name, _)| !but.contains(name));
        let loads = eligible.filter_map(|(name, robot)| Some((load(robot)?, name)));
        loads.min().map(|(_, name)| name.clone())
    }
}

impl Client {
    /// A client of a fleet, on an open session.
    ///
    /// # Errors
    /// `Request` for a bad fleet name, `Zenoh`.
    pub async fn new(session: Session, fleet: &str) -> Result<Client, RefineError> {
        let [a, b, c, d, e, f, g, h, ..] = session.zid().to_le_bytes();
        let number = u64::from_le_bytes([a, b, c, d, e, f, g, h]).max(1);
        let key = keys::client_alive(fleet, number).map_err(RefineError::Request)?;
        let alive = session.liveliness().declare_token(key.as_str()).await?;
        Ok(Client {
            session,
            fleet: fleet.into(),
            number,
            robots: Arc::default(),
            following: OnceCell::new(),
            _alive: alive,
        })
    }

    /// The session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Sends a request to a robot and waits for its pose.
    ///
    /// # Errors
    /// As [`refine`].
    pub async fn refine(
        &self,
        robot: &str,
        request: &RefineRequest<'_>,
    ) -> Result<RefineReply, RefineError> {
        let request = RefineRequest {
            client: self.number,
            ..*request
        };
        let mut asked = Asked::new(self, robot, Cancel::of(&request));
        let answer = refine(&self.session, &self.fleet, robot, &request).await;
        asked.answered = true;
        answer
    }

    /// Sends a request to the robot that has the least to do. One that turns out to be busy, without a policy or
    /// gone is passed over for the next, within the request's time.
    ///
    /// # Errors
    /// As [`refine`], of the last robot asked; `NoRobot` where none is there.
    pub async fn refine_any(
        &self,
        request: &RefineRequest<'_>,
    ) -> Result<(String, RefineReply), RefineError> {
        let started = Instant::now();
        let budget = Duration::from_millis(request.budget_ms.into());
        self.follow_robots().await?;
        let mut tried = Vec::new();
        let mut last = None;
        while let Some(robot) = self.robots.least(&tried) {
            let left = budget.saturating_sub(started.elapsed());
            if last.is_some() && left.is_zero() {
                break;
            }
            let request = RefineRequest {
                budget_ms: u32::try_from(left.as_millis()).unwrap_or(u32::MAX),
                ..*request
            };
            match self.refine(&robot, &request).await {
                Ok(reply) => return Ok((robot, reply)),
                Err(error) if passed_over(&error) => last = Some(error),
                Err(error) => return Err(error),
            }
            tried.push(robot);
        }
        match last {
            Some(error) => Err(error),
            None => {
                let key = keys::all_status(&self.fleet).map_err(RefineError::Request)?;
                Err(RefineError::NoRobot {
                    key: key.to_string(),
                })
            }
        }
    }

    /// Gets to know every robot's status, from here on as it changes; [`Client::refine_any`] does it, too.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn follow_robots(&self) -> Result<(), RefineError> {
        let following = self.following.get_or_try_init(|| self.follow()).await;
        following.map(|_| ())
    }

    /// The robots that are there, in the order of their names; none before [`Client::follow_robots`].
    pub fn heard(&self) -> Vec<Heard> {
        let robots = self.robots.lock();
        let heard = robots.iter().filter_map(|(name, robot)| {
            Some(Heard {
                robot: name.clone(),
                status: robot.status?,
                duplicate: robot.duplicate,
            })
        });
        heard.collect()
    }

    /// Asks every robot for its status, and hears of every change from here on.
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
        let robots = self.robots.clone();
        let gone = self
            .session
            .liveliness()
            .declare_subscriber(alive_key.as_str())
            .history(true)
            .callback(move |sample| {
                let robot = keys::robot_of(sample.key_expr().as_str());
                if let (SampleKind::Delete, Some(robot)) = (sample.kind(), robot) {
                    robots.lock().remove(robot);
                }
            })
            .await?;
        self.ask_for_statuses().await?;
        Ok([status, gone])
    }

    /// Asks every robot for its status once more: what they publish comes a moment late.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn ask_for_statuses(&self) -> Result<(), RefineError> {
        for (robot, status) in super::robots(&self.session, &self.fleet).await? {
            self.robots.heard(&robot, status);
        }
        Ok(())
    }
}

/// Whether another robot may do better.
fn passed_over(error: &RefineError) -> bool {
    match error {
        RefineError::NoRobot { .. } => true,
        RefineError::Refused { refusal, .. } => {
            matches!(
                refusal.reason,
                Reason::Busy | Reason::NoPolicy | Reason::Internal | Reason::NoSuchMode(_)
            )
        }
        _ => false,
    }
}

/// A request under way. Dropped before it is answered, it is taken back.
struct Asked<'c> {
    client: &'c Client,
    robot: &'c str,
    request: Cancel,
    answered: bool,
}

impl<'c> Asked<'c> {
    fn new(client: &'c Client, robot: &'c str, request: Cancel) -> Self {
        let mut robots = client.robots.lock();
        robots.entry(robot.into()).or_default().asked += 1;
        Asked {
            client,
            robot,
            request,
            answered: false,
        }
    }
}

impl Drop for Asked<'_> {
    fn drop(&mut self) {
        if let Some(robot) = self.client.robots.lock().get_mut(self.robot) {
            robot.asked = robot.asked.saturating_sub(1);
        }
        if self.answered {
            return;
        }
        let Ok(key) = keys::cancel(&self.client.fleet, self.robot) else {
            return;
        };
        let frame = small_frame(&Message::Cancel(self.request));
        if let Err(error) = self.client.session.put(key.as_str(), frame).wait() {
            tracing::debug!("request {} was not taken back: {error}", self.request.id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_of_one_name_are_told_from_one_that_restarts() {
        let robots = Robots::default();
        let mut hear = |instance| {
            let status = Status {
                instance,
                ..Status::default()
            };
            robots.heard("r1", status);
            robots.lock()["r1"].duplicate
        };
        assert_eq!([1, 1, 2, 2, 3].map(&mut hear), [false; 5]);
        assert_eq!([2, 3, 3].map(&mut hear), [true; 3]);
    }
}
