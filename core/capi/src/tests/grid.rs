//! Clouds on a grid.

use super::*;
use reagent_core::grid::Grid;

#[test]
fn points_come_back_from_a_grid() {
    let cloud = [[0.0f32, 0.5, 1.0], [0.25, 1.0, 0.0], [1.0, 0.0, -3.0]];
    let xyz = cloud.as_flattened().as_ptr();
    let mut grid = ReagentGrid::default();
    let mut codes = [[7i16; 3]; 4];
    let into = codes.as_flattened_mut().as_mut_ptr();
    // SAFETY: pointers to live values.
    unsafe {
        assert_eq!(reagent_grid_of(xyz, 3, &mut grid), ReagentStatus::Ok);
        assert_eq!(reagent_encode(&grid, xyz, 3, into), ReagentStatus::Ok);
        assert_eq!(
            reagent_encode(&grid, null(), 0, null_mut()),
            ReagentStatus::Ok
        );
    }
    let expected = Grid::of(&cloud).expect("points");
    assert_eq!(Grid::from(grid), expected);
    assert_eq!(codes[..3], cloud.map(|point| expected.encode(point)));
    assert_eq!(codes[3], [7; 3]);
}

#[test]
fn what_cannot_be_put_on_a_grid_is_refused_and_changes_nothing() {
    let cloud = [[0.0f32, 0.5, 1.0], [0.25, f32::NAN, 0.0]];
    let xyz = cloud.as_flattened().as_ptr();
    let sound = ReagentGrid {
        origin: [1.0; 3],
        step: 2.0,
    };
    let infinite = ReagentGrid {
        step: f32::INFINITY,
        ..sound
    };
    let [flat, backward] = [0.0, -2.0].map(|step| ReagentGrid { step, ..sound });
    let mut grid = sound;
    let mut codes = [[7i16; 3]; 2];
    let into = codes.as_flattened_mut().as_mut_ptr();
    let (odd, odd_codes) = (xyz.wrapping_byte_add(2), into.wrapping_byte_add(1));
    let odd_grid = (&raw mut grid).wrapping_byte_add(2);
    use ReagentStatus::{BadGrid, EmptyCloud, NotFinite, Pointer, TooManyPoints};
    // SAFETY: pointers to live values, or pointers that must be refused.
    let found = unsafe {
        [
            (reagent_grid_of(xyz, 2, &mut grid), NotFinite),
            (reagent_grid_of(xyz, 0, &mut grid), EmptyCloud),
            (reagent_grid_of(xyz, 5000, &mut grid), TooManyPoints),
            (reagent_grid_of(null(), 1, &mut grid), Pointer),
            (reagent_grid_of(odd, 1, &mut grid), Pointer),
            (reagent_grid_of(xyz, 1, null_mut()), Pointer),
            (reagent_grid_of(xyz, 1, odd_grid), Pointer),
            (reagent_encode(&sound, xyz, 2, into), NotFinite),
            (reagent_encode(&infinite, xyz, 1, into), NotFinite),
            (reagent_encode(&flat, xyz, 1, into), BadGrid),
            (reagent_encode(&backward, xyz, 1, into), BadGrid),
            (reagent_encode(&sound, xyz, 5000, into), TooManyPoints),
            (reagent_encode(null(), xyz, 1, into), Pointer),
            (reagent_encode(odd_grid, xyz, 1, into), Pointer),
            (reagent_encode(&sound, odd, 1, into), Pointer),
            (reagent_encode(&sound, xyz, 1, null_mut()), Pointer),
            (reagent_encode(&sound, xyz, 1, odd_codes), Pointer),
        ]
    };
    for (index, (found, expected)) in found.into_iter().enumerate() {
        assert_eq!(found, expected, "call {index}");
    }
    assert_eq!((grid, codes), (sound, [[7; 3]; 2]));
}

#[test]
fn an_order_keeps_every_point() {
    let cloud = bracket(0.3);
    let mut ordered = cloud.clone();
    let xyz = ordered.as_flattened_mut().as_mut_ptr();
    // SAFETY: pointers to live values, or pointers that must be refused.
    unsafe {
        assert_eq!(reagent_put_in_order(xyz, 600), ReagentStatus::Ok);
        assert_eq!(reagent_put_in_order(null_mut(), 0), ReagentStatus::Ok);
        assert_eq!(reagent_put_in_order(null_mut(), 1), ReagentStatus::Pointer);
        let odd = xyz.wrapping_byte_add(1);
        assert_eq!(reagent_put_in_order(odd, 600), ReagentStatus::Pointer);
        let many = ReagentStatus::TooManyPoints;
        assert_eq!(reagent_put_in_order(xyz, 4097), many);
    }
    let apart = |cloud: &[[f32; 3]]| -> f32 {
        let pairs = cloud.windows(2);
        pairs
            .map(|p| (0..3).map(|k| (p[0][k] - p[1][k]).abs()).sum::<f32>())
            .sum()
    };
    assert!(
        apart(&ordered) < apart(&cloud),
        "neighbours follow each other"
    );
    let sorted = |mut cloud: Vec<[f32; 3]>| {
        cloud.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
        cloud
    };
    assert_eq!(sorted(ordered), sorted(cloud));
}
