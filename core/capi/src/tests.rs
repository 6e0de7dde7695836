use super::*;
use core::ptr::{null, null_mut};
use reagent_core::evidence::Evidence;
use reagent_core::polish::{Refiner, Workspace};
use reagent_core::{Error, Pose, grid::Grid};

fn memory() -> Box<ReagentMemory> {
    Box::new(ReagentMemory {
        words: [u64::MAX; REAGENT_MEMORY_WORDS],
    })
}

#[test]
fn calls_out_of_order_and_bad_pointers_are_refused() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let mut result = ReagentResult::default();
    let cloud = [[0.0f32, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let xyz = cloud.as_flattened().as_ptr();
    let grid = ReagentGrid::default();
    // SAFETY: pointers to live values, or such as must be refused.
    unsafe {
        assert_eq!(
            reagent_step(memory, null_mut()),
            ReagentStatus::NotInitialised
        );
        assert_eq!(
            reagent_set_target(memory, xyz, 3),
            ReagentStatus::NotInitialised
        );
        assert_eq!(
            reagent_set_target_on_grid(memory, &grid, [0; 9].as_ptr(), 3),
            ReagentStatus::NotInitialised
        );
        assert_eq!(
            reagent_result(null_mut(), &mut result),
            ReagentStatus::Pointer
        );
        assert_eq!(reagent_init(memory, null(), 0), ReagentStatus::Pointer);
        let short = [0u32; 4];
        let bytes = short.as_ptr().cast::<u8>();
        assert_eq!(reagent_init(memory, bytes, 16), ReagentStatus::WeightsMagic);
        assert_eq!(reagent_init(memory, bytes, 0), ReagentStatus::WeightsLength);
        assert_eq!(
            reagent_step(memory, null_mut()),
            ReagentStatus::NotInitialised
        );
    }
}

#[test]
fn every_status_has_a_sentence_of_its_own() {
    let text = |status: i32| {
        // SAFETY: a string that lives as long as the program.
        let text = unsafe { core::ffi::CStr::from_ptr(reagent_status_text(status)) };
        text.to_str().expect("English").to_owned()
    };
    let last = ReagentStatus::TargetNotFinite as i32;
    let all: std::collections::BTreeSet<_> = (-1..=last).map(text).collect();
    assert_eq!(all.len(), last as usize + 2);
    assert_eq!(text(last + 1), text(-1));
    assert!(text(ReagentStatus::BadPose as i32).contains("pose"));
    assert!(text(ReagentStatus::TooFewPoints as i32).contains("source"));
    assert!(text(last).contains("target"));
}

#[test]
fn the_version_is_that_of_the_package() {
    let parts = [
        REAGENT_VERSION_MAJOR,
        REAGENT_VERSION_MINOR,
        REAGENT_VERSION_PATCH,
    ];
    let text = parts.map(|part| part.to_string()).join(".");
    assert_eq!(text, env!("CARGO_PKG_VERSION"));
    assert_eq!(reagent_version(), REAGENT_VERSION);
}

#[test]
fn every_error_has_a_status() {
    assert_eq!(ReagentStatus::from(Error::BadPose), ReagentStatus::BadPose);
    let range = Error::WeightsRange { layer: 2 };
    assert_eq!(ReagentStatus::from(range), ReagentStatus::WeightsDamaged);
}

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
    let mut grid = sound;
    let mut codes = [[7i16; 3]; 2];
    let into = codes.as_flattened_mut().as_mut_ptr();
    let (odd, odd_codes) = (xyz.wrapping_byte_add(2), into.wrapping_byte_add(1));
    let odd_grid = (&raw mut grid).wrapping_byte_add(2);
    use ReagentStatus::{EmptyCloud, NotFinite, Pointer, TooManyPoints};
    // SAFETY: pointers to live values, or such as must be refused.
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

/// A policy on a 4-byte boundary.
#[cfg(feature = "pretrained-compact")]
fn compact() -> &'static [u8] {
    reagent_core::Policy::pretrained_compact_bytes()
}

/// What a registration says after two steps.
///
/// # Safety
/// `memory` has a source.
#[cfg(feature = "pretrained-compact")]
unsafe fn after_two_steps(memory: *mut ReagentMemory, sliced: bool) -> ReagentResult {
    let mut result = ReagentResult::default();
    // SAFETY: pointers to live values.
    unsafe {
        while result.steps < 2 {
            let taken = if sliced {
                reagent_advance(memory, 5, null_mut(), null_mut())
            } else {
                reagent_step(memory, null_mut())
            };
            assert_eq!(taken, ReagentStatus::Ok);
            assert_eq!(reagent_result(memory, &mut result), ReagentStatus::Ok);
        }
    }
    result
}

/// Thirty points, codes or coordinates.
type Thirty<T> = [[T; 3]; 30];

/// Clouds on a grid: codes, and the points that they stand for.
fn clouds() -> (ReagentGrid, [Thirty<i16>; 2], [Thirty<f32>; 2]) {
    let grid = ReagentGrid {
        origin: [0.5, -0.25, 3.0],
        step: 0.001,
    };
    let code = |i: i16, by: i16| [i * 37 % 500 + by, i * 91 % 700, i * 53 % 300 - by];
    let codes = [20, 0].map(|by| core::array::from_fn(|i| code(i as i16, by)));
    let points = codes.map(|codes| codes.map(|code| Grid::from(grid).decode(code)));
    (grid, codes, points)
}

#[cfg(feature = "pretrained-compact")]
#[test]
fn codes_are_registered_as_the_points_that_they_stand_for() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let (grid, codes, points) = clouds();
    let [source, target] = points.each_ref().map(|p| p.as_flattened().as_ptr());
    let [source_codes, target_codes] = codes.each_ref().map(|c| c.as_flattened().as_ptr());
    use ReagentStatus::Ok;
    // SAFETY: pointers to live values.
    unsafe {
        assert_eq!(
            reagent_init(memory, compact().as_ptr(), compact().len()),
            Ok
        );
        assert_eq!(reagent_set_target(memory, target, 30), Ok);
        assert_eq!(reagent_set_source(memory, source, 30, null()), Ok);
        let expected = after_two_steps(memory, false);
        assert_ne!(expected.target_from_source.rows, Pose::IDENTITY.to_rows());

        // In either format, whole and sliced; the grid itself need not stay.
        for mixed in [false, true] {
            for sliced in [false, true] {
                let mut passing = grid;
                let set = reagent_set_target_on_grid(memory, &passing, target_codes, 30);
                assert_eq!(set, Ok);
                passing.step = 7.0;
                core::hint::black_box(&passing);
                let from = if sliced {
                    reagent_begin_on_grid
                } else {
                    reagent_set_source_on_grid
                };
                let set = match (mixed, sliced) {
                    (false, _) => from(memory, &grid, source_codes, 30, null()),
                    (true, false) => reagent_set_source(memory, source, 30, null()),
                    (true, true) => reagent_begin(memory, source, 30, null()),
                };
                assert_eq!(set, Ok);
                assert_eq!(after_two_steps(memory, sliced), expected);
            }
        }
    }
}

#[cfg(feature = "pretrained-compact")]
#[test]
fn refused_calls_leave_the_registration_under_way() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let (grid, codes, points) = clouds();
    let [source, target] = points.each_ref().map(|p| p.as_flattened().as_ptr());
    let codes = codes[0].as_flattened().as_ptr();
    let mut unsound = points[0];
    unsound[29][2] = f32::INFINITY;
    let unsound = unsound.as_flattened().as_ptr();
    let one_place = [[1.0f32; 3]; 3];
    let one_place = one_place.as_flattened().as_ptr();
    let infinite = ReagentGrid {
        origin: [0.0, f32::INFINITY, 0.0],
        ..grid
    };
    let bent = ReagentPose {
        rows: [[1.0; 4]; 3],
    };
    let mut result = ReagentResult::default();
    use ReagentStatus::*;
    // SAFETY: pointers to live values, or such as must be refused.
    unsafe {
        assert_eq!(
            reagent_init(memory, compact().as_ptr(), compact().len()),
            Ok
        );
        // Nothing is set yet.
        let early = [
            reagent_set_source(memory, source, 30, null()),
            reagent_begin(memory, source, 30, null()),
            reagent_set_source_on_grid(memory, &grid, codes, 30, null()),
            reagent_begin_on_grid(memory, &grid, codes, 30, null()),
            reagent_step(memory, null_mut()),
            reagent_advance(memory, 1, null_mut(), null_mut()),
            reagent_result(memory, &mut result),
        ];
        assert_eq!(early, [NotStarted; 7]);
        assert_eq!(result, ReagentResult::default());

        assert_eq!(reagent_set_target(memory, target, 30), Ok);
        assert_eq!(reagent_step(memory, null_mut()), NotStarted);
        assert_eq!(reagent_begin(memory, source, 30, null()), Ok);
        let expected = after_two_steps(memory, true);
        assert_eq!(reagent_begin(memory, source, 30, null()), Ok);
        assert_eq!(reagent_advance(memory, 7, null_mut(), null_mut()), Ok);

        let odd = source.wrapping_byte_add(1);
        let odd_codes = codes.wrapping_byte_add(1);
        let odd_grid = (&raw const grid).wrapping_byte_add(2);
        let odd_pose = (&raw const bent).wrapping_byte_add(2);
        let odd_memory = memory.wrapping_byte_add(4);
        let targets = [
            (reagent_set_target(memory, target, 0), TargetEmpty),
            (reagent_set_target(memory, target, 2), TargetTooFewPoints),
            (
                reagent_set_target(memory, target, 4097),
                TargetTooManyPoints,
            ),
            (reagent_set_target(memory, unsound, 30), TargetNotFinite),
            (reagent_set_target(memory, one_place, 3), NoExtent),
            (reagent_set_target(memory, odd, 30), Pointer),
            (reagent_set_target(memory, null(), 30), Pointer),
            (reagent_set_target(odd_memory, target, 30), Pointer),
            (
                reagent_set_target_on_grid(memory, &grid, codes, 2),
                TargetTooFewPoints,
            ),
            (
                reagent_set_target_on_grid(memory, &grid, codes, 4097),
                TargetTooManyPoints,
            ),
            (
                reagent_set_target_on_grid(memory, &infinite, codes, 30),
                TargetNotFinite,
            ),
            (
                reagent_set_target_on_grid(memory, &ReagentGrid::default(), codes, 30),
                NoExtent,
            ),
            (
                reagent_set_target_on_grid(memory, null(), codes, 30),
                Pointer,
            ),
            (
                reagent_set_target_on_grid(memory, odd_grid, codes, 30),
                Pointer,
            ),
            (
                reagent_set_target_on_grid(memory, &grid, null(), 30),
                Pointer,
            ),
            (
                reagent_set_target_on_grid(memory, &grid, odd_codes, 30),
                Pointer,
            ),
        ];
        for (index, (found, expected)) in targets.into_iter().enumerate() {
            assert_eq!(found, expected, "target {index}");
        }
        for set_source in [reagent_set_source, reagent_begin] {
            let sources = [
                (set_source(memory, source, 0, null()), EmptyCloud),
                (set_source(memory, source, 2, null()), TooFewPoints),
                (set_source(memory, source, 4097, null()), TooManyPoints),
                (set_source(memory, unsound, 30, null()), NotFinite),
                (set_source(memory, source, 30, &bent), BadPose),
                (set_source(memory, source, 30, odd_pose), Pointer),
                (set_source(memory, odd, 30, null()), Pointer),
                (set_source(null_mut(), source, 30, null()), Pointer),
            ];
            for (index, (found, expected)) in sources.into_iter().enumerate() {
                assert_eq!(found, expected, "source {index}");
            }
        }
        for set_source in [reagent_set_source_on_grid, reagent_begin_on_grid] {
            let sources = [
                (set_source(memory, &grid, codes, 0, null()), EmptyCloud),
                (set_source(memory, &grid, codes, 2, null()), TooFewPoints),
                (set_source(memory, &infinite, codes, 30, null()), NotFinite),
                (set_source(memory, &grid, codes, 30, &bent), BadPose),
                (set_source(memory, &grid, codes, 30, odd_pose), Pointer),
                (set_source(memory, odd_grid, codes, 30, null()), Pointer),
                (set_source(memory, &grid, odd_codes, 30, null()), Pointer),
            ];
            for (index, (found, expected)) in sources.into_iter().enumerate() {
                assert_eq!(found, expected, "source on a grid {index}");
            }
        }
        let odd_result = (&raw mut result).wrapping_byte_add(2);
        assert_eq!(reagent_result(memory, odd_result), Pointer);
        assert_eq!(reagent_result(memory, null_mut()), Pointer);
        // The one that was under way is finished as if nothing had been.
        assert_eq!(after_two_steps(memory, true), expected);
    }
}

#[test]
fn a_pose_is_polished_and_verified_as_in_rust() {
    let (_, _, [source, target]) = clouds();
    let (from, to) = (source.as_flattened(), target.as_flattened());
    let mut workspace = Box::new(ReagentWorkspace {
        words: [u64::MAX; REAGENT_WORKSPACE_WORDS],
    });
    let mut own = Box::new(Workspace::new());
    let mut refiner = Refiner::new(&source, &target, &mut own).expect("sound clouds");
    let polished = refiner.polish(Pose::IDENTITY).expect("a pose");
    let verified = refiner
        .verify(
            Pose::IDENTITY,
            &reagent_core::start::Start::at(Pose::IDENTITY),
        )
        .expect("a pose");
    let expected = [
        (
            polished.target_from_source,
            Evidence::polished(&polished).probability(),
        ),
        (
            verified.best.target_from_source,
            Evidence::verified(&verified).probability(),
        ),
    ];
    let identity = ReagentPose {
        rows: Pose::IDENTITY.to_rows(),
    };
    for (refine, (expected, sure)) in [reagent_polish, reagent_verify].into_iter().zip(expected) {
        let (mut pose, mut probability) = (identity, f32::NAN);
        let mut call = |points: usize, probability: *mut f32| {
            // SAFETY: pointers to live values.
            unsafe {
                let (from, to) = (from.as_ptr(), to.as_ptr());
                refine(
                    &mut *workspace,
                    from,
                    30,
                    to,
                    points,
                    &mut pose,
                    probability,
                )
            }
        };
        assert_eq!(call(2, null_mut()), ReagentStatus::TargetTooFewPoints);
        assert_eq!(call(4097, null_mut()), ReagentStatus::TargetTooManyPoints);
        let odd = (&raw mut probability).wrapping_byte_add(2);
        assert_eq!(call(30, odd), ReagentStatus::Pointer);
        assert_eq!(call(30, &raw mut probability), ReagentStatus::Ok);
        assert_eq!((pose.rows, probability), (expected.to_rows(), sure));
        let mut bad = ReagentPose {
            rows: [[2.0; 4]; 3],
        };
        let nothing = null_mut();
        // SAFETY: pointers to live values, or such as must be refused.
        unsafe {
            let (from, to) = (from.as_ptr(), to.as_ptr());
            let refused = refine(&mut *workspace, from, 30, to, 30, &mut bad, nothing);
            assert_eq!(refused, ReagentStatus::BadPose);
            let refused = refine(null_mut(), from, 30, to, 30, &mut pose, nothing);
            assert_eq!(refused, ReagentStatus::Pointer);
            let refused = refine(&mut *workspace, from, 30, to, 30, null_mut(), nothing);
            assert_eq!(refused, ReagentStatus::Pointer);
        }
    }
}

#[cfg(all(
    feature = "pretrained",
    feature = "pretrained-int8",
    feature = "pretrained-compact"
))]
#[test]
fn linked_policies_are_ready_for_use() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let files = [
        reagent_pretrained,
        reagent_pretrained_int8,
        reagent_pretrained_compact,
    ];
    for linked in files {
        let mut length = 0;
        // SAFETY: pointers to live values, and a file as long as it is said to be.
        unsafe {
            let file = linked(&raw mut length);
            assert_eq!(linked(null_mut()), file);
            assert_eq!(reagent_init(memory, file, length), ReagentStatus::Ok);
        }
    }
}
