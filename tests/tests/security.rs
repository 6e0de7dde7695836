//! Permissions, with the configurations that `firmware-sim/deploy/make-ca` writes, on real sessions over QUIC.

mod support;

use firmware_sim::client::{self, Client, RefineError};
use firmware_sim::node::NodeError;
use firmware_sim::session::{SessionArgs, open};
use host_train::publish::{Gate, PublishError, Publisher, manifest, sign};
use reagent_core::wire::{self, RefineRequest, keys};
use std::time::Duration;
use support::secured::{LAB, Secured, make_ca};
use support::{key, random_cloud, random_policy, request, until};
use zenoh::Wait;

/// What is forbidden is not answered within this time.
const SILENCE: Duration = Duration::from_millis(500);
/// What is allowed is answered within this time, however busy the machine is.
const PATIENCE: Duration = Duration::from_secs(60);

#[tokio::test(flavor = "multi_thread")]
async fn everybody_does_their_part_and_nothing_else() {
    let Some(secured) = Secured::start().await else {
        return;
    };
    let arm1 = secured.robot("arm1").await;
    let mut publisher = Publisher::new(secured.join("trainer").await, LAB, key(1));
    let publisher = publisher.as_mut().expect("a good name");
    publisher.listener = Some(secured.join("trainer").await);
    let published = publisher.publish(1, "first", random_policy(1)).await;
    let published = published.expect("a good policy, which others hear of");
    until(&arm1, |view| view.policy.is_some()).await;

    // A client asks by name and by load, cancels what it no longer wants, and reads traces.
    let client = Client::new(secured.join("client").await, LAB).await;
    let client = client.expect("a good name");
    let traces = keys::all_traces(LAB).expect("a good name");
    let traces = client.session().declare_subscriber(traces.as_str()).await;
    let traces = traces.expect("an open session");
    let cloud = random_cloud(1, 50);
    let traced = RefineRequest {
        trace: true,
        ..request(&cloud, &cloud)
    };
    let by_name = client.refine("arm1", &traced).await;
    assert!(by_name.is_ok(), "{by_name:?}");
    traces.recv_async().await.expect("a trace");
    let any = client.refine_any(&request(&cloud, &cloud)).await;
    let view = arm1.watch().borrow().clone();
    let (robot, _) = any.unwrap_or_else(|error| panic!("{error}; {view:?}"));
    assert_eq!(robot, "arm1");
    let large = random_cloud(1, 4096);
    let long = RefineRequest {
        max_steps: 255,
        ..request(&large, &large)
    };
    tokio::select! {
        answer = client.refine("arm1", &long) => panic!("{answer:?}"),
        _ = until(&arm1, |view| view.in_hand == 1) => {}
    }
    until(&arm1, |view| view.taken_back == 1).await;
    let leaving = Client::new(secured.join("client").await, LAB).await;
    let leaving = leaving.expect("a good name");
    tokio::select! {
        answer = leaving.refine("arm1", &long) => panic!("{answer:?}"),
        _ = until(&arm1, |view| view.in_hand == 1) => {
            leaving.session().close().await.expect("an open session");
        }
    }
    until(&arm1, |view| view.taken_back == 2).await;

    // A message larger than any request does not reach the robot.
    let refused = arm1.watch().borrow().refused;
    let refine = keys::refine(LAB, "arm1").expect("good names");
    let too_large = vec![0; wire::REQUEST_BYTES + 1];
    let asked = client::ask(client.session(), &refine, "arm1", too_large, SILENCE).await;
    let unheard = matches!(
        asked,
        Err(RefineError::Deadline { .. } | RefineError::NoRobot { .. })
    );
    assert!(unheard, "{asked:?}");
    let small = client::ask(client.session(), &refine, "arm1", vec![0], PATIENCE).await;
    assert!(
        matches!(small, Err(RefineError::Refused { .. })),
        "{small:?}"
    );
    assert_eq!(arm1.watch().borrow().refused, refused + 1);

    // A robot that was given another's certificate learns that nobody hears it.
    let heard = arm1.check_heard(&secured.join("arm1").await).await;
    heard.expect("others hear it");
    let arm9 = secured.named("arm1", "arm9").await;
    let unheard = arm9.check_heard(&secured.join("arm1").await).await;
    assert!(
        matches!(unheard, Err(NodeError::Unheard { .. })),
        "{unheard:?}"
    );
    drop(arm9);

    // The trainer learns how robots receive a policy, and so does a client that tries to publish one.
    let told = publisher.reception(&published, PATIENCE);
    let told = told.await.expect("an open session");
    assert_eq!(
        (&told.taken[..], told.is_complete()),
        (&["arm1".to_owned()][..], true)
    );
    let mut impostor =
        Publisher::new(secured.join("client").await, LAB, key(1)).expect("a good name");
    let shipped = impostor.publish(2, "second", random_policy(2)).await;
    let shipped = shipped.expect("a good policy");
    let told = impostor.reception(&shipped, SILENCE);
    let told = told.await.expect("an open session");
    assert_eq!((told.taken.len(), told.silent.len()), (0, 1), "{told}");
    drop(impostor);
    // A robot's certificate cannot see other robots, but it learns that nobody hears it.
    let robot = secured.join("arm2").await;
    let mut impostor = Publisher::new(robot, LAB, key(1)).expect("a good name");
    impostor.listener = Some(secured.join("arm2").await);
    let unheard = impostor.publish(3, "third", random_policy(2)).await;
    assert!(
        matches!(unheard, Err(PublishError::Unheard { .. })),
        "{unheard:?}"
    );
    // The same holds for stages, before any robot is waited for.
    let file = random_policy(2);
    let fourth = impostor.prepare(4, "fourth", &file).await;
    let fourth = fourth.expect("a good policy");
    let (poses, wait) = (1, SILENCE);
    let stages = "1,100%".parse().expect("stages");
    let gate = Gate {
        poses,
        wait,
        except: Vec::new(),
        old: published.sha256,
        anyway: false,
    };
    let stages = impostor.roll_out(&fourth, &file, &stages, &gate, |line| panic!("{line}"));
    let unheard = stages.await;
    assert!(
        matches!(unheard, Err(PublishError::Unheard { .. })),
        "{unheard:?}"
    );
    drop(impostor);

    // Two members who exceed their permissions: a client and a robot.
    let announced = keys::manifest(LAB).expect("a good name");
    let witness = secured.join("arm1").await;
    let heard = witness.declare_subscriber(announced.as_str()).await;
    let heard = heard.expect("an open session");
    let newer = manifest(9, "newer", &random_policy(2)).expect("a good policy");
    let signed = sign(&key(1), &newer);
    let other = secured.join("arm2").await;
    let status = keys::status(LAB, "arm1").expect("good names");
    // On a separate session, because a session hears what it puts itself.
    let listener = secured.join("arm2").await;
    let overheard = listener.declare_subscriber("reagent/v1/lab/**").await;
    let overheard = overheard.expect("an open session");
    for session in [client.session(), &other] {
        let put = session.put(announced.as_str(), signed.clone()).await;
        put.expect("an open session");
        let put = session.put(status.as_str(), vec![1, 2, 3]).await;
        put.expect("an open session");
        let put = session.delete(status.as_str()).await;
        put.expect("an open session");
    }
    // A robot cannot answer for another robot, and cannot ask it.
    let posing = other.declare_queryable(refine.as_str()).complete(true);
    let posing = posing.callback(|query| {
        query.reply_err("mine").wait().expect("an open session");
    });
    let posing = posing.await.expect("an open session");
    let answered = client.refine("arm1", &request(&cloud, &cloud)).await;
    assert!(answered.is_ok(), "{answered:?}");
    drop(posing);
    let frame = vec![wire::VERSION];
    for key in [&refine, &status] {
        let asked = client::ask(&other, key, "arm1", frame.clone(), SILENCE).await;
        let unheard = matches!(
            asked,
            Err(RefineError::Deadline { .. } | RefineError::NoRobot { .. })
        );
        assert!(unheard, "{asked:?}");
    }
    // The trainer may not ask robots, and nobody may use the router's administration.
    let trainer = secured.join("trainer").await;
    let asked = client::ask(&trainer, &refine, "arm1", frame, SILENCE).await;
    assert!(
        !matches!(asked, Err(RefineError::Refused { .. }) | Ok(_)),
        "{asked:?}"
    );
    let administration = trainer.get("@/*/router/**").timeout(SILENCE).await;
    let administration = administration.expect("an open session");
    while let Ok(reply) = administration.recv_async().await {
        assert!(reply.result().is_err(), "{reply:?}");
    }
    // The client's publications came before the answer to its request, so the witness hears the trainer's next.
    let published = publisher.publish(2, "second", random_policy(2)).await;
    let second = published.expect("a good policy");
    let sample = heard.recv_async().await.expect("an open session");
    assert_eq!(&*sample.payload().to_bytes(), sign(&key(1), &second));
    let view = until(&arm1, |view| view.policy.as_ref() == Some(&second)).await;
    assert_eq!(view.updates_refused, 0);
    assert!(!view.duplicate, "nobody else published its status");
    while let Some(sample) = overheard.try_recv().expect("an open session") {
        let key = sample.key_expr().as_str();
        assert!(key == announced.as_str(), "a robot reads {key}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_are_not_let_in() {
    let Some(secured) = Secured::start().await else {
        return;
    };
    let foreign = tempfile::tempdir().expect("a temporary directory");
    assert!(make_ca(foreign.path(), secured.port));
    let text = std::fs::read_to_string(secured.config("client")).expect("readable");
    let (mine, theirs) = (secured.folder.path(), foreign.path());
    let (mine, theirs) = (mine.display().to_string(), theirs.display().to_string());
    let write = |name: &str, text: String| {
        let path = foreign.path().join(name);
        std::fs::write(&path, text).expect("writable");
        path
    };
    // They trust the right router, but have a certificate of another authority, or none.
    let other_authority = text.replace(&format!("{mine}/client"), &format!("{theirs}/client"));
    assert_ne!(other_authority, text);
    let anonymous = text
        .lines()
        .filter(|line| !line.contains("mtls") && !line.contains("connect_"))
        .collect::<Vec<_>>()
        .join("\n");
    // This one has the right certificate, but does not trust the router.
    let other_router = text.replace(&format!("{mine}/ca.pem"), &format!("{theirs}/ca.pem"));
    let plain = SessionArgs {
        connect: vec![format!("quic/127.0.0.1:{}?multistream=0", secured.port)],
        ..SessionArgs::default()
    };
    let by_file = |name, text| SessionArgs {
        zenoh: Some(write(name, text)),
        ..SessionArgs::default()
    };
    let attempts = [
        by_file("other.json5", other_authority),
        by_file("anonymous.json5", anonymous),
        by_file("router.json5", other_router),
        plain,
    ];
    let [a, b, c, d] = attempts.each_ref().map(open);
    let (a, b, c, d) = tokio::join!(a, b, c, d);
    for (attempt, outcome) in attempts.iter().zip([a, b, c, d]) {
        // In TLS 1.3, which QUIC uses, a client may believe itself connected before it learns that it was refused.
        if let Ok(session) = outcome {
            let key = keys::all_status(LAB).expect("a good name");
            let replies = session.get(key.as_str()).timeout(SILENCE).await;
            let Ok(replies) = replies else { continue };
            while let Ok(reply) = replies.recv_async().await {
                assert!(reply.result().is_err(), "{attempt:?}");
            }
        }
    }
    // A client that belongs here is let in.
    secured.join("client").await;
}
