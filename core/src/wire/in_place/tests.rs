use super::*;
use crate::wire::{REQUEST_BYTES, encode};
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

fn bytes_of(message: &Message<'_>) -> Vec<u8> {
    let mut buffer = vec![0; REQUEST_BYTES];
    encode(message, &mut buffer).expect("fits").to_vec()
}

#[test]
fn requests_are_decoded_where_they_lie() {
    let (source, target) = ([[1.0, 2.0, 3.0]; 5], [[0.5, f32::MIN, 4.0]; 4]);
    let request = RefineRequest {
        max_steps: 7,
        mode: Mode::Fast,
        budget_ms: 33,
        client: 5,
        initial: Some([[0.25; 4]; 3]),
        ..RefineRequest::new(u64::MAX, CloudView::of(&source), CloudView::of(&target))
    };
    let bytes = bytes_of(&Message::RefineRequest(request));
    let mut space = [0u32; 64];
    bytemuck::cast_slice_mut(&mut space)[..bytes.len()].copy_from_slice(&bytes);
    let decoded = decode_in_place(&mut space, bytes.len()).expect("a request");
    assert_eq!(decoded.asked, Cancel::of(&request));
    assert_eq!(decoded.max_steps, 7);
    assert_eq!((decoded.mode, decoded.budget_ms), (Mode::Fast, 33));
    assert_eq!(decoded.initial, Some([[0.25; 4]; 3]));
    assert_eq!(decoded.source, cloud::Cloud::F32(&source));
    assert_eq!(decoded.target, cloud::Cloud::F32(&target));
    assert!(decode_in_place(&mut [0; 64], bytes.len()).is_err());
    assert!(decode_in_place(&mut [0; 2], 9).is_err());
}

#[test]
fn requests_are_refused_by_their_beginning() {
    let malformed = Refusal {
        id: 0,
        reason: Reason::Malformed,
    };
    let (source, target) = ([[1.0; 3]; 30], [[2.0; 3]; 40]);
    let grid = Grid::of(&source).expect("a good cloud");
    let requests = [
        (CloudView::of(&source), CloudView::of(&target)),
        (
            CloudView::on_grid(grid, &[[1; 3]; 30]),
            CloudView::on_grid(grid, &[[1; 3]; 43]),
        ),
    ];
    for (source, target) in requests {
        let request = RefineRequest::new(300, source, target);
        let bytes = bytes_of(&Message::RefineRequest(request));
        let refused = |points, busy| refuse_beginning(&bytes[..60], bytes.len(), points, busy);
        let because = |reason| Refusal { id: 300, reason };
        let large = Reason::TooManyPoints(Cloud::Source, 30);
        assert_eq!(refused(29, false), because(large));
        // The bytes of the target's grid are counted as points.
        let found = if source.grid().is_some() { 46 } else { 40 };
        let large = Reason::TooManyPoints(Cloud::Target, found);
        assert_eq!(refused(35, false), because(large));
        assert_eq!(refused(35, true), because(Reason::Busy));
        // If the target's beginning was kept, its number of points is known.
        let count = if source.grid().is_some() { 43 } else { 40 };
        let large = Reason::TooManyPoints(Cloud::Target, count);
        let refused = |request, points| {
            let bytes = bytes_of(&Message::RefineRequest(request));
            refuse_beginning(&bytes[..400], bytes.len(), points, false)
        };
        assert_eq!(refused(request, 35), because(large));
        assert_eq!(refused(request, 50), because(large));
        let seen = RefineRequest {
            view_point: Some([0.0; 3]),
            background: CloudView::of(&[[3.0; 3]; 70]),
            ..request
        };
        assert_eq!(refused(seen, 35), because(large));
        let found = if source.grid().is_some() { 140 } else { 70 };
        let large = Reason::TooManyPoints(Cloud::Background, found);
        assert_eq!(refused(seen, 50), because(large));
    }
    let others = [&[][..], &[3], &[1, 2, 5, 10, 0, 12], &[3, 3, 5, 10, 0, 12]];
    for beginning in others {
        assert_eq!(refuse_beginning(beginning, 600, 10, false), malformed);
        let busy = refuse_beginning(beginning, 600, 10, true);
        assert_eq!((busy.id, busy.reason), (0, Reason::Busy));
    }
}

proptest! {
    #[test]
    fn clouds_in_any_format_are_taken_from_the_smallest_space(
        clouds in proptest::array::uniform2((any::<bool>(), 0usize..30)),
        seed in any::<u32>(),
    ) {
        let grid = Grid { origin: [1.0, -2.0, 3.0], step: 0.25 };
        let mut state = seed;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as i16
        };
        let codes = clouds.map(|(_, points)| {
            (0..points).map(|_| [draw(), draw(), draw()]).collect::<Vec<_>>()
        });
        let points = codes.each_ref().map(|codes| {
            codes.iter().map(|&c| grid.decode(c)).collect::<Vec<_>>()
        });
        let view = |i: usize| match clouds[i].0 {
            true => CloudView::on_grid(grid, &codes[i]),
            false => CloudView::of(&points[i]),
        };
        let request = RefineRequest::new(1, view(0), view(1));
        let bytes = bytes_of(&Message::RefineRequest(request));
        let mut space = vec![u32::MAX; bytes.len().div_ceil(4)];
        bytemuck::cast_slice_mut(&mut space)[..bytes.len()].copy_from_slice(&bytes);
        let decoded = decode_in_place(&mut space, bytes.len()).expect("a request");
        let expected = |i: usize| match clouds[i].0 {
            true => cloud::Cloud::Grid(grid, &codes[i]),
            false => cloud::Cloud::F32(&points[i]),
        };
        prop_assert_eq!([decoded.source, decoded.target], [expected(0), expected(1)]);
    }
}
