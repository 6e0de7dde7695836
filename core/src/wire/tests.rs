use super::*;
use crate::grid::Grid;
use crate::steps::Action;
use crate::verdict::Verdict;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

fn bytes_of(message: &Message<'_>) -> Vec<u8> {
    let mut buffer = vec![0; REQUEST_BYTES];
    encode(message, &mut buffer).expect("fits").to_vec()
}

fn manifest() -> Manifest {
    Manifest {
        sha256: [0xab; 32],
        length: 300,
        chunk_length: 128,
        table_sha256: [0xcd; 32],
        epoch: 2,
        version: 1_000,
        reach: 128,
        file_version: 1,
        number_format: 0,
        shape: [1, 2, 3, 4, 5, 6, 7, 200],
        name: PolicyName::try_from("v1").expect("fits"),
        training_sha256: [3; 32],
        evaluation_sha256: [4; 32],
        golden: [Action::STOP, golden()].into_iter().collect(),
    }
}

fn golden() -> Action {
    Action {
        translation: [0, 1, 2],
        rotation: [8, 9, 10],
    }
}

#[test]
fn manifest_is_these_bytes() {
    let mut expected = vec![4, 0];
    expected.extend([0xab; 32]);
    expected.extend([0xac, 0x02]); // 300 as a varint
    expected.extend([0x80, 0x01]); // 128
    expected.extend([0xcd; 32]);
    expected.extend([2, 0xe8, 0x07]); // 1000 of epoch 2
    expected.extend([0x80, 0x01, 1, 0]);
    expected.extend([1, 2, 3, 4, 5, 6, 7, 0xc8, 0x01]);
    expected.extend([2, b'v', b'1']);
    expected.extend([[3; 32], [4; 32]].concat());
    expected.extend([2, 5, 5, 5, 5, 5, 5, 0, 1, 2, 8, 9, 10]);
    assert_eq!(bytes_of(&Message::Manifest(manifest())), expected);
}

#[test]
fn signed_manifest_is_these_bytes() {
    let signed = SignedManifest {
        manifest: &[4, 0, 9],
        public_key: [7; 32],
        signature: [[8; 32], [9; 32]],
    };
    let mut expected = vec![4, 1, 3, 4, 0, 9];
    expected.extend([[7; 32], [8; 32], [9; 32]].concat());
    let bytes = bytes_of(&Message::SignedManifest(signed));
    assert_eq!(bytes, expected);
    assert_eq!(decode(&bytes), Ok(Message::SignedManifest(signed)));
}

#[test]
fn request_is_these_bytes() {
    let (source, target) = ([[1.0, -2.0, 0.5]], []);
    let mut request = RefineRequest::new(5, CloudView::of(&source), CloudView::of(&target));
    let mut expected = vec![6, 2, 5, 0, 0x90, 0x4e, 3, 10, 0, 0, 0, 0];
    let cloud = [0, 12, 0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0, 0x3f];
    expected.extend(cloud);
    expected.extend([0, 0]);
    assert_eq!(bytes_of(&Message::RefineRequest(request)), expected);

    request.client = 300;
    request.budget_ms = 20;
    request.mode = Mode::Verify;
    request.trace = true;
    request.initial = Some([[1.0; 4]; 3]);
    request.anywhere = true;
    request.view_point = Some([1.0; 3]);
    let grid = Grid {
        origin: [0.5, 0.0, 1.0],
        step: 0.125,
    };
    request.target = CloudView::on_grid(grid, &[[1, -2, 300]]);
    let mut expected = vec![6, 2, 5, 0xac, 2, 20, 2, 10, 1, 1];
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    expected.extend([1, 1]);
    expected.extend([0, 0, 0x80, 0x3f].repeat(3));
    expected.extend(cloud);
    expected.extend([
        1, 0, 0, 0, 0x3f, 0, 0, 0, 0, 0, 0, 0x80, 0x3f, 0, 0, 0, 0x3e,
    ]);
    expected.extend([6, 1, 0, 0xfe, 0xff, 0x2c, 0x01]);
    let bytes = bytes_of(&Message::RefineRequest(request));
    assert_eq!(bytes, expected);
    let Ok(Message::RefineRequest(read)) = decode(&bytes) else {
        panic!("it is a request");
    };
    assert_eq!(read, request);
    let points: Vec<_> = read.target.iter().collect();
    assert_eq!(points, [[0.625, -0.25, 38.5]]);
}

#[test]
fn reply_is_these_bytes() {
    let reply = RefineReply {
        id: 1,
        target_from_source: [[1.0; 4]; 3],
        ..reply()
    };
    let mut expected = vec![6, 3, 1];
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    expected.extend([10, 2, 1, 1, 0, 0, 0, 0x3f]);
    expected.extend(fit_bytes());
    expected.extend([0xac, 0x02, 0xc8, 0x01, 3]);
    assert_eq!(bytes_of(&Message::RefineReply(reply)), expected);
}

/// Of [`reply`]'s fit: that it is there, overlap, distance, ratio, points, left out, axis, others, covariance.
fn fit_bytes() -> Vec<u8> {
    let mut bytes = vec![
        1, 0, 0, 0, 0x3f, 0, 0, 0x80, 0x3e, 0, 0, 0x80, 0x3f, 0x80, 8,
    ];
    bytes.extend([0, 0, 0, 0x3e, 0, 0, 0, 0, 1]);
    bytes.extend([0; 20]);
    bytes.extend([0, 0, 0x80, 0x3f, 0, 0, 0x40, 0x40, 1]);
    bytes.extend([0, 0, 0x80, 0x3f].repeat(3));
    bytes.extend([0, 0, 0, 0x3f].repeat(21));
    bytes
}

fn reply() -> RefineReply {
    RefineReply {
        id: 7,
        target_from_source: [[0.5; 4]; 3],
        steps: 10,
        mode: Mode::Verify,
        verdict: Verdict::StepLimit,
        probability: Some(0.5),
        fit: Some(Fit {
            overlap: 0.5,
            inlier_rmse: 0.25,
            extents_ratio: 1.0,
            left_out: [0.125, 0.0],
            distinct_points: 1024,
            axis: Some(([0.0; 3], [0.0, 0.0, 1.0], 3.0)),
            others: 1,
            covariance: ([1.0; 3], [0.5; 21]),
        }),
        waited_micros: 300,
        micros: 200,
        policy_version: 3,
    }
}

#[test]
fn a_trace_and_a_cancellation_are_these_bytes() {
    let step = step_bytes(golden(), [[1.0; 4]; 3]);
    let steps = [step, step_bytes(Action::STOP, [[-2.0; 4]; 3])];
    let trace = Trace {
        policy: PolicyId {
            epoch: 6,
            version: 9,
            sha256: [1; 32],
        },
        kernels: KernelName::try_from("avx2").expect("fits"),
        request: &[6, 2],
        steps: StepsView::of(&steps),
        reply: reply(),
    };
    let bytes = bytes_of(&Message::Trace(trace.clone()));
    let mut expected = vec![6, 10, 6, 9];
    expected.extend([1; 32]);
    expected.extend([4, b'a', b'v', b'x', b'2', 2, 6, 2, 108, 0, 1, 2, 8, 9, 10]);
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    expected.extend([5; 6]);
    expected.extend([0, 0, 0, 0xc0].repeat(12));
    expected.extend(&bytes_of(&Message::RefineReply(reply()))[2..]);
    assert_eq!(bytes, expected);
    assert_eq!(decode(&bytes), Ok(Message::Trace(trace)));
    let read: Vec<_> = StepsView::of(&steps).iter().collect();
    let expected = [(golden(), [[1.0; 4]; 3]), (Action::STOP, [[-2.0; 4]; 3])];
    assert_eq!(read, expected);
    // A byte less is no whole number of steps.
    let mut short = bytes;
    short[44] = 107;
    assert_eq!(decode(&short), Err(Error::Frame));

    let cancel = Cancel { client: 300, id: 5 };
    assert_eq!(bytes_of(&Message::Cancel(cancel)), [6, 11, 0xac, 0x02, 5]);
}

#[test]
fn refusal_and_status_are_these_bytes() {
    let refusal = Refusal {
        id: 4,
        reason: Reason::TooManyPoints(Cloud::Target, 5000),
    };
    assert_eq!(
        bytes_of(&Message::Refusal(refusal)),
        [6, 4, 4, 6, 1, 0x88, 0x27]
    );
    let status = Status {
        policy: None,
        served: 3,
        refused: 1,
        in_hand: 2,
        instance: 300,
        verdicts: [1, 2, 3, 4, 5, 6, 7, 8],
        not_taken: Some(NotTaken {
            policy: PolicyId {
                epoch: 1,
                version: 9,
                sha256: [7; 32],
            },
            reason: WhyNot::NotNewer(Release {
                epoch: 2,
                version: 5,
            }),
        }),
        tally: Tally {
            verdicts: [5, 4, 3, 2, 1, 0, 0, 0],
            judged: 6,
            probability_millionths: 300,
            micros: 8,
        },
    };
    let mut expected = vec![
        6, 5, 0, 3, 1, 2, 0xac, 0x02, 1, 2, 3, 4, 5, 6, 7, 8, 1, 1, 9,
    ];
    expected.extend([7; 32]);
    expected.extend([3, 2, 5, 5, 4, 3, 2, 1, 0, 0, 0, 6, 0xac, 0x02, 8]);
    assert_eq!(bytes_of(&Message::Status(status)), expected);
    let refusal = |reason| bytes_of(&Message::Refusal(Refusal { id: 4, reason }));
    assert_eq!(refusal(Reason::Deadline), [6, 4, 4, 11]);
    let no_such_mode = Reason::NoSuchMode(Mode::Verify);
    assert_eq!(refusal(no_such_mode), [6, 4, 4, 12, 2]);
}

#[test]
fn frames_of_boards_are_these_bytes() {
    assert_eq!(bytes_of(&Message::Ask), [6, 6]);
    let board = Board {
        program_bytes: 300,
        points: 2,
        slice_ticks: 4,
        hertz: 1,
        flash: FlashCheck::FailedSelfTest,
        ..Board::default()
    };
    let expected = [6, 7, 0xac, 0x02, 0, 0, 0, 2, 0, 0, 4, 1, 3];
    assert_eq!(bytes_of(&Message::Board(board)), expected);
    let step = StepTaken {
        id: 9,
        action: Action {
            translation: [0, 1, 2],
            rotation: [3, 4, 5],
        },
        target_from_source: [[1.0; 4]; 3],
    };
    let mut expected = vec![6, 8, 9, 0, 1, 2, 3, 4, 5];
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    assert_eq!(bytes_of(&Message::StepTaken(step)), expected);
    let chunk = Chunk {
        index: 3,
        bytes: &[7, 8],
    };
    assert_eq!(bytes_of(&Message::Chunk(chunk)), [6, 9, 3, 2, 7, 8]);
}

#[test]
fn what_is_written_is_read_back() {
    let (source, target) = ([[1.0, 2.0, 3.0]; 3], [[0.5, f32::MIN, 4.0]; 4]);
    let grid = Grid {
        origin: [1e30, 0.0, -0.0],
        step: f32::MIN_POSITIVE,
    };
    let codes = [[i16::MIN, 0, i16::MAX]; 9];
    let source = CloudView::of(&source);
    let request = |target| {
        Message::RefineRequest(RefineRequest {
            client: u64::MAX,
            budget_ms: u32::MAX,
            max_steps: 255,
            initial: Some([[0.25; 4]; 3]),
            ..RefineRequest::new(u64::MAX, source, target)
        })
    };
    for target in [CloudView::of(&target), CloudView::on_grid(grid, &codes)] {
        let bytes = bytes_of(&request(target));
        assert_eq!(decode(&bytes), Ok(request(target)));
    }
    let bytes = bytes_of(&request(CloudView::on_grid(grid, &codes)));
    // The source could have a grid too, and more points than fit a byte.
    let overhead = bytes.len() - 12 * 3 - 6 * 9 + 16 + 2 * 2;
    assert!(overhead <= REQUEST_OVERHEAD_BYTES, "{overhead}");
    assert_eq!(
        decode(&bytes_of(&Message::Manifest(manifest()))),
        Ok(Message::Manifest(manifest()))
    );
}

#[test]
fn the_largest_small_frames_fit_their_constant() {
    let mut widest = manifest();
    widest.name = PolicyName::try_from("n".repeat(32).as_str()).expect("fits");
    (widest.length, widest.chunk_length) = (u32::MAX, u32::MAX);
    (widest.epoch, widest.version) = (u32::MAX, u64::MAX);
    (widest.reach, widest.number_format) = (u32::MAX, u16::MAX);
    (widest.file_version, widest.shape) = (u16::MAX, [u16::MAX; 8]);
    widest.golden = core::iter::repeat_n(golden(), 10).collect();
    let frame = bytes_of(&Message::Manifest(widest));
    let signed = bytes_of(&Message::SignedManifest(SignedManifest {
        manifest: &frame,
        public_key: [0; 32],
        signature: [[0; 32]; 2],
    }));
    assert!(signed.len() <= SMALL_FRAME_BYTES, "{}", signed.len());
}

#[test]
fn another_version_and_damage_are_told_apart() {
    let good = bytes_of(&Message::Manifest(manifest()));
    let mut newer = good.clone();
    newer[0] = 9;
    assert_eq!(
        decode(&newer),
        Err(Error::FrameVersion {
            found: 9,
            expected: MANIFEST_VERSION
        })
    );
    assert_eq!(decode(&[]), Err(Error::Frame));
    // The first byte alone may be that of another kind of frame.
    for cut in 2..good.len() {
        assert_eq!(decode(&good[..cut]), Err(Error::Frame), "cut at {cut}");
    }
    let mut longer = good.clone();
    longer.push(0);
    assert_eq!(decode(&longer), Err(Error::Frame));
    // A cloud of 13 bytes is no whole number of points.
    let ragged = [
        &[6, 2, 5, 0, 1, 0, 10, 0, 0, 0, 0, 0, 13][..],
        &[0; 13],
        &[0, 0],
    ]
    .concat();
    assert_eq!(decode(&ragged), Err(Error::Frame));
}

#[test]
fn a_frame_that_does_not_fit_is_refused() {
    let message = Message::Manifest(manifest());
    let length = bytes_of(&message).len();
    for space in 0..length {
        assert_eq!(
            encode(&message, &mut vec![0; space]),
            Err(Error::FrameBuffer)
        );
    }
    assert!(encode(&message, &mut vec![0; length]).is_ok());
}

#[test]
fn clouds_are_copied_only_where_they_fit() {
    let points = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let view = CloudView::of(&points);
    let mut space = [[0.0; 3]; 3];
    assert_eq!(view.copy_into(&mut space), Ok(2));
    assert_eq!(space[..2], points);
    let too_many = Error::TooManyPoints {
        points: 2,
        capacity: 1,
    };
    assert_eq!(view.copy_into(&mut space[..1]), Err(too_many));
}

#[test]
fn a_share_of_the_robots_is_reached() {
    let reached = |share: u32, sha256| {
        let manifest = Manifest {
            reach: share,
            sha256,
            ..manifest()
        };
        let robots = (0..1000).map(|i| std::format!("robot-{i:03}"));
        robots.filter(|robot| manifest.reaches(robot)).count()
    };
    assert_eq!(reached(u32::MAX, [7; 32]), 1000);
    for seed in 0..8 {
        let tenth = reached(u32::MAX / 10, [seed * 31; 32]);
        assert!((70..130).contains(&tenth), "{tenth}");
    }
}

#[test]
fn chunks_are_counted() {
    assert_eq!(manifest().chunks(), Some(3));
    for chunk_length in [0, CHUNK_BYTES as u32 + 1] {
        let refused = Manifest {
            chunk_length,
            ..manifest()
        };
        assert_eq!(refused.chunks(), None);
    }
}

proptest! {
    #[test]
    fn no_bytes_make_decode_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = decode(&bytes);
    }

    #[test]
    fn no_body_makes_decode_panic(kind in 0u8..14, body in proptest::collection::vec(any::<u8>(), 0..400)) {
        let version = if kind < 2 { MANIFEST_VERSION } else { VERSION };
        let frame = [&[version, kind][..], &body].concat();
        if let Ok(Message::RefineRequest(request)) = decode(&frame) {
            prop_assert_eq!(request.source.iter().count(), request.source.len());
        }
        let mut space = [0u32; 200];
        bytemuck::cast_slice_mut(&mut space)[..frame.len()].copy_from_slice(&frame);
        let _ = take_request(&mut space, frame.len());
    }
}
