//! Robots that are not heard, as where a publisher has no router for a while, or that leave while a policy goes out.

mod support;

use host_train::publish::{Gate, Stages, manifest};
use reagent_core::wire::{self, Message, Status, keys};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;
use support::rollout::{gate, good_policy, negated};
use support::{FLEET, Network, publisher, served};
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

/// Number of poses by which a stage is judged.
const POSES: u64 = 60;

/// A robot that answers when it is asked and is never heard otherwise, as if it always published while the publisher had
/// no router. `status` gets the number of the question.
async fn unheard(
    network: &Network,
    status: impl Fn(u32) -> Option<Status> + Send + Sync + 'static,
) -> (Session, Queryable<()>) {
    let key = keys::status(FLEET, "a").expect("good names");
    let questions = AtomicU32::new(0);
    let session = network.join().await;
    let (answering, own) = (session.declare_queryable(key.as_str()), key.clone());
    let answering = answering.callback(move |query| {
        let Some(status) = status(questions.fetch_add(1, Ordering::Relaxed)) else {
            return;
        };
        let mut buffer = [0; wire::SMALL_FRAME_BYTES];
        let frame = wire::encode(&Message::Status(status), &mut buffer).expect("it fits");
        let answered = query.reply(own.as_str(), frame);
        answered.wait().expect("an open session");
    });
    let answering = answering.await.expect("an open session");
    served(&network.router, key.as_str()).await;
    (session, answering)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stage_does_not_wait_for_a_robot_that_has_left() {
    let network = Network::start().await;
    let _a = network.node(FLEET, "a").await;
    let b = network.node(FLEET, "b").await;
    let mut publisher = publisher(&network).await;
    let file = good_policy();
    let manifest = publisher.prepare(1, "first", &file).await;
    let manifest = manifest.expect("a sound policy");
    b.stop().await;
    let hours = Gate {
        wait: Duration::from_secs(36_000),
        ..gate(0)
    };
    let mut lines = Vec::new();
    // The second adds nobody.
    let stages: Stages = "80%,1".parse().expect("stages");
    let told = |line| lines.push(line);
    let outcome = publisher.roll_out(&manifest, &file, &stages, &hours, told);
    assert_eq!(outcome.await.expect("an open session").map(drop), Ok(()));
    lines.retain(|line| line.starts_with("stage"));
    assert_eq!(lines, ["stage of 1 robot: taken; no longer there: b"]);
}

/// The status of a robot that runs the good policy under a version.
fn runs_good(version: u64) -> Status {
    let manifest = manifest(version, "good", &good_policy()).expect("a good policy");
    Status {
        policy: Some(manifest.id()),
        ..Status::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_whose_report_was_lost_is_asked_again() {
    let network = Network::start().await;
    // The third question is the first after those before and after the announcement.
    let reports = |question| Some(runs_good(if question < 2 { 1 } else { 2 }));
    let _robot = unheard(&network, reports).await;
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(2, "good", good_policy()).await;
    let published = published.expect("a good policy");
    let reception = publisher.reception(&published, Duration::from_secs(60));
    let reception = reception.await.expect("an open session");
    assert_eq!(reception.taken, ["a"], "{reception}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_is_not_heard_has_its_past_all_the_same() {
    let network = Network::start().await;
    let known = |question| {
        let mut status = runs_good(1);
        status.tally.verdicts[0] = POSES as u32;
        (question < 2).then_some(status)
    };
    let _robot = unheard(&network, known).await;
    let mut publisher = publisher(&network).await;
    let worse = negated(7);
    let manifest = publisher.prepare(2, "worse", &worse).await;
    let manifest = manifest.expect("a sound policy");
    let gate = Gate {
        wait: Duration::from_secs(3),
        ..gate(POSES)
    };
    let mut lines = Vec::new();
    let stages: Stages = "100%".parse().expect("stages");
    let told = |line| lines.push(line);
    let outcome = publisher.roll_out(&manifest, &worse, &stages, &gate, told);
    let halt = outcome.await.expect("an open session");
    let halt = halt.expect_err("nobody has judged it");
    let said = halt.to_string();
    let unknown = format!("0 poses with the new policy where {POSES} are needed to judge it");
    assert!(said.starts_with(&unknown), "{said}: {lines:?}");
}
