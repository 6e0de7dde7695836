//! Frames that were changed on the way.

use super::cases;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use reagent_core::wire::{
    Board, Cancel, Chunk, Cloud, CloudView, KernelName, Manifest, Message, Mode, PolicyId,
    PolicyName, REQUEST_BYTES, REQUEST_OVERHEAD_BYTES, Reason, RefineReply, RefineRequest, Refusal,
    SignedManifest, Status, StepTaken, StepsView, Trace, decode, decode_in_place, encode,
    refuse_beginning, serial, step_bytes,
};
use reagent_core::{Action, Grid, Pose, Verdict};

fn bytes_of(message: &Message<'_>) -> Vec<u8> {
    let mut buffer = vec![0; REQUEST_BYTES];
    encode(message, &mut buffer).expect("fits").to_vec()
}

/// One frame of each kind, and requests of each format.
fn sound() -> Vec<Vec<u8>> {
    let points = [[1.0f32, 2.0, 3.0]; 20];
    let codes = [[1i16, 2, 3]; 30];
    let grid = Grid {
        origin: [0.0; 3],
        step: 0.1,
    };
    let rows = Pose::IDENTITY.to_rows();
    let plain = RefineRequest::new(77, CloudView::of(&points), CloudView::on_grid(grid, &codes));
    let full = RefineRequest {
        client: u64::MAX,
        budget_ms: u32::MAX,
        initial: Some(rows),
        trace: true,
        anywhere: true,
        view_point: Some([1.0; 3]),
        source: CloudView::on_grid(grid, &codes),
        background: CloudView::of(&points),
        ..plain
    };
    let reply = RefineReply {
        id: 1,
        target_from_source: rows,
        steps: 3,
        mode: Mode::Verify,
        verdict: Verdict::Converged,
        probability: Some(0.5),
        fit: None,
        waited_micros: 1,
        micros: 2,
        policy_version: 3,
    };
    let manifest = Manifest {
        sha256: [1; 32],
        length: 1000,
        chunk_length: 100,
        table_sha256: [2; 32],
        epoch: 1,
        version: u64::MAX,
        reach: u32::MAX,
        file_version: 1,
        number_format: 0,
        shape: [64, 128, 1024, 512, 256, 33, 0, 0],
        name: PolicyName::try_from("x").expect("fits"),
        training_sha256: [0; 32],
        evaluation_sha256: [0; 32],
        golden: [Action::STOP].into_iter().collect(),
    };
    let steps = [step_bytes(Action::STOP, rows); 3];
    let request = bytes_of(&Message::RefineRequest(plain));
    let trace = Trace {
        policy: PolicyId::default(),
        kernels: KernelName::try_from("portable").expect("fits"),
        request: &request,
        steps: StepsView::of(&steps),
        reply,
    };
    let reason = Reason::TooManyPoints(Cloud::Source, 3);
    let messages = [
        Message::RefineRequest(plain),
        Message::RefineRequest(full),
        Message::RefineReply(reply),
        Message::Refusal(Refusal { id: 3, reason }),
        Message::Status(Status::default()),
        Message::Ask,
        Message::Board(Board::default()),
        Message::StepTaken(StepTaken {
            id: 3,
            action: Action::STOP,
            target_from_source: rows,
        }),
        Message::Chunk(Chunk {
            index: 3,
            bytes: &[1, 2, 3, 4],
        }),
        Message::Cancel(Cancel { client: 3, id: 4 }),
        Message::SignedManifest(SignedManifest {
            manifest: &[3, 0, 1, 2],
            public_key: [3; 32],
            signature: [[1; 32]; 2],
        }),
        Message::Manifest(manifest),
        Message::Trace(trace),
    ];
    messages.iter().map(bytes_of).collect()
}

/// What happens to a frame.
#[derive(Clone, Debug)]
enum Change {
    Set(Index, u8),
    Flip(Index, u32),
    Cut(Index),
    Insert(Index, Vec<u8>),
    Remove(Index),
    Kind(u8),
    /// It continues like another frame.
    Splice(Index, Index, Index),
}

fn change() -> impl Strategy<Value = Change> {
    let at = any::<Index>;
    // Continuation bytes of varints: more than any varint has.
    let longest = [vec![0xff; 9], vec![1]].concat();
    prop_oneof![
        (at(), any::<u8>()).prop_map(|(at, byte)| Change::Set(at, byte)),
        (at(), 0u32..8).prop_map(|(at, bit)| Change::Flip(at, bit)),
        at().prop_map(Change::Cut),
        (at(), vec(any::<u8>(), 1..8)).prop_map(|(at, bytes)| Change::Insert(at, bytes)),
        at().prop_map(move |at| Change::Insert(at, longest.clone())),
        at().prop_map(Change::Remove),
        (0u8..14).prop_map(Change::Kind),
        (at(), at(), at()).prop_map(|(at, of, from)| Change::Splice(at, of, from)),
    ]
}

fn changed(frames: &[Vec<u8>], which: Index, changes: &[Change]) -> Vec<u8> {
    let mut frame = frames[which.index(frames.len())].clone();
    for change in changes {
        let length = frame.len();
        if length < 2 {
            break;
        }
        match change {
            Change::Set(at, byte) => frame[at.index(length.min(60))] = *byte,
            Change::Flip(at, bit) => frame[at.index(length)] ^= 1 << bit,
            Change::Cut(at) => frame.truncate(at.index(length + 1)),
            Change::Insert(at, bytes) => {
                let at = at.index(length);
                frame.splice(at..at, bytes.iter().copied());
            }
            Change::Remove(at) => {
                frame.remove(at.index(length));
            }
            Change::Kind(kind) => frame[1] = *kind,
            Change::Splice(at, of, from) => {
                let other = &frames[of.index(frames.len())];
                frame.truncate(at.index(length));
                frame.extend_from_slice(&other[from.index(other.len())..]);
            }
        }
    }
    frame
}

/// What decodes can be encoded, and decodes to the same again; all its iterators end.
fn read(frame: &[u8]) {
    let Ok(message) = decode(frame) else { return };
    let mut buffer = vec![0; frame.len() + 600];
    let again = encode(&message, &mut buffer)
        .expect("it was in a frame")
        .to_vec();
    // NaN is not equal to itself.
    assert_eq!(
        format!("{:?}", decode(&again)),
        format!("{:?}", Ok::<_, ()>(&message))
    );
    match &message {
        Message::RefineRequest(request) => {
            let mut space = [[0.0; 3]; 64];
            for cloud in [request.source, request.target, request.background] {
                assert_eq!(cloud.iter().count(), cloud.len());
                assert_eq!(cloud.copy_into(&mut space).is_ok(), cloud.len() <= 64);
            }
        }
        Message::Trace(trace) => assert!(trace.steps.iter().count() <= frame.len()),
        Message::Manifest(manifest) => {
            let _ = (
                manifest.runs_here(),
                manifest.chunks(),
                manifest.reaches("r1"),
            );
        }
        Message::Refusal(refusal) => assert!(!refusal.reason.to_string().is_empty()),
        _ => {}
    }
}

/// As a board takes it: decoded in its only buffer, or refused by its first bytes.
fn take(frame: &[u8], length: usize, points: usize, busy: bool) {
    let mut space = [0u32; 512];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut space);
    let here = frame.len().min(bytes.len());
    bytes[..here].copy_from_slice(&frame[..here]);
    if let Ok(request) = decode_in_place(&mut space, length) {
        for cloud in [request.source, request.target] {
            assert_eq!(cloud.points().count(), cloud.len());
            let _ = cloud.check();
        }
    }
    let kept = frame.len().min(REQUEST_OVERHEAD_BYTES);
    let _ = refuse_beginning(&frame[..kept], length, points, busy);
}

/// Sends a frame over a serial line that changes one byte.
fn send(frame: &[u8], damage: Option<(Index, u8)>) {
    let mut line = Vec::new();
    serial::write(frame, |byte| line.push(byte));
    if let Some((at, byte)) = damage {
        let at = at.index(line.len());
        line[at] = byte;
    }
    let (mut decoder, mut space) = (serial::Decoder::new(), vec![0; 600]);
    let mut received = 0;
    for byte in line {
        if let Some(serial::Line::Frame(length)) = decoder.push(byte, &mut space) {
            received += 1;
            let _ = decode(&space[..length]);
            assert!(damage.is_some() || &space[..length] == frame);
        }
    }
    assert!(
        damage.is_some() || received == 1 || frame.len() > 590,
        "{}",
        frame.len()
    );
}

proptest! {
    #![proptest_config(cases(20_000))]

    #[test]
    fn changed_frames_are_read_or_refused(
        which in any::<Index>(),
        changes in vec(change(), 0..5),
        length in prop_oneof![Just(None), (0usize..20_000).prop_map(Some)],
        points in 0usize..5000,
        busy in any::<bool>(),
        damage in prop::option::of((any::<Index>(), any::<u8>())),
    ) {
        let frame = changed(&sound(), which, &changes);
        read(&frame);
        take(&frame, length.unwrap_or(frame.len()), points, busy);
        send(&frame, damage);
    }
}
