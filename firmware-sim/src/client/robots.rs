//! What a client knows of the fleet's robots.
#![allow(
    clippy::disallowed_types,
    reason = "the clock of who watches, not of a robot"
)]

use reagent_core::wire::Status;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, SystemTime};
use tokio::sync::watch;

/// What is known of the fleet's robots.
#[derive(Debug, Default)]
pub(super) struct Robots {
    known: Mutex<BTreeMap<String, Robot>>,
    pub(super) changes: watch::Sender<()>,
}

/// A robot that has been heard.
#[derive(Clone, Debug)]
pub struct Heard {
    /// Its name.
    pub robot: String,
    /// Its last status.
    pub status: Status,
    /// Whether two robots publish under this name in turns.
    pub duplicate: bool,
    /// Since when it has been away.
    pub offline_since: Option<SystemTime>,
}

/// A robot that was asked in vain.
#[derive(Debug)]
pub(super) struct Tried {
    pub(super) robot: String,
    /// How often it had been heard when it was asked and did not answer: it is asked again once it is heard again. None if it
    /// refused the request, which it would do again.
    pub(super) heard: Option<u32>,
}

impl Tried {
    pub(super) fn refused(&self) -> bool {
        self.heard.is_none()
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Robot {
    /// The last status; none if the robot was asked but never heard.
    status: Option<Status>,
    /// The instance that published under this name before the current one.
    former: Option<u32>,
    duplicate: bool,
    /// Requests of this client that it has not answered.
    pub(super) asked: u16,
    /// It let a request's time pass without an answer, and has not been heard since.
    is_silent: bool,
    offline_since: Option<SystemTime>,
    /// How often it has gone away.
    pub(super) departures: u32,
    /// How often it has been heard.
    times_heard: u32,
}

impl Robots {
    pub(super) fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Robot>> {
        self.known.lock().expect("no holder panics")
    }

    pub(super) fn heard(&self, robot: &str, status: Status) {
        self.hear(robot, status);
        self.changes.send_replace(());
    }

    /// As [`Self::heard`], for an answer to a question. `departures` is how often the robot had gone away when it was asked. If it
    /// has gone since, the answer is out of date and is ignored.
    pub(super) fn answered(&self, robot: &str, status: Status, departures: u32) {
        if self.departures(robot) == departures {
            self.heard(robot, status);
        }
    }

    pub(super) fn departures(&self, robot: &str) -> u32 {
        self.lock().get(robot).map_or(0, |known| known.departures)
    }

    pub(super) fn times_heard(&self, robot: &str) -> u32 {
        self.lock().get(robot).map_or(0, |known| known.times_heard)
    }

    /// Whether the robot is there, and has been heard since it had been heard so often.
    pub(super) fn is_back(&self, robot: &str, times_heard: u32) -> bool {
        self.lock()
            .get(robot)
            .is_some_and(|known| known.offline_since.is_none() && known.times_heard != times_heard)
    }

    /// How long the robot has been away; `None` if it is there.
    pub(super) fn away(&self, robot: &str) -> Option<Duration> {
        let since = self.lock().get(robot)?.offline_since?;
        Some(since.elapsed().unwrap_or_default())
    }

    pub(super) fn hear(&self, robot: &str, status: Status) {
        let mut robots = self.lock();
        let known = robots.entry(robot.into()).or_default();
        known.offline_since = None;
        known.is_silent = false;
        known.times_heard = known.times_heard.wrapping_add(1);
        if let Some(last) = known.status.replace(status)
            && last.instance != status.instance
        {
            // After a restart the former instance stays silent. If there are two robots, it speaks again.
            known.duplicate |= known.former == Some(status.instance);
            known.former = Some(last.instance);
        }
    }

    /// The robot let a request's time pass without an answer: others are asked first until it is heard again.
    pub(super) fn silent(&self, robot: &str) {
        self.lock().entry(robot.into()).or_default().is_silent = true;
    }

    /// The robot's liveliness token is gone: the robot, its link, or the router is away.
    pub(super) fn gone(&self, robot: &str) {
        let mut robots = self.lock();
        let known = robots.entry(robot.into()).or_default();
        known.departures += 1;
        known.offline_since.get_or_insert_with(SystemTime::now);
        drop(robots);
        self.changes.send_replace(());
    }

    /// The robots that have been heard, sorted by name.
    pub(super) fn all(&self) -> Vec<Heard> {
        let robots = self.lock();
        let heard = robots.iter().filter_map(|(name, robot)| {
            Some(Heard {
                robot: name.clone(),
                status: robot.status?,
                duplicate: robot.duplicate,
                offline_since: robot.offline_since,
            })
        });
        heard.collect()
    }

    /// The robot to ask next, except those that were tried and have not been heard since: one that answers, with a policy, with
    /// the least to do, that has served least, in this order. Requests of this client count even if they are not in the robot's status yet.
    pub(super) fn least(&self, tried: &[Tried]) -> Option<String> {
        let load = |robot: &Robot| {
            let status = robot.status.filter(|_| robot.offline_since.is_none())?;
            let in_hand = status.in_hand.max(robot.asked);
            let has_no_policy = status.policy.is_none();
            Some((robot.is_silent, has_no_policy, in_hand, status.served))
        };
        let in_vain = |name: &String, robot: &Robot| {
            let tried = tried.iter().find(|tried| tried.robot == *name);
            tried.is_some_and(|tried| tried.heard.is_none_or(|heard| heard == robot.times_heard))
        };
        let robots = self.lock();
        let eligible = robots.iter().filter(|(name, robot)| !in_vain(name, robot));
        let loads = eligible.filter_map(|(name, robot)| Some((load(robot)?, name)));
        loads.min().map(|(_, name)| name.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_that_comes_after_a_robot_has_gone_does_not_bring_it_back() {
        let robots = Robots::default();
        let is_there = || robots.lock()["r1"].offline_since.is_none();
        let before = robots.departures("r1");
        robots.answered("r1", Status::default(), before);
        assert!(is_there());
        let before = robots.departures("r1");
        robots.gone("r1");
        robots.answered("r1", Status::default(), before);
        assert!(!is_there());
        let before = robots.departures("r1");
        robots.answered("r1", Status::default(), before);
        assert!(is_there());
        // Gone before anything was heard of it.
        robots.gone("r2");
        robots.answered("r2", Status::default(), 0);
        assert!(robots.lock()["r2"].status.is_none());
    }

    #[test]
    fn a_robot_that_said_nothing_in_time_comes_last_until_it_is_heard() {
        let robots = Robots::default();
        robots.heard("a", Status::default());
        robots.heard("b", Status::default());
        assert_eq!(robots.least(&[]).as_deref(), Some("a"));
        robots.silent("a");
        assert_eq!(robots.least(&[]).as_deref(), Some("b"));
        let tried = |heard| Tried {
            robot: "b".into(),
            heard,
        };
        assert_eq!(robots.least(&[tried(None)]).as_deref(), Some("a"));
        // It did not answer, and then it was heard.
        assert_eq!(robots.least(&[tried(Some(1))]).as_deref(), Some("a"));
        assert_eq!(robots.least(&[tried(Some(0))]).as_deref(), Some("b"));
        robots.heard("a", Status::default());
        assert_eq!(robots.least(&[]).as_deref(), Some("a"));
    }

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
