//! Many requests to a fleet whose routers, robots and publisher are killed all the time: none is lost, and none
//! answered twice.
//!
//! `REAGENT_SOAK=20000` sets their number; by default there are fewer.

mod support;

use firmware_sim::client::Client;
use firmware_sim::session::{SessionArgs, open, unused_endpoint};
use host_train::random::{Purpose, stream};
use rand::RngExt;
use rand::seq::IndexedRandom;
use reagent_core::Decision;
use reagent_core::wire::{self, Message, Reason, RefineRequest, keys};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use support::process::{self, Member};
use support::{FLEET, int8_policy, random_cloud, request};
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::timeout;
use zenoh::Session;
use zenoh::query::ConsolidationMode;

const SOAK: &str = "no_request_is_lost_or_answered_twice_while_everybody_is_killed";
const SEED: u64 = 1;
const ROBOTS: [&str; 4] = ["r0", "r1", "r2", "r3"];
/// Requests in flight at once.
const IN_FLIGHT: usize = 12;
/// Most requests between two kills.
const PACE: usize = 60;
/// Longest time that a killed member stays away.
const AWAY: Duration = Duration::from_millis(500);
/// Longest time for a question to one robot.
const ANSWER: Duration = Duration::from_secs(5);
/// A request that no robot answers is repeated when the fleet changes, or after this time.
const AGAIN: Duration = Duration::from_millis(100);
/// A request is repeated, to the next robot, until this time has passed.
const PATIENCE: Duration = Duration::from_secs(60);

/// The files of a fleet, and its members.
struct Fleet {
    folder: tempfile::TempDir,
    members: Vec<(Vec<String>, Option<Member>)>,
    policies: [PathBuf; 2],
    published: u64,
}

impl Fleet {
    /// Two routers that know each other, robots that know both, and a publisher.
    fn start() -> Fleet {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let policy = int8_policy();
        let policies = [Decision::default(), Decision::MostLikely].map(|decision| {
            let path = folder.path().join(format!("{decision:?}.rgw"));
            let file = policy.clone().deciding(decision);
            file.save(&path).expect("writable");
            path
        });
        let routers = [(); 2].map(|()| unused_endpoint().expect("a free port"));
        let mut fleet = Fleet {
            folder,
            members: Vec::new(),
            policies,
            published: 0,
        };
        for (number, router) in routers.iter().enumerate() {
            let other = &routers[1 - number];
            let config = fleet.config(&format!("router{number}"), Some(router), &[other]);
            fleet.members.push((vec!["router".into(), config], None));
        }
        for (number, robot) in ROBOTS.iter().enumerate() {
            let order = [&routers[number % 2], &routers[1 - number % 2]];
            let config = fleet.config(robot, None, &order);
            let state = text(&fleet.folder.path().join(format!("{robot}-state")));
            let role = vec!["node".into(), config, (*robot).into(), state];
            fleet.members.push((role, None));
        }
        let config = fleet.config("members", None, &[&routers[0], &routers[1]]);
        fleet.members.push((vec!["publisher".into(), config], None));
        for member in 0..fleet.members.len() {
            fleet.revive(member);
        }
        fleet
    }

    /// Writes the configuration of a member, which waits for routers as long as it takes.
    fn config(&self, name: &str, listen: Option<&str>, connect: &[&String]) -> String {
        let path = self.folder.path().join(format!("{name}.json5"));
        let config = serde_json::json!({
            "mode": if listen.is_some() { "router" } else { "client" },
            "listen": { "endpoints": listen.as_slice() },
            "connect": { "endpoints": connect, "timeout_ms": -1, "exit_on_failure": false },
            "scouting": { "multicast": { "enabled": false } },
        });
        std::fs::write(&path, config.to_string()).expect("writable");
        text(&path)
    }

    async fn join(&self) -> Session {
        let args = SessionArgs {
            zenoh: Some(self.folder.path().join("members.json5")),
            ..SessionArgs::default()
        };
        open(&args).await.expect("routers that come")
    }

    /// Starts a member; a publisher starts with the next version of the other policy.
    fn revive(&mut self, member: usize) {
        let (role, process) = &mut self.members[member];
        let mut role = role.clone();
        if role[0] == "publisher" {
            self.published += 1;
            let policy = &self.policies[self.published as usize % 2];
            role.extend([text(policy), self.published.to_string()]);
        }
        let role: Vec<_> = role.iter().map(String::as_str).collect();
        *process = Some(Member::start(SOAK, &role));
    }

    /// Kills members at random, one after another, each within a few requests, and restarts them, as well as those that
    /// have ended by themselves. Goes on until `poses` ends.
    async fn suffer(&mut self, mut poses: watch::Receiver<u64>, allowed: &Semaphore) -> Deaths {
        let mut rng = stream(SEED, Purpose::Shape, 0);
        let mut deaths = Deaths::default();
        let members: Vec<_> = (0..self.members.len()).collect();
        let mut begun = 0;
        loop {
            let more = rng.random_range(1..=PACE);
            begun += more as u64;
            allowed.add_permits(more);
            // Not all of them, so that some are in flight when the next member dies.
            let enough = begun.saturating_sub(IN_FLIGHT as u64);
            while *poses.borrow() < enough {
                let reached = poses.wait_for(|&poses| poses >= enough);
                if let Ok(Err(_)) = timeout(AGAIN, reached).await {
                    return deaths;
                }
                deaths.by_themselves += self.revive_the_dead();
            }
            let victim = *members.choose(&mut rng).expect("there are some");
            match self.members[victim].0[0].as_str() {
                "router" => deaths.routers += 1,
                "node" => deaths.robots += 1,
                _ => deaths.publishers += 1,
            }
            self.members[victim].1 = None;
            tokio::time::sleep(AWAY.mul_f64(rng.random())).await;
            self.revive(victim);
        }
    }

    /// Restarts all members that have ended, as a service manager does, and returns their number.
    fn revive_the_dead(&mut self) -> u64 {
        let mut count = 0;
        for member in 0..self.members.len() {
            let process = &mut self.members[member].1;
            if process.as_mut().is_some_and(Member::has_ended) {
                count += 1;
                self.revive(member);
            }
        }
        count
    }
}

/// How often each member was killed, and how many ended by themselves and were restarted, such as a robot whose name
/// the network still held for its predecessor.
#[derive(Debug, Default)]
struct Deaths {
    routers: u64,
    robots: u64,
    publishers: u64,
    by_themselves: u64,
}

fn text(path: &Path) -> String {
    path.to_str().expect("a plain path").into()
}

#[derive(Default)]
struct Counts {
    again: AtomicU64,
    twice: AtomicU64,
    foreign: AtomicU64,
}

/// Every answer to a query; poses by their request's id.
async fn answers(session: &Session, robot: &str, frame: Vec<u8>) -> Vec<Result<u64, Reason>> {
    let key = keys::refine(FLEET, robot).expect("good names");
    let asked = session.get(key.as_str()).payload(frame).timeout(ANSWER);
    // All answers, including two from one robot.
    let asked = asked.consolidation(ConsolidationMode::None);
    let replies = asked.await.expect("an open session");
    let mut answers = Vec::new();
    while let Ok(reply) = replies.recv_async().await {
        let payload = match reply.result() {
            Ok(sample) => sample.payload().to_bytes().into_owned(),
            Err(error) => error.payload().to_bytes().into_owned(),
        };
        match wire::decode(&payload) {
            Ok(Message::RefineReply(reply)) => answers.push(Ok(reply.id)),
            Ok(Message::Refusal(refusal)) => answers.push(Err(refusal.reason)),
            // Zenoh's reply when the time has passed.
            _ if payload == b"Timeout" => {}
            other => panic!("{other:?}: {}", String::from_utf8_lossy(&payload)),
        }
    }
    answers
}

/// Asks one robot after another until there is a pose.
async fn ask(client: &Client, id: u64, counts: &Counts) {
    let cloud = random_cloud(id % 7, 16);
    let request = RefineRequest {
        id,
        max_steps: 1,
        ..request(&cloud, &cloud)
    };
    let mut frame = vec![0; 1024];
    let length = wire::encode(&Message::RefineRequest(request), &mut frame);
    let length = length.expect("it fits").len();
    frame.truncate(length);
    let started = Instant::now();
    for robot in ROBOTS.iter().cycle().skip(id as usize % ROBOTS.len()) {
        assert!(started.elapsed() < PATIENCE, "request {id} is lost");
        let mut changes = client.changes();
        let answers = answers(client.session(), robot, frame.clone()).await;
        if answers.len() > 1 {
            counts.twice.fetch_add(1, Ordering::Relaxed);
        }
        match answers.first() {
            Some(Ok(answered)) => {
                let foreign = u64::from(*answered != id);
                counts.foreign.fetch_add(foreign, Ordering::Relaxed);
                return;
            }
            // It is gone, full, or still without its policy.
            None | Some(Err(Reason::Busy | Reason::NoPolicy)) => {
                counts.again.fetch_add(1, Ordering::Relaxed);
                timeout(AGAIN, changes.changed()).await.ok();
            }
            Some(Err(other)) => panic!("{other}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn no_request_is_lost_or_answered_twice_while_everybody_is_killed() {
    process::play().await;
    let asked = std::env::var("REAGENT_SOAK")
        .ok()
        .and_then(|n| n.parse().ok());
    let total: u64 = asked.unwrap_or(1000);
    let mut fleet = Fleet::start();
    let client = Client::new(fleet.join().await, FLEET).await;
    let client = Arc::new(client.expect("a good name"));
    client.follow_robots().await.expect("an open session");
    let counts = Arc::new(Counts::default());
    let (poses, seen) = watch::channel(0);
    let poses = Arc::new(poses);

    let started = Instant::now();
    let (places, allowed) = (Arc::new(Semaphore::new(IN_FLIGHT)), Semaphore::new(0));
    let load = async {
        let mut requests = JoinSet::new();
        for id in 1..=total {
            allowed.acquire().await.expect("open").forget();
            let place = places.clone().acquire_owned().await.expect("open");
            let (client, counts, poses) = (client.clone(), counts.clone(), poses.clone());
            requests.spawn(async move {
                ask(&client, id, &counts).await;
                poses.send_modify(|poses| *poses += 1);
                drop(place);
            });
        }
        requests.join_all().await;
        let answered = *poses.borrow();
        // This ends the kills.
        drop(poses);
        answered
    };
    let (deaths, answered) = tokio::join!(fleet.suffer(seen, &allowed), load);
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    let again = count(&counts.again);
    println!(
        "{total} requests in {:.0} s, killed {deaths:?}, {again} asked again",
        started.elapsed().as_secs_f64()
    );
    assert_eq!(answered, total, "lost");
    assert_eq!((count(&counts.twice), count(&counts.foreign)), (0, 0));
    let all_kinds = deaths.routers.min(deaths.robots).min(deaths.publishers);
    assert!(all_kinds > 0 && again > 0, "{deaths:?}");
}
