//! Many requests to a fleet whose robots restart all the time: none is lost, none answered twice.
//!
//! `REAGENT_SOAK=10000` asks so many; fewer without.

mod support;

use firmware_sim::node::Node;
use reagent_core::wire::{self, Message, Reason, RefineRequest, keys};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use support::{FLEET, Network, int8_policy, publisher, random_cloud, request, until};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use zenoh::Session;

const ROBOTS: [&str; 4] = ["r0", "r1", "r2", "r3"];
/// Requests under way at once.
const IN_FLIGHT: usize = 12;
/// A request is asked again, of the next robot, until this time has passed.
const PATIENCE: Duration = Duration::from_secs(60);

#[derive(Default)]
struct Counts {
    poses: AtomicU64,
    again: AtomicU64,
    twice: AtomicU64,
    foreign: AtomicU64,
}

/// Every answer to a query, poses by their id.
async fn answers(session: &Session, robot: &str, frame: Vec<u8>) -> Vec<Result<u64, Reason>> {
    let key = keys::refine(FLEET, robot).expect("good names");
    let replies = session.get(key.as_str()).payload(frame);
    let replies = replies.timeout(PATIENCE).await.expect("an open session");
    let mut answers = Vec::new();
    while let Ok(reply) = replies.recv_async().await {
        let payload = match reply.result() {
            Ok(sample) => sample.payload().to_bytes().into_owned(),
            Err(error) => error.payload().to_bytes().into_owned(),
        };
        match wire::decode(&payload) {
            Ok(Message::RefineReply(reply)) => answers.push(Ok(reply.id)),
            Ok(Message::Refusal(refusal)) => answers.push(Err(refusal.reason)),
            other => panic!("{other:?}: {}", String::from_utf8_lossy(&payload)),
        }
    }
    answers
}

/// Asks one robot after the other until there is a pose.
async fn ask(session: &Session, id: u64, counts: &Counts) {
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
    for robot in ROBOTS.iter().cycle().skip(id as usize) {
        assert!(started.elapsed() < PATIENCE, "request {id} is lost");
        let answers = answers(session, robot, frame.clone()).await;
        if answers.len() > 1 {
            counts.twice.fetch_add(1, Ordering::Relaxed);
        }
        match answers.first() {
            Some(Ok(answered)) => {
                counts
                    .foreign
                    .fetch_add(u64::from(*answered != id), Ordering::Relaxed);
                counts.poses.fetch_add(1, Ordering::Relaxed);
                return;
            }
            // Gone, full, or without its policy yet.
            None | Some(Err(Reason::Busy | Reason::NoPolicy)) => {
                counts.again.fetch_add(1, Ordering::Relaxed);
                tokio::task::yield_now().await;
            }
            Some(Err(other)) => panic!("{other}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn no_request_is_lost_or_answered_twice_while_robots_restart() {
    let asked = std::env::var("REAGENT_SOAK")
        .ok()
        .and_then(|n| n.parse().ok());
    let total: u64 = asked.unwrap_or(4000);
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "first", int8_policy()).await;
    published.expect("a good policy");
    let mut nodes: Vec<Node> = Vec::new();
    for robot in ROBOTS {
        let node = network.node(FLEET, robot).await;
        until(&node, |view| view.policy.is_some()).await;
        nodes.push(node);
    }
    let session = network.join().await;
    let (counts, done) = (
        Arc::new(Counts::default()),
        Arc::new(AtomicBool::new(false)),
    );
    let restarts = async {
        let mut restarts = 0;
        while !done.load(Ordering::Relaxed) {
            let place = restarts % ROBOTS.len();
            // Dropped as it is, with what it has in hand.
            drop(nodes.remove(place));
            let node = network.node(FLEET, ROBOTS[place]).await;
            until(&node, |view| view.policy.is_some()).await;
            nodes.insert(place, node);
            restarts += 1;
        }
        restarts
    };
    let places = Arc::new(Semaphore::new(IN_FLIGHT));
    let load = async {
        let mut requests = JoinSet::new();
        for id in 1..=total {
            let place = places.clone().acquire_owned().await.expect("open");
            let (session, counts) = (session.clone(), counts.clone());
            requests.spawn(async move {
                ask(&session, id, &counts).await;
                drop(place);
            });
        }
        requests.join_all().await;
        done.store(true, Ordering::Relaxed);
    };
    let (restarts, ()) = tokio::join!(restarts, load);
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    let again = count(&counts.again);
    println!("{total} requests, {restarts} restarts, {again} asked again");
    assert_eq!(count(&counts.poses), total, "lost");
    assert_eq!((count(&counts.twice), count(&counts.foreign)), (0, 0));
    assert!(
        restarts > 0 && again > 0,
        "{restarts} restarts, {again} asked again"
    );
}
