use super::*;
use crate::grid::Grid;
use crate::steps::Action;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

mod bytes;

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
    // The source could have a grid too, and lengths that take more than one byte.
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
    // The first byte alone may begin another kind of frame.
    for cut in 2..good.len() {
        assert_eq!(decode(&good[..cut]), Err(Error::Frame), "cut at {cut}");
    }
    let mut longer = good.clone();
    longer.push(0);
    assert_eq!(decode(&longer), Err(Error::Frame));
    // A cloud of 13 bytes is not a whole number of points.
    let ragged = [
        &[VERSION, 2, 5, 0, 1, 0, 10, 0, 0, 0, 0, 0, 13][..],
        &[0; 13],
        &[0, 0, 0, 0],
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
        let _ = decode_in_place(&mut space, frame.len());
    }
}
