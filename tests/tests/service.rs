//! Robots that answer refine requests, over real Zenoh sessions on loopback.

mod support;

use firmware_sim::client::{self, RefineError};
use firmware_sim::node::{Node, NodeConfig, NodeError, PLACES};
use firmware_sim::policy::Trust;
use firmware_sim::session::{SessionArgs, open, unused_endpoint};
use host_train::register::register;
use reagent_core::pipeline::Task;
use reagent_core::start::Start;
use reagent_core::wire::{
    self, Cloud, CloudView, Fit, Message, Mode, Reason, RefineReply, RefineRequest, Refusal, keys,
};
use reagent_core::{Grid, Pose};
use std::sync::Arc;
use std::time::Duration;
use support::{
    FLEET, Network, local_pose, publisher, random_cloud, random_policy, request, served, until,
};
use zenoh::Session;

/// Longer than anything here takes.
const PATIENCE: Duration = Duration::from_secs(60);

type Points<'a> = &'a [[f32; 3]];

async fn refused(session: &Session, request: &RefineRequest<'_>) -> Reason {
    match client::refine(session, FLEET, "r1", request).await {
        Err(RefineError::Refused { refusal, .. }) => {
            assert_eq!(refusal.id, request.id);
            refusal.reason
        }
        other => panic!("not refused: {other:?}"),
    }
}

/// A runtime limits the threads for blocking work, and one program may hold more robots than that.
#[test]
fn robots_work_however_few_threads_the_runtime_has_for_what_blocks() {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .max_blocking_threads(1)
        .build()
        .expect("a runtime");
    runtime.block_on(async {
        let network = Network::start().await;
        let mut publisher = publisher(&network).await;
        let published = publisher.publish(1, "first", random_policy(1)).await;
        published.expect("a good policy");
        let nodes = [
            network.node(FLEET, "r1").await,
            network.node(FLEET, "r2").await,
        ];
        let session = network.join().await;
        let cloud = random_cloud(1, 16);
        for (node, robot) in nodes.iter().zip(["r1", "r2"]) {
            until(node, |view| view.policy.is_some()).await;
            let answer = client::refine(&session, FLEET, robot, &request(&cloud, &cloud)).await;
            assert!(answer.is_ok(), "{robot}: {answer:?}");
        }
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_published_policy_is_fetched_and_answers_bit_for_bit() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let mut publisher = publisher(&network).await;
    let policy = random_policy(1);
    let shipped = publisher.publish(5, "first", policy.clone());
    let shipped = shipped.await.expect("a good policy");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy, Some(shipped));

    let session = network.join().await;
    let (source, target) = (random_cloud(1, 300), random_cloud(2, 400));
    let initial = Pose::from_rows([[0., -1., 0., 0.5], [1., 0., 0., 0.], [0., 0., 1., -2.]]);
    for initial in [None, Some(initial)] {
        let mut request = request(&source, &target);
        request.initial = initial.map(|pose| pose.to_rows());
        let reply = client::refine(&session, FLEET, "r1", &request).await;
        let reply: RefineReply = reply.expect("a pose");
        let start = initial.unwrap_or(Pose::IDENTITY);
        let expected = local_pose(&policy, &source, &target, start);
        assert_eq!(reply.target_from_source, expected.to_rows());
        assert_ne!(reply.target_from_source, start.to_rows());
        assert_eq!((reply.id, reply.steps, reply.policy_version), (77, 10, 5));
    }
    let view = until(&node, |view| view.served == 2).await;
    assert_eq!((view.refused, view.in_hand), (0, 0));
}

#[tokio::test(flavor = "multi_thread")]
async fn every_bad_request_is_refused_with_its_reason() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let session = network.join().await;
    let refine_key = keys::refine(FLEET, "r1").expect("good names");
    served(&session, &refine_key).await;
    let good = random_cloud(1, 50);
    assert_eq!(
        refused(&session, &request(&good, &good)).await,
        Reason::NoPolicy
    );

    let mut publisher = publisher(&network).await;
    publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;

    let one = &good[..1];
    let same = [[1.5; 3]; 20];
    let many = random_cloud(2, 4097);
    let mut nan = good.clone();
    nan[17][1] = f32::NAN;
    let cases: [(Points<'_>, Points<'_>, Reason); 9] = [
        (&[], &good, Reason::EmptyCloud(Cloud::Source)),
        (&good, &[], Reason::EmptyCloud(Cloud::Target)),
        (one, &good, Reason::TooFewPoints(Cloud::Source, 1)),
        (&good, &good[..2], Reason::TooFewPoints(Cloud::Target, 2)),
        (&many, &good, Reason::TooManyPoints(Cloud::Source, 4097)),
        (&good, &many, Reason::TooManyPoints(Cloud::Target, 4097)),
        // Longer than any request: refused after its first bytes.
        (&many, &many, Reason::TooManyPoints(Cloud::Source, 4097)),
        (&nan, &good, Reason::NotFinite(Cloud::Source, 17)),
        (&good, &same, Reason::BadCloud),
    ];
    for (source, target, expected) in cases {
        assert_eq!(refused(&session, &request(source, target)).await, expected);
    }
    let mut skewed = request(&good, &good);
    skewed.initial = Some([[1.0; 4]; 3]);
    assert_eq!(refused(&session, &skewed).await, Reason::BadPose);

    let mut status = [0; wire::SMALL_FRAME_BYTES];
    let status = wire::encode(&Message::Status(wire::Status::default()), &mut status);
    let frames: [(&[u8], Reason); 4] = [
        (&[], Reason::Malformed),
        (&[wire::VERSION, 2, 0, 0], Reason::Malformed),
        (status.expect("fits"), Reason::Malformed),
        (
            &[wire::VERSION + 1, 2, 0, 0],
            Reason::WrongVersion {
                spoken: wire::VERSION,
            },
        ),
    ];
    for (frame, reason) in frames {
        match client::ask(&session, &refine_key, "r1", frame.to_vec(), PATIENCE).await {
            Err(RefineError::Refused { refusal, .. }) => {
                assert_eq!(refusal, Refusal { id: 0, reason });
            }
            other => panic!("not refused: {other:?}"),
        }
    }
    // After all that the robot still serves.
    let reply = client::refine(&session, FLEET, "r1", &request(&good, &good)).await;
    assert!(reply.is_ok(), "{reply:?}");
    assert_eq!(until(&node, |view| view.served == 1).await.refused, 15);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_queue_is_refused_and_every_request_answered() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    publisher
        .publish(1, "first", random_policy(1))
        .await
        .expect("a good policy");
    let node = network.node(FLEET, "r1").await;
    until(&node, |view| view.policy.is_some()).await;
    let session = network.join().await;
    let cloud: Arc<[[f32; 3]]> = random_cloud(1, 4096).into();
    let requests = 4 * PLACES;
    let mut asking = tokio::task::JoinSet::new();
    for _ in 0..requests {
        let (session, cloud) = (session.clone(), cloud.clone());
        asking.spawn(async move {
            let mut long = request(&cloud, &cloud);
            long.max_steps = 25;
            client::refine(&session, FLEET, "r1", &long)
                .await
                .map(|_| ())
        });
    }
    let (mut poses, mut busy) = (0, 0);
    for answer in asking.join_all().await {
        match answer {
            Ok(()) => poses += 1,
            Err(RefineError::Refused { refusal, .. }) if refusal.reason == Reason::Busy => {
                assert_eq!(refusal.id, 77);
                busy += 1;
            }
            Err(other) => panic!("neither pose nor busy: {other}"),
        }
    }
    // Two places are kept for clients that say who they are.
    assert!(
        poses >= PLACES - 2 && busy > 0,
        "{poses} poses, {busy} busy"
    );
    assert_eq!(poses + busy, requests);
}

#[tokio::test(flavor = "multi_thread")]
async fn clouds_on_a_grid_and_refining_modes_are_served_bit_for_bit() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let mut publisher = publisher(&network).await;
    let policy = random_policy(1);
    let shipped = publisher.publish(1, "first", policy.clone());
    shipped.await.expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;
    let session = network.join().await;

    let (source, target) = (random_cloud(1, 301), random_cloud(2, 400));
    let grid = Grid::of(&source).expect("a good cloud");
    let codes: Vec<_> = source.iter().map(|&p| grid.encode(p)).collect();
    let decoded: Vec<_> = codes.iter().map(|&c| grid.decode(c)).collect();
    assert_ne!(decoded, source);
    let mut on_grid = request(&source, &target);
    on_grid.source = CloudView::on_grid(grid, &codes);
    let reply = client::refine(&session, FLEET, "r1", &on_grid).await;
    let expected = local_pose(&policy, &decoded, &target, Pose::IDENTITY);
    let reply = reply.expect("a pose");
    assert_eq!(reply.target_from_source, expected.to_rows());
    assert_eq!((reply.mode, reply.probability), (Mode::Fast, None));

    let modes = [
        (Mode::Polish, Mode::Polish),
        (Mode::Verify, Mode::Verify),
        (Mode::Best, Mode::Verify),
    ];
    for (asked, here) in modes {
        let mut request = request(&source, &target);
        request.mode = asked;
        let reply = client::refine(&session, FLEET, "r1", &request).await;
        let reply = reply.expect("a pose");
        let task = Task {
            mode: here,
            ..Task::new(Start::at(Pose::IDENTITY))
        };
        let expected = register(policy.policy(), &source, &target, &task);
        let expected = expected.expect("good clouds").answer;
        let rows = expected.target_from_source.to_rows();
        assert_eq!(reply.target_from_source, rows, "{asked}");
        let refined = expected.refinement.expect("it was refined");
        assert_eq!(reply.probability, Some(refined.evidence.probability()));
        assert_eq!(reply.verdict, expected.verdict);
        assert_eq!(reply.fit, Some(Fit::of(&refined)));
        let done = if asked == Mode::Polish {
            asked
        } else {
            Mode::Verify
        };
        assert_eq!((reply.mode, reply.steps), (done, 10));
    }
    let view = until(&node, |view| view.served == 4).await;
    assert_eq!(view.verdicts.iter().sum::<u32>(), 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_robot_of_the_same_name_is_noticed() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let config = || NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let second = Node::start(network.join().await, config()).await;
    let error = second.expect_err("the name is taken");
    assert!(matches!(error, NodeError::Duplicate { .. }), "{error}");
    assert!(error.to_string().contains("r1"), "{error}");

    // A robot that was out of reach when it started.
    let foreign = wire::Status {
        instance: 1,
        ..wire::Status::default()
    };
    let mut frame = [0; wire::SMALL_FRAME_BYTES];
    let frame = wire::encode(&Message::Status(foreign), &mut frame).expect("fits");
    let key = keys::status(FLEET, "r1").expect("good names");
    assert!(!node.watch().borrow().duplicate);
    let session = network.join().await;
    let put = session.put(key.as_str(), frame.to_vec()).await;
    put.expect("an open session");
    until(&node, |view| view.duplicate).await;

    node.stop().await;
    let after = Node::start(network.join().await, config()).await;
    assert!(after.is_ok(), "{after:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_at_the_key_is_said_at_once() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let session = network.join().await;
    let cloud = random_cloud(1, 10);
    for (fleet, robot) in [(FLEET, "r2"), ("other", "r1")] {
        let asked = std::time::Instant::now();
        let error = client::refine(&session, fleet, robot, &request(&cloud, &cloud)).await;
        let error = error.expect_err("there is no such robot").to_string();
        let key = keys::refine(fleet, robot).expect("good names");
        assert!(
            error.contains(&format!("no robot answered at {key}")),
            "{error}"
        );
        assert!(asked.elapsed() < PATIENCE / 2);
    }
    drop(node);
    let gone = client::refine(&session, FLEET, "r1", &request(&cloud, &cloud)).await;
    assert!(matches!(gone, Err(RefineError::NoRobot { .. })), "{gone:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn no_router_at_the_endpoint_is_an_error_that_names_it() {
    let endpoint = unused_endpoint().expect("a free port");
    let args = SessionArgs {
        connect: vec![endpoint.clone()],
        ..SessionArgs::default()
    };
    let error = open(&args)
        .await
        .expect_err("nothing listens there")
        .to_string();
    assert!(error.contains(&endpoint), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn names_that_cannot_be_keys_are_refused() {
    let network = Network::start().await;
    for (fleet, robot) in [("a/b", "r1"), ("f", "*"), ("", "r1"), ("f", "")] {
        let config = NodeConfig {
            fleet: fleet.into(),
            robot: robot.into(),
            trust: Trust::AnyKey,
            state: None,
        };
        let node = Node::start(network.router.clone(), config).await;
        assert!(
            matches!(node, Err(NodeError::Name { .. })),
            "{fleet} {robot}"
        );
    }
    let config = NodeConfig {
        fleet: "f".into(),
        robot: "any".into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let node = Node::start(network.router.clone(), config).await;
    assert!(matches!(node, Err(NodeError::Reserved)));
}
