//! The image for microcontrollers, in QEMU: it computes the host's bits, and no bytes on its line can stop it.

#[path = "firmware/bits.rs"]
mod bits;
#[path = "firmware/boards.rs"]
mod boards;
#[path = "firmware/c.rs"]
mod c;
#[path = "firmware/flash.rs"]
mod flash;
#[path = "firmware/image.rs"]
mod image;
#[path = "firmware/life.rs"]
mod life;
#[path = "firmware/refinement.rs"]
mod refinement;
mod support;

use bits::{bits, trajectory};
use boards::{images, on_boards, on_boards_for, on_boards_with};
use firmware_sim::board::{Board, BoardError, Simulation, check_simulator};
use firmware_sim::client::{self, Client, RefineError};
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use host_train::dataset::procedural;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::protocol::{self, Protocol};
use host_train::publish;
use host_train::random::{Purpose, Rng, stream};
use host_train::register::replay::replay;
use rand::RngExt;
use reagent_core::kernels::Isa;
use reagent_core::wire::serial::{self, line_bytes};
use reagent_core::wire::{
    self, Chunk, Cloud, CloudView, Manifest, Message, Reason, RefineRequest, Refusal, keys,
};
use std::ops::ControlFlow;
use std::sync::LazyLock;
use support::{FLEET, Network, publisher, request as request_to, served, until};

/// The bundled policy in 8-bit integers.
static POLICY: LazyLock<WeightFile> = LazyLock::new(|| {
    let parameters = WeightFile::pretrained().parameters(0).expect("f32");
    let models = procedural::models(1, 24);
    let calibration = protocol::draw(&models, Protocol::M40Models, 24, 1);
    WeightFile::from_parameters_int8(&parameters, &calibration).expect("deployable")
});

/// A small policy for what goes over the line, because its transfer takes as long as it has bytes.
static COMPACT: LazyLock<WeightFile> = LazyLock::new(|| {
    let models = procedural::models(2, 8);
    let calibration = protocol::draw(&models, Protocol::M40Models, 8, 2);
    let untrained = Parameters::random(Shape::COMPACT, 3);
    WeightFile::from_parameters_int8(&untrained, &calibration).expect("deployable")
});

fn manifest_of(file: &WeightFile, version: u64) -> Manifest {
    publish::manifest(version, "test", file).expect("a short name")
}

fn request(id: u64, max_steps: u8, source: &[[f32; 3]], target: &[[f32; 3]]) -> Vec<u8> {
    request_of(id, max_steps, CloudView::of(source), CloudView::of(target))
}

fn request_of(id: u64, max_steps: u8, source: CloudView<'_>, target: CloudView<'_>) -> Vec<u8> {
    let request = RefineRequest {
        max_steps,
        budget_ms: u32::MAX,
        ..RefineRequest::new(id, source, target)
    };
    frame_of(request)
}

fn frame_of(request: RefineRequest<'_>) -> Vec<u8> {
    let mut buffer = vec![0; wire::REQUEST_BYTES];
    let frame = wire::encode(&Message::RefineRequest(request), &mut buffer);
    frame.expect("it fits").to_vec()
}

fn line(frame: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(line_bytes(frame.len()));
    serial::write(frame, |byte| bytes.push(byte));
    bytes
}

fn cloud(rng: &mut Rng, points: usize) -> Vec<[f32; 3]> {
    let point = |_| [(); 3].map(|()| rng.random_range(-1.0f32..1.0));
    (0..points).map(point).collect()
}

fn refusal(board: &mut Board) -> Refusal {
    let pick = |message: Message<'_>| match message {
        Message::Refusal(refusal) => Some(refusal),
        Message::RefineReply(_) => panic!("a reply where a refusal was expected"),
        _ => None,
    };
    board.wait_for(pick).expect("it runs")
}

/// Checks that a request is answered with the right steps, whatever came before.
fn still_answers(file: &WeightFile, board: &mut Board, id: u64) {
    let mut rng: Rng = stream(id, Purpose::Shape, 0);
    let (source, target) = (cloud(&mut rng, 12), cloud(&mut rng, 9));
    let frame = request(id, 2, &source, &target);
    board.send_frame(&frame).expect("it runs");
    let reply = board
        .wait_for(|message| match message {
            Message::RefineReply(reply) if reply.id == id => Some(reply),
            _ => None,
        })
        .expect("it answers");
    let expected =
        &trajectory(file, Isa::best(), &source, &target)[1.min(usize::from(reply.steps) - 1)];
    assert_eq!(bits(reply.target_from_source), expected.1);
}

#[test]
fn bad_requests_are_refused_by_name() {
    on_boards(true, |_, mut board| {
        board.status_and_report().expect("it runs");
        let mut rng: Rng = stream(3, Purpose::Shape, 0);
        let good = cloud(&mut rng, 8);
        let mut infinite = good.clone();
        infinite[3][1] = f32::INFINITY;
        let large = cloud(&mut rng, 3000);
        let cases = [
            (request(1, 2, &[], &good), Reason::EmptyCloud(Cloud::Source)),
            (
                request(2, 2, &good, &good[..2]),
                Reason::TooFewPoints(Cloud::Target, 2),
            ),
            (
                request(3, 2, &infinite, &good),
                Reason::NotFinite(Cloud::Source, 3),
            ),
            (request(4, 2, &good, &[[1.0; 3]; 5]), Reason::BadCloud),
            (
                request(5, 2, &large, &good),
                Reason::TooManyPoints(Cloud::Source, 3000),
            ),
            (
                request(6, 2, &good, &large),
                Reason::TooManyPoints(Cloud::Target, 3000),
            ),
            (
                frame_of(RefineRequest {
                    view_point: Some([0.0; 3]),
                    background: CloudView::of(&large),
                    ..RefineRequest::new(7, CloudView::of(&good), CloudView::of(&good))
                }),
                Reason::TooManyPoints(Cloud::Background, 3000),
            ),
        ];
        for (i, (frame, reason)) in cases.iter().enumerate() {
            board.send_frame(frame).expect("it runs");
            let expected = Refusal {
                id: 1 + i as u64,
                reason: *reason,
            };
            assert_eq!(refusal(&mut board), expected);
        }
        let malformed = |reason| Refusal { id: 0, reason };
        let whole = request(7, 2, &good, &good);
        for frame in [
            &whole[..40],
            &[wire::VERSION, 99],
            &[wire::VERSION, 5, 0, 3, 1, 2],
            &[],
        ] {
            board.send_frame(frame).expect("it runs");
            assert_eq!(refusal(&mut board), malformed(Reason::Malformed));
        }
        board.send_frame(&[wire::VERSION + 1, 9]).expect("it runs");
        let spoken = wire::VERSION;
        assert_eq!(
            refusal(&mut board),
            malformed(Reason::WrongVersion { spoken })
        );

        // A frame that loses its end, and one that another frame interrupts.
        let bytes = line(&whole);
        board
            .send_bytes(&bytes[..bytes.len() / 2])
            .expect("it runs");
        board.send_bytes(&[0]).expect("it runs");
        assert_eq!(refusal(&mut board), malformed(Reason::Malformed));
        let inner = line(&request(8, 1, &good, &[]));
        board.send_bytes(&bytes[..30]).expect("it runs");
        board
            .send_bytes(&[&[0][..], &inner, &bytes[30..]].concat())
            .expect("it runs");
        assert_eq!(refusal(&mut board), malformed(Reason::Malformed));
        let empty = Reason::EmptyCloud(Cloud::Target);
        assert_eq!(
            refusal(&mut board),
            Refusal {
                id: 8,
                reason: empty
            }
        );
        assert_eq!(refusal(&mut board), malformed(Reason::Malformed));

        // While it works, a second request is refused with that request's id; a third may come too late for that.
        let requests = [
            request(20, 2, &large[..200], &large[..200]),
            request(21, 1, &good, &good),
            request(22, 1, &large, &large),
        ];
        let lines = requests.map(|frame| line(&frame)).concat();
        board.send_bytes(&lines).expect("it runs");
        for id in [21, 22] {
            let refused = |message: Message<'_>| match message {
                Message::Refusal(refusal) => Some(refusal),
                _ => None,
            };
            let refused = board.wait_for(refused).expect("it runs");
            let reason = refused.reason;
            assert_eq!(refused.id, id);
            let large = Reason::TooManyPoints(Cloud::Source, 3000);
            assert!(reason == Reason::Busy || id == 22 && reason == large);
        }
        still_answers(&POLICY, &mut board, 30);
    });
}

#[test]
fn a_request_that_is_taken_back_ends() {
    on_boards(true, |_, mut board| {
        board.status_and_report().expect("it runs");
        let cloud = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut steps = 0;
        let ended = board.refine(&request(1, 255, &cloud, &cloud), |_| {
            steps += 1;
            ControlFlow::Break(())
        });
        let reason = Reason::TakenBack;
        let ended = ended.expect("it runs");
        assert_eq!(ended, Err(Refusal { id: 1, reason }));
        assert!(steps < 255, "{steps}");
        // Nothing is left of it on the line.
        still_answers(&POLICY, &mut board, 50);
    });
}

#[test]
fn a_million_random_bytes_leave_it_answering() {
    const BYTES: usize = 1_000_000;
    on_boards(true, |kind, mut board| {
        board.status_and_report().expect("it runs");
        let mut rng: Rng = stream(kind as u64, Purpose::Shape, 1);
        let mut sent = 0;
        while sent < BYTES {
            // Some runs have no zeros, so that there are long frames as well as short ones.
            let low = u8::from(rng.random_bool(0.3));
            let length = rng.random_range(1..40_000).min(BYTES - sent);
            let bytes: Vec<u8> = (0..length).map(|_| rng.random_range(low..=255)).collect();
            board.send_bytes(&bytes).expect("it runs");
            sent += length;
        }
        board.send_bytes(&[0]).expect("it runs");
        still_answers(&POLICY, &mut board, 40);
        let (status, _) = board.ask().expect("it runs");
        assert_eq!(
            (status.served, status.policy.map(|p| p.version)),
            (1, Some(5))
        );
        assert!(status.refused > 100, "{}", status.refused);
    });
}

#[test]
fn a_policy_comes_over_the_line_and_counts_when_it_is_whole() {
    on_boards(false, |_, mut board| {
        let (status, _) = board.status_and_report().expect("it runs");
        assert_eq!(status.policy, None);
        let target = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let frame = request(1, 1, &target, &target);
        let refused = board
            .refine(&frame, |_| ControlFlow::Continue(()))
            .expect("it runs");
        let reason = Reason::NoPolicy;
        assert_eq!(refused, Err(Refusal { id: 1, reason }));

        // One bit of the file is wrong, one chunk is missing, or the file is too large.
        let mut damaged = COMPACT.bytes().to_vec();
        damaged[100_000] ^= 1;
        assert!(matches!(
            board.load(&manifest_of(&COMPACT, 6), &damaged),
            Err(BoardError::PolicyUnfit {
                reason: Reason::PolicyDamaged
            })
        ));
        board
            .send(&Message::Manifest(manifest_of(&COMPACT, 6)))
            .expect("it runs");
        let bytes = &COMPACT.bytes()[8 * 1024..][..8 * 1024];
        board
            .send(&Message::Chunk(Chunk { index: 1, bytes }))
            .expect("it runs");
        assert_eq!(refusal(&mut board).reason, Reason::Malformed);
        let float = WeightFile::pretrained();
        let large = manifest_of(&float, 6);
        assert!(matches!(
            board.load(&large, float.bytes()),
            Err(BoardError::PolicyRefused { .. })
        ));

        board
            .load(&manifest_of(&COMPACT, 7), COMPACT.bytes())
            .expect("it is whole");
        let (status, _) = board.ask().expect("it runs");
        let policy = status.policy.expect("it counts");
        assert_eq!((policy.version, policy.sha256), (7, COMPACT.sha256()));
        still_answers(&COMPACT, &mut board, 50);
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_board_serves_a_fleet() {
    if let Err(error) = check_simulator() {
        return eprintln!("skipped: {error}");
    }
    let Some((kind, image)) = images().into_iter().next() else {
        return;
    };
    let board = Board::start(kind, &image, Simulation::default()).expect("QEMU starts");
    let network = Network::start().await;
    let config = NodeConfig {
        fleet: FLEET.into(),
        robot: "board".into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let node = Node::start_with(network.join().await, config, Some(board));
    let node = node.await.expect("good names");
    let client = network.join().await;
    let key = keys::trace(FLEET, "board").expect("good names");
    let traces = client.declare_subscriber(key.as_str()).await;
    let traces = traces.expect("an open session");
    let mut rng: Rng = stream(5, Purpose::Shape, 0);
    let (source, target) = (cloud(&mut rng, 20), cloud(&mut rng, 30));
    // A simulated line is slower when the machine has other work to do.
    let request = RefineRequest {
        budget_ms: u32::MAX,
        trace: true,
        ..request_to(&source, &target)
    };
    let refine = keys::refine(FLEET, "board").expect("good names");
    served(&client, &refine).await;
    let early = client::refine(&client, FLEET, "board", &request).await;
    let no_policy = Reason::NoPolicy;
    assert!(
        matches!(early, Err(RefineError::Refused { refusal, .. }) if refusal.reason == no_policy)
    );

    let mut publisher = publisher(&network).await;
    let published = publisher.publish(3, "int8", COMPACT.clone());
    published.await.expect("it is announced");
    until(&node, |view| view.policy.is_some()).await;
    let reply = client::refine(&client, FLEET, "board", &request).await;
    let reply = reply.expect("a pose");
    let expected = trajectory(&COMPACT, Isa::best(), &source, &target);
    let last = expected.last().expect("steps").1;
    assert_eq!(
        (bits(reply.target_from_source), reply.policy_version),
        (last, 3)
    );
    // What the board did is replayed here.
    let trace = traces.recv_async().await.expect("an open session");
    let again = replay(
        &line(&trace.payload().to_bytes()),
        std::slice::from_ref(&*COMPACT),
    );
    let again = &again.expect("a trace")[0];
    assert_eq!((again.steps, &again.difference), (expected.len(), &None));

    // A request that nobody waits for any more ends on the board, too.
    let leaving = Client::new(network.join().await, FLEET).await;
    let leaving = leaving.expect("a good name");
    let long = RefineRequest {
        max_steps: 255,
        ..request
    };
    tokio::select! {
        answer = leaving.refine("board", &long) => panic!("{answer:?}"),
        _ = until(&node, |view| view.in_hand == 1) => {}
    }
    let view = until(&node, |view| view.in_hand == 0).await;
    assert_eq!((view.taken_back, view.served), (1, 1));

    // Its flash has no room for this policy, so it keeps the one it has, and says why.
    let float = publisher.publish(4, "f32", WeightFile::pretrained());
    float.await.expect("it is announced");
    let view = until(&node, |view| view.updates_refused == 1).await;
    let refusal = view.last_refusal.expect("there is a reason").to_string();
    assert!(refusal.contains("--format int8"), "{refusal}");
    assert_eq!(view.policy.map(|policy| policy.version), Some(3));
}
