//! Each kind of frame, byte by byte.

use super::*;
use crate::verdict::Verdict;

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
    let mut expected = vec![12, 2, 5, 0, 0x90, 0x4e, 3, 10, 0, 0, 0, 0];
    let cloud = [0, 12, 0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0, 0x3f];
    expected.extend(cloud);
    expected.extend([0; 6]);
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
    request.background = CloudView::of(&source);
    request.outward = CloudView::of(&source);
    let mut expected = vec![12, 2, 5, 0xac, 2, 20, 2, 10, 1, 1];
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    expected.extend([1, 1]);
    expected.extend([0, 0, 0x80, 0x3f].repeat(3));
    expected.extend(cloud);
    expected.extend([
        1, 0, 0, 0, 0x3f, 0, 0, 0, 0, 0, 0, 0x80, 0x3f, 0, 0, 0, 0x3e,
    ]);
    expected.extend([6, 1, 0, 0xfe, 0xff, 0x2c, 0x01]);
    expected.extend(cloud);
    expected.extend(cloud);
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
    let mut expected = vec![12, 3, 1];
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    expected.extend([10, 2, 1, 1, 0, 0, 0, 0x3f]);
    expected.extend(fit_bytes());
    expected.extend([0xac, 0x02, 0xc8, 0x01, 3]);
    assert_eq!(bytes_of(&Message::RefineReply(reply)), expected);
}

/// The fit in [`reply`]: presence, overlap, distance, ratio, points, left out, seen through, axis, slide, any rotation, fold, others, covariance.
fn fit_bytes() -> Vec<u8> {
    let mut bytes = vec![
        1, 0, 0, 0, 0x3f, 0, 0, 0x80, 0x3e, 0, 0, 0x80, 0x3f, 0x80, 8,
    ];
    bytes.extend([0, 0, 0, 0x3e, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    bytes.extend([0; 20]);
    bytes.extend([0, 0, 0x80, 0x3f, 0, 0, 0x40, 0xc0, 0, 0, 0x40, 0x40, 1]);
    bytes.extend([0; 8]);
    bytes.extend([0, 0, 0x80, 0x3f, 0, 0, 0x80, 0xbf, 0, 0, 0, 0, 1]);
    bytes.extend([1, 0, 0, 0x80, 0x3f]);
    bytes.extend([0; 16]);
    bytes.extend([0, 0, 0x80, 0x3f, 6, 1]);
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
            seen_through: 0.0,
            distinct_points: 1024,
            axis: Some(([0.0; 3], [0.0, 0.0, 1.0], [-3.0, 3.0])),
            slide: Some(([0.0, 0.0, 1.0], [-1.0, 0.0])),
            any_rotation: true,
            fold: Some(([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], 6)),
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
    let mut expected = vec![12, 10, 6, 9];
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
    // One byte less is not a whole number of steps.
    let mut short = bytes;
    short[44] = 107;
    assert_eq!(decode(&short), Err(Error::Frame));

    let cancel = Cancel { client: 300, id: 5 };
    assert_eq!(bytes_of(&Message::Cancel(cancel)), [12, 11, 0xac, 0x02, 5]);
}

#[test]
fn refusal_and_status_are_these_bytes() {
    let refusal = Refusal {
        id: 4,
        reason: Reason::TooManyPoints(Cloud::Target, 5000),
    };
    assert_eq!(
        bytes_of(&Message::Refusal(refusal)),
        [12, 4, 4, 6, 1, 0x88, 0x27]
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
            refined: 9,
            reached: 7,
        },
        health: Health {
            state_lost: true,
            certificate_invalid: false,
        },
    };
    let mut expected = vec![
        12, 5, 0, 3, 1, 2, 0xac, 0x02, 1, 2, 3, 4, 5, 6, 7, 8, 1, 1, 9,
    ];
    expected.extend([7; 32]);
    expected.extend([
        3, 2, 5, 5, 4, 3, 2, 1, 0, 0, 0, 6, 0xac, 0x02, 8, 9, 7, 1, 0,
    ]);
    assert_eq!(bytes_of(&Message::Status(status)), expected);
    let refusal = |reason| bytes_of(&Message::Refusal(Refusal { id: 4, reason }));
    assert_eq!(refusal(Reason::Deadline), [12, 4, 4, 11]);
    let no_such_mode = Reason::NoSuchMode(Mode::Verify);
    assert_eq!(refusal(no_such_mode), [12, 4, 4, 12, 2]);
}

#[test]
fn frames_of_boards_are_these_bytes() {
    assert_eq!(bytes_of(&Message::Ask), [12, 6]);
    let board = Board {
        program_bytes: 300,
        points: 2,
        slice_ticks: 4,
        hertz: 1,
        flash: FlashCheck::FailedSelfTest,
        ..Board::default()
    };
    let expected = [12, 7, 0xac, 0x02, 0, 0, 0, 2, 0, 0, 4, 1, 3];
    assert_eq!(bytes_of(&Message::Board(board)), expected);
    let step = StepTaken {
        id: 9,
        action: Action {
            translation: [0, 1, 2],
            rotation: [3, 4, 5],
        },
        target_from_source: [[1.0; 4]; 3],
    };
    let mut expected = vec![12, 8, 9, 0, 1, 2, 3, 4, 5];
    expected.extend([0, 0, 0x80, 0x3f].repeat(12));
    assert_eq!(bytes_of(&Message::StepTaken(step)), expected);
    let chunk = Chunk {
        index: 3,
        bytes: &[7, 8],
    };
    assert_eq!(bytes_of(&Message::Chunk(chunk)), [12, 9, 3, 2, 7, 8]);
}
