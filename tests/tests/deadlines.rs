//! Requests that run out of time, are cancelled, or go to the robot that has the least to do.

mod support;

use firmware_sim::client::{self, Client, RefineError};
use firmware_sim::node::Node;
use reagent_core::wire;
use reagent_core::wire::{Message, Reason, RefineReply, RefineRequest, keys};
use std::sync::Arc;
use support::{FLEET, Network, publisher, random_cloud, random_policy, request, until};
use tokio::task::JoinHandle;
use zenoh::Wait;
use zenoh::sample::SourceInfo;

type Answer = Result<RefineReply, RefineError>;

/// A fleet of these robots, each with a policy.
async fn fleet(network: &Network, robots: &[&str]) -> Vec<Node> {
    let mut publisher = publisher(network).await;
    let published = publisher.publish(1, "first", random_policy(1)).await;
    published.expect("a good policy");
    let mut nodes = Vec::new();
    for robot in robots {
        let node = network.node(FLEET, robot).await;
        until(&node, |view| view.policy.is_some()).await;
        nodes.push(node);
    }
    nodes
}

async fn client(network: &Network) -> Arc<Client> {
    let client = Client::new(network.join().await, FLEET).await;
    Arc::new(client.expect("a good name"))
}

/// A request that occupies a robot for seconds.
fn long(cloud: &[[f32; 3]]) -> RefineRequest<'_> {
    RefineRequest {
        max_steps: 255,
        ..request(cloud, cloud)
    }
}

/// Sends a robot a request that takes long.
fn occupy(client: &Arc<Client>, robot: &'static str, id: u64) -> JoinHandle<Answer> {
    let client = client.clone();
    tokio::spawn(async move {
        let cloud = random_cloud(1, 4096);
        let request = RefineRequest { id, ..long(&cloud) };
        client.refine(robot, &request).await
    })
}

fn is_refused(answer: &Answer, reason: Reason) -> bool {
    matches!(answer, Err(RefineError::Refused { refusal, .. }) if refusal.reason == reason)
}

#[tokio::test(flavor = "multi_thread")]
async fn deadlines_hold_at_work_and_in_the_queue() {
    let network = Network::start().await;
    let nodes = fleet(&network, &["r1"]).await;
    let client = client(&network).await;
    let cloud = random_cloud(1, 4096);
    let short = RefineRequest {
        budget_ms: 100,
        ..long(&cloud)
    };
    let answer = client.refine("r1", &short).await;
    assert!(is_refused(&answer, Reason::Deadline), "{answer:?}");
    let none = RefineRequest {
        budget_ms: 0,
        ..long(&cloud)
    };
    let answer = client.refine("r1", &none).await;
    assert!(is_refused(&answer, Reason::Deadline), "{answer:?}");

    // A request behind one that takes long is answered in time, while the first goes on.
    let first = occupy(&client, "r1", 1);
    until(&nodes[0], |view| view.in_hand == 1).await;
    let waiting = RefineRequest {
        budget_ms: 50,
        ..request(&cloud[..20], &cloud[..20])
    };
    let answer = client.refine("r1", &waiting).await;
    assert!(is_refused(&answer, Reason::Deadline), "{answer:?}");
    let view = until(&nodes[0], |view| view.refused == 3).await;
    assert_eq!((view.in_hand, view.served), (1, 0));
    first.abort();
    until(&nodes[0], |view| view.taken_back == 1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_that_nobody_waits_for_free_their_places() {
    let network = Network::start().await;
    // This client was there before the robot.
    let leaving = client(&network).await;
    let nodes = fleet(&network, &["r1"]).await;
    let staying = client(&network).await;
    let cloud = random_cloud(1, 20);

    // A client that is still there gives up one request at work and one in the queue.
    let asked: Vec<_> = (1..=2).map(|id| occupy(&leaving, "r1", id)).collect();
    until(&nodes[0], |view| view.in_hand == 2).await;
    asked.iter().for_each(JoinHandle::abort);
    let view = until(&nodes[0], |view| view.in_hand == 0).await;
    assert_eq!((view.taken_back, view.served, view.refused), (2, 0, 0));

    // A client dies with its session.
    for id in 3..=5 {
        occupy(&leaving, "r1", id);
    }
    until(&nodes[0], |view| view.in_hand == 3).await;
    leaving.session().close().await.expect("an open session");
    let view = until(&nodes[0], |view| view.in_hand == 0).await;
    assert_eq!((view.taken_back, view.served), (5, 0));
    let answer = staying.refine("r1", &request(&cloud, &cloud)).await;
    assert!(answer.is_ok(), "{answer:?}");

    // Neither the cancellation of something else nor rubbish changes anything.
    let last = occupy(&staying, "r1", 6);
    until(&nodes[0], |view| view.in_hand == 1).await;
    let key = keys::cancel(FLEET, "r1").expect("good names");
    let mut frame = [0; wire::SMALL_FRAME_BYTES];
    let cancel = wire::Cancel { client: 5, id: 6 };
    let frame = wire::encode(&Message::Cancel(cancel), &mut frame).expect("fits");
    for payload in [frame, &[1, 2, 3]] {
        let put = staying.session().put(key.as_str(), payload.to_vec()).await;
        put.expect("an open session");
    }
    last.abort();
    let view = until(&nodes[0], |view| view.in_hand == 0).await;
    assert_eq!((view.taken_back, view.served), (6, 1));
}

#[tokio::test(flavor = "multi_thread")]
async fn one_client_does_not_shut_out_the_others() {
    let network = Network::start().await;
    let nodes = fleet(&network, &["r1"]).await;
    let (greedy, other) = (client(&network).await, client(&network).await);
    let first = occupy(&greedy, "r1", 1);
    until(&nodes[0], |view| view.in_hand == 1).await;
    let more: Vec<_> = (2..=9).map(|id| occupy(&greedy, "r1", id)).collect();
    let view = until(&nodes[0], |view| view.refused == 5).await;
    assert_eq!(view.in_hand, 4);
    // There is a place left for another client that says who it is.
    let cloud = random_cloud(1, 20);
    let session = greedy.session();
    let unsaid = client::refine(session, FLEET, "r1", &request(&cloud, &cloud)).await;
    assert!(is_refused(&unsaid, Reason::Busy), "{unsaid:?}");
    let modest = occupy(&other, "r1", 1);
    until(&nodes[0], |view| view.in_hand == 5).await;
    for asked in more.into_iter().chain([first, modest]) {
        asked.abort();
    }
    until(&nodes[0], |view| view.in_hand == 0).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_that_do_not_say_whose_they_are_leave_a_place_for_others() {
    let network = Network::start().await;
    let nodes = fleet(&network, &["r1"]).await;
    let (session, other) = (network.join().await, client(&network).await);
    let cloud = random_cloud(1, 4096);
    let mut asked = Vec::new();
    for id in 1..=8 {
        // Some requests carry no client number, others one number each.
        let (session, cloud) = (session.clone(), cloud.clone());
        asked.push(tokio::spawn(async move {
            let request = RefineRequest {
                id,
                client: id / 4 * id,
                ..long(&cloud)
            };
            client::refine(&session, FLEET, "r1", &request).await
        }));
    }
    let view = until(&nodes[0], |view| view.refused == 5).await;
    assert_eq!(view.in_hand, 3);
    // All of them may belong to one session, which thus gets one more place, and leaves one.
    let first = occupy(&other, "r1", 1);
    until(&nodes[0], |view| view.in_hand == 4).await;
    let second = occupy(&other, "r1", 2).await.expect("it ends");
    assert!(is_refused(&second, Reason::Busy), "{second:?}");
    let modest = occupy(&client(&network).await, "r1", 1);
    until(&nodes[0], |view| view.in_hand == 5).await;
    [first, modest].iter().for_each(JoinHandle::abort);
    until(&nodes[0], |view| view.taken_back == 2).await;
    asked.iter().for_each(JoinHandle::abort);
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_takes_back_the_request_of_another_session() {
    let network = Network::start().await;
    let nodes = fleet(&network, &["r1"]).await;
    let stranger = network.join().await;
    // Whoever may see liveliness tokens learns the victim's client number.
    let tokens = keys::all_clients_alive(FLEET).expect("a good name");
    let tokens = stranger.liveliness().declare_subscriber(tokens.as_str());
    // The router may hear of the client first.
    let tokens = tokens.history(true).await.expect("an open session");
    let victim = client(&network).await;
    let token = tokens.recv_async().await.expect("an open session");
    let number = keys::client_of(token.key_expr().as_str()).expect("a client");
    let asked = occupy(&victim, "r1", 6);
    until(&nodes[0], |view| view.in_hand == 1).await;

    let key = keys::cancel(FLEET, "r1").expect("good names");
    let cancel = wire::Cancel {
        client: number,
        id: 6,
    };
    let mut frame = [0; wire::SMALL_FRAME_BYTES];
    let frame = wire::encode(&Message::Cancel(cancel), &mut frame).expect("fits");
    let publisher = stranger.declare_publisher(key.as_str().to_owned()).await;
    let publisher = publisher.expect("an open session");
    let own = SourceInfo::new(publisher.id(), 0);
    for source in [None, Some(own)] {
        let put = publisher.put(frame.to_vec()).source_info(source).await;
        put.expect("an open session");
    }
    // Requests of a session without a token, such as older clients sent under a number, belong to no other session.
    let unsaid = network.join().await;
    let source = unsaid.declare_publisher(key.as_str().to_owned()).await;
    let source = SourceInfo::new(source.expect("an open session").id(), 0);
    let cloud = random_cloud(1, 4096);
    let request = RefineRequest {
        client: number ^ 1,
        ..long(&cloud)
    };
    let mut bytes = vec![0; wire::REQUEST_OVERHEAD_BYTES + 24 * cloud.len()];
    let bytes = wire::encode(&Message::RefineRequest(request), &mut bytes).expect("it fits");
    let refine = keys::refine(FLEET, "r1").expect("good names");
    let query = unsaid.get(refine.as_str()).payload(bytes.to_vec());
    let _answer = query.source_info(source).await.expect("an open session");
    until(&nodes[0], |view| view.in_hand == 2).await;
    let guessed = keys::client_alive(FLEET, number ^ 1).expect("a good name");
    let posing = stranger.liveliness().declare_token(guessed.as_str()).await;
    drop(posing.expect("an open session"));
    // Its own token, and others that spell the number differently.
    let alive = token.key_expr().as_str();
    let digits = format!("{number:016x}");
    let spelled = |other: String| alive.replace(&digits, &other);
    let others = [
        format!("0{number:016x}"),
        format!("+{number:x}"),
        format!("{number:016X}"),
    ];
    for posing in std::iter::once(alive.to_owned()).chain(others.map(spelled)) {
        let posing = stranger.liveliness().declare_token(posing).await;
        drop(posing.expect("an open session"));
    }
    // The robot has seen everything that came before this.
    let time = std::time::Duration::from_secs(60);
    let answer = client::ask(&stranger, &refine, "r1", vec![0], time).await;
    assert!(
        matches!(answer, Err(RefineError::Refused { .. })),
        "{answer:?}"
    );
    let view = nodes[0].watch().borrow().clone();
    assert_eq!((view.in_hand, view.taken_back), (2, 0));
    asked.abort();
    until(&nodes[0], |view| view.taken_back == 1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_carry_the_number_of_their_sessions_token() {
    // An older robot tells clients apart by that number alone.
    let network = Network::start().await;
    let robot = network.join().await;
    let key = keys::refine(FLEET, "before").expect("good names");
    let queries = robot.declare_queryable(key.as_str()).await;
    let queries = queries.expect("an open session");
    let tokens = keys::all_clients_alive(FLEET).expect("a good name");
    let tokens = robot.liveliness().declare_subscriber(tokens.as_str());
    let tokens = tokens.history(true).await.expect("an open session");
    let asked = occupy(&client(&network).await, "before", 1);
    let token = tokens.recv_async().await.expect("an open session");
    let query = queries.recv_async().await.expect("an open session");
    let payload = query.payload().expect("a request").to_bytes();
    let Ok(Message::RefineRequest(request)) = wire::decode(&payload) else {
        panic!("{payload:?}");
    };
    let number = keys::client_of(token.key_expr().as_str());
    assert_eq!(number, Some(request.client));
    asked.abort();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_never_answers_costs_the_deadline_and_no_more() {
    let network = Network::start().await;
    let session = network.join().await;
    let key = keys::refine(FLEET, "deaf").expect("good names");
    let queries = session.declare_queryable(key.as_str()).await;
    let queries = queries.expect("an open session");
    let cloud = random_cloud(1, 20);
    let mut request = request(&cloud, &cloud);
    request.budget_ms = 1;
    let answer = client::refine(&session, FLEET, "deaf", &request).await;
    assert!(
        matches!(answer, Err(RefineError::Deadline { .. })),
        "{answer:?}"
    );
    assert!(queries.try_recv().expect("an open session").is_some());
}

#[tokio::test(flavor = "multi_thread")]
async fn any_robot_is_the_one_with_the_least_to_do() {
    let network = Network::start().await;
    let operator = client(&network).await;
    let cloud = random_cloud(1, 20);
    let small = request(&cloud, &cloud);
    let brief = RefineRequest {
        budget_ms: 1,
        ..small
    };
    let nobody = operator.refine_any(&brief).await;
    assert!(
        matches!(nobody, Err(RefineError::NoRobot { .. })),
        "{nobody:?}"
    );

    let nodes = fleet(&network, &["a", "b"]).await;
    let least = async || {
        let newcomer = client(&network).await;
        let (robot, _) = newcomer.refine_any(&small).await.expect("a pose");
        robot
    };
    // Nobody has anything to do, so the one that has served less is asked.
    assert_eq!(least().await, "a");
    until(&nodes[0], |view| view.served == 1).await;
    assert_eq!(least().await, "b");
    until(&nodes[1], |view| view.served == 1).await;
    // Now one robot is at work.
    let busy = occupy(&operator, "a", 1);
    until(&nodes[0], |view| view.in_hand == 1).await;
    assert_eq!(least().await, "b");

    // A robot that claims to have nothing to do, but is not there: the next one is asked.
    let idle = nodes[1].watch().borrow().status();
    let idle = wire::Status { served: 0, ..idle };
    let mut frame = [0; wire::SMALL_FRAME_BYTES];
    let frame = wire::encode(&Message::Status(idle), &mut frame).expect("fits");
    let (frame, key) = (
        frame.to_vec(),
        keys::status(FLEET, "0").expect("good names"),
    );
    let ghost = client(&network).await;
    let claim = ghost.session().declare_queryable(key.as_str());
    let answered = key.clone();
    let claim = claim.callback(move |query| {
        query
            .reply(answered.as_str(), frame.clone())
            .wait()
            .expect("an open session");
    });
    let claim = claim.await.expect("an open session");
    let (robot, _) = ghost.refine_any(&small).await.expect("a pose");
    assert_eq!(robot, "b");
    drop(claim);
    busy.abort();
}
