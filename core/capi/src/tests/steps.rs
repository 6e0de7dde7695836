//! Registrations step by step, with a policy.

use super::*;
use reagent_core::grid::Grid;

/// The result of a registration after two steps.
///
/// # Safety
/// `memory` has a source.
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

/// Thirty points, as codes or coordinates.
type Thirty<T> = [[T; 3]; 30];

/// Clouds on a grid: their codes, and the points that the codes stand for.
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
    // SAFETY: pointers to live values, or pointers that must be refused.
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
        // The registration in progress finishes as if nothing had happened.
        assert_eq!(after_two_steps(memory, true), expected);
    }
}

/// Whatever is refused, and whenever it is noticed.
#[test]
fn a_refused_call_leaves_a_registration_under_way() {
    let (mut memory, mut workspace) = (memory(), workspace());
    let memory: *mut ReagentMemory = &raw mut *memory;
    let workspace: *mut ReagentWorkspace = &raw mut *workspace;
    let (source, target) = (bracket(0.0), bracket(0.37));
    let (from, to) = (
        source.as_flattened().as_ptr(),
        target.as_flattened().as_ptr(),
    );
    let mut answer = ReagentAnswer::default();
    let mut tiny = target.clone();
    for x in tiny.as_flattened_mut() {
        *x *= 1e-30;
    }
    let tiny = tiny.as_flattened().as_ptr();
    static NOWHERE: [f32; 3] = [f32::NAN; 3];
    use ReagentStatus::*;
    // SAFETY: pointers to live values.
    unsafe {
        let policy = compact();
        assert_eq!(reagent_init(memory, policy.as_ptr(), policy.len()), Ok);
        assert_eq!(reagent_set_target(memory, to, 600), Ok);
        assert_eq!(reagent_set_source(memory, from, 600, null()), Ok);
        let before = after_two_steps(memory, false);
        let mut refused = |target, change: fn(&mut ReagentTask)| {
            let mut task = reagent_task();
            change(&mut task);
            let into = &raw mut answer;
            reagent_register(memory, workspace, from, 600, target, 600, &task, into)
        };
        for (told, expected) in [
            (refused(tiny, |_| ()), NoExtent),
            (refused(to, |task| task.along = -1.0), BadUncertainty),
            (
                refused(to, |task| task.view_point = NOWHERE.as_ptr()),
                BadViewPoint,
            ),
            (refused(to, |task| task.start.rows = [[2.0; 4]; 3]), BadPose),
        ] {
            assert_eq!(told, expected);
        }
        let mut after = ReagentResult::default();
        assert_eq!(reagent_result(memory, &mut after), Ok);
        assert_eq!(after, before);
        assert_eq!(reagent_step(memory, null_mut()), Ok);
        assert_eq!(refused(to, |_| ()), Ok);
        assert_eq!(reagent_step(memory, null_mut()), NotStarted);
    }
}
