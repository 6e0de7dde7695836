//! What a publisher knows of its fleet, and what is wrong with that.

use super::super::history::History;
use super::super::{Heard, Newest};
use reagent_core::wire::{Release, Status};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// A robot that is away for so long has gone.
const MOMENT: Duration = Duration::from_secs(1);
/// So long after a router's loss robots are back.
const COMING_BACK: Duration = Duration::from_secs(30);

#[derive(Debug)]
pub(super) struct State {
    /// The policy that is served here.
    pub(super) newest: Newest,
    /// The newest release that a robot runs.
    pub(super) in_fleet: Release,
    /// The newest release that anybody announces.
    pub(super) announced: Release,
    /// Robots that have just gone away, and when; or, while there was no router, when they should have been back.
    pub(super) leaving: BTreeMap<String, Instant>,
    /// Whether robots that take the policy from now on are told of.
    pub(super) tells_takes: bool,
    /// Each robot's last status, and whether it is online.
    pub(super) robots: BTreeMap<String, (Status, bool)>,
    pub(super) history: Option<History>,
    /// Routers that the publisher is connected to; `None` before the first one.
    pub(super) routers: Option<usize>,
}

impl State {
    /// What is wrong with the fleet or here, if anything is.
    pub(super) fn wrong(&self) -> Option<String> {
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

    /// A robot goes away, or is not heard any more.
    pub(super) fn leave(&mut self, robot: &str, now: Instant) {
        if let Some((_, online)) = self.robots.get_mut(robot)
            && std::mem::take(online)
        {
            self.leaving.insert(robot.into(), now);
        }
    }

    /// Records the robots that have gone away for longer than a moment. If it was a router that went, they may all come back.
    pub(super) fn settle(&mut self, now: Instant) {
        if self.routers == Some(0) {
            let back = now + COMING_BACK;
            self.leaving.values_mut().for_each(|since| *since = back);
            return;
        }
        let is_gone = |_: &String, since: &mut Instant| now.duration_since(*since) >= MOMENT;
        let gone: Vec<_> = self.leaving.extract_if(.., is_gone).collect();
        for (robot, _) in gone {
            self.record_offline(&robot);
        }
    }

    fn record_offline(&mut self, robot: &str) {
        if let Some(history) = &mut self.history
            && let Some((status, _)) = self.robots.get(robot)
            && let Some(policy) = &status.policy
        {
            history.offline(robot, policy);
        }
    }

    /// A robot reports its status. Returns a line on a robot that has taken the policy that is served, if such are told of.
    pub(super) fn note(&mut self, Heard { robot, status }: &Heard) -> Option<String> {
        let before = self.robots.get(robot).map(|(before, _)| *before);
        let is_another = before.is_some_and(|before| before.instance != status.instance);
        if self.leaving.remove(robot).is_some() && is_another {
            self.record_offline(robot);
        }
        self.robots.insert(robot.clone(), (*status, true));
        let policy = status.policy?;
        self.found(policy.release());
        let is_taken = before.and_then(|before| before.policy) != Some(policy);
        let served = self.newest.lock().expect("no holder panics");
        let served = served.as_ref().map(|(newest, _)| newest.id());
        let is_told = self.tells_takes && is_taken && served == Some(policy);
        is_told.then(|| format!("taken by {robot}: version {}", policy.release()))
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
    pub(super) fn heard_of(&mut self, release: Release) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::WeightFile;
    use crate::publish::manifest;
    use reagent_core::wire::Manifest;
    use std::sync::{Arc, Mutex};

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
            leaving: BTreeMap::new(),
            tells_takes: false,
        };
        let serve = |state: &State, manifest: Manifest| {
            *state.newest.lock().expect("no holder panics") = Some((manifest, Vec::new()));
        };
        let runs = |state: &mut State, robot: &str, version: u64| -> Option<String> {
            let policy = manifest(version).id();
            let status = Status {
                policy: Some(policy),
                ..Status::default()
            };
            let robot = robot.into();
            state.note(&Heard { robot, status })
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

    #[test]
    fn who_takes_the_policy_later_is_told_and_who_dies_is_recorded() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let path = folder.path().join("history.jsonl");
        let file = WeightFile::pretrained();
        let manifest = manifest(7, "policy", &file).expect("a good policy");
        let policy = Some(manifest.id());
        let newest = Arc::new(Mutex::new(Some((manifest, Vec::new()))));
        let mut state = State {
            newest,
            in_fleet: Release::default(),
            announced: Release::default(),
            robots: BTreeMap::new(),
            history: Some(History::open(&path).expect("writable")),
            routers: Some(1),
            leaving: BTreeMap::new(),
            tells_takes: true,
        };
        let report = |policy, instance| Heard {
            robot: "a".into(),
            status: Status {
                policy,
                instance,
                ..Status::default()
            },
        };
        let (empty, runs) = (report(None, 1), report(policy, 1));
        assert_eq!(state.note(&empty), None);
        let told = state.note(&runs);
        assert_eq!(told.as_deref(), Some("taken by a: version 7"));
        assert_eq!(state.note(&runs), None);
        let lines = || {
            let text = std::fs::read_to_string(&path).unwrap_or_default();
            text.matches("\"event\":\"offline\"").count()
        };
        let now = Instant::now();
        let later = |seconds| now + Duration::from_secs(seconds);
        // It is back within a moment: its link was away.
        state.leave("a", now);
        state.note(&runs);
        state.settle(later(5));
        assert_eq!(lines(), 0);
        // It was started again.
        state.leave("a", now);
        state.note(&report(policy, 2));
        assert_eq!(lines(), 1);
        state
            .history
            .as_mut()
            .expect("open")
            .heard(&report(policy, 2));
        // It stays away.
        state.leave("a", now);
        state.settle(now);
        assert_eq!(lines(), 1);
        state.settle(later(5));
        assert_eq!(lines(), 2);
        // A router was away, and this robot does not come back with it.
        state.note(&report(policy, 2));
        state
            .history
            .as_mut()
            .expect("open")
            .heard(&report(policy, 2));
        state.routers = Some(0);
        state.leave("a", now);
        state.settle(later(5));
        state.routers = Some(1);
        state.settle(later(15));
        assert_eq!(lines(), 2);
        state.settle(later(60));
        assert_eq!(lines(), 3);
    }
}
