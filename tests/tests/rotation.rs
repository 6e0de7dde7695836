//! Certificates are renewed while robots serve: only the router is restarted, and every request gets its pose.

mod support;

use firmware_sim::client::{Client, RefineError};
use host_train::publish::Publisher;
use reagent_core::wire::RefineRequest;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use support::process::{self, Member};
use support::secured::{LAB, Secured};
use support::{int8_policy, key, random_cloud, request, until};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout;

const ROTATION: &str = "a_rotation_of_all_certificates_under_load_loses_no_request";
/// Requests in flight at once.
const IN_FLIGHT: u64 = 4;
/// Poses before the rotation, and after it.
const POSES: u64 = 50;
/// A robot's time for a pose. A request in flight when the router died may wait for as long.
const BUDGET_MS: u32 = 5000;
/// A request without a pose is repeated when a robot is heard, or after this time.
const AGAIN: Duration = Duration::from_secs(1);
/// A request is repeated until this time has passed.
const PATIENCE: Duration = Duration::from_secs(60);

#[tokio::test(flavor = "multi_thread")]
async fn a_rotation_of_all_certificates_under_load_loses_no_request() {
    process::play().await;
    let Some(secured) = Secured::without_router() else {
        return;
    };
    let config = secured.config("router");
    let start_router = || Member::start(ROTATION, &["router", config.to_str().expect("plain")]);
    let mut router = start_router();
    router.wait_until_up();
    let robots = [secured.robot("arm1").await, secured.robot("arm2").await];
    let mut publisher = Publisher::new(secured.join("trainer").await, LAB, key(1));
    let publisher = publisher.as_mut().expect("a good name");
    let published = publisher.publish(1, "first", int8_policy()).await;
    published.expect("a good policy");
    for robot in &robots {
        until(robot, |view| view.policy.is_some()).await;
    }
    let client = Client::new(secured.join("client").await, LAB).await;
    let client = Arc::new(client.expect("a good name"));
    client.follow_robots().await.expect("an open session");

    let (poses, done) = (watch::Sender::new(0), Arc::new(AtomicBool::new(false)));
    let mut asking = JoinSet::new();
    for seed in 0..IN_FLIGHT {
        let (client, poses, done) = (client.clone(), poses.clone(), done.clone());
        asking.spawn(async move {
            let mut again = 0;
            while !done.load(Ordering::Relaxed) {
                again += ask(&client, seed).await;
                poses.send_modify(|poses| *poses += 1);
            }
            again
        });
    }
    let mut given = poses.subscribe();
    let mut reach = async |more: u64| {
        let wanted = *given.borrow() + more;
        let reached = timeout(PATIENCE, given.wait_for(|&given| given >= wanted)).await;
        reached
            .expect("robots answer")
            .expect("it is here")
            .to_owned()
    };
    reach(POSES).await;
    let before = robots.each_ref().map(|robot| robot.watch().borrow().served);
    // The new certificates are of another authority: whoever still shows an old one is not let in.
    secured.renew();
    drop(router);
    let _router = start_router();
    let poses = reach(POSES).await;
    done.store(true, Ordering::Relaxed);
    let again: u64 = asking.join_all().await.iter().sum();
    println!("{poses} poses, {again} asked again");
    assert!(again > 0, "the router was not missed");
    for (robot, before) in robots.iter().zip(before) {
        let served = robot.watch().borrow().served;
        assert!(served > before, "{served}");
    }
}

/// Asks until there is a pose, and returns the number of further attempts.
async fn ask(client: &Client, seed: u64) -> u64 {
    let cloud = random_cloud(seed, 64);
    let request = RefineRequest {
        budget_ms: BUDGET_MS,
        ..request(&cloud, &cloud)
    };
    let started = Instant::now();
    let mut attempts = 0;
    loop {
        assert!(started.elapsed() < PATIENCE, "a request is lost");
        let mut changes = client.changes();
        match client.refine_any(&request).await {
            Ok(_) => return attempts,
            // There is no router, or none that knows a robot yet: asks again when one is heard.
            Err(RefineError::NoRobot { .. } | RefineError::Deadline { .. }) => {
                timeout(AGAIN, changes.changed()).await.ok();
                attempts += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
}
