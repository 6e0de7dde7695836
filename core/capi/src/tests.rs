use super::*;
use core::ptr::{null, null_mut};
#[cfg(feature = "pretrained-compact")]
use reagent_core::pipeline::Answer;
use reagent_core::pipeline::{self, Mode, Task};
use reagent_core::polish::Workspace;
use reagent_core::start::{Start, Uncertainty};
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
    let last = ReagentStatus::NoSuchMode as i32;
    let all: std::collections::BTreeSet<_> = (-1..=last).map(text).collect();
    assert_eq!(all.len(), last as usize + 2);
    assert_eq!(text(last + 1), text(-1));
    assert!(text(ReagentStatus::BadPose as i32).contains("pose"));
    assert!(text(ReagentStatus::TooFewPoints as i32).contains("source"));
    assert!(text(last).contains("mode"));
    assert!(text(ReagentStatus::TargetNotFinite as i32).contains("target"));
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
#[cfg(feature = "pretrained-compact")]
type Thirty<T> = [[T; 3]; 30];

/// Clouds on a grid: codes, and the points that they stand for.
#[cfg(feature = "pretrained-compact")]
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

/// Points of a bracket's surface, in the order of a lattice: two of another offset share none.
fn bracket(offset: f32) -> Vec<[f32; 3]> {
    let point = |i: u16| {
        let [a, b] = [0.754_877_7, 0.569_840_3].map(|step| (f32::from(i) * step + offset).fract());
        match i % 3 {
            0 => [100.0 * a, 40.0 * b, 0.0],
            1 => [100.0 * a, 0.0, 60.0 * b],
            _ => [30.0 * a, 40.0, 20.0 * b],
        }
    };
    (0..600).map(point).collect()
}

fn workspace() -> Box<ReagentWorkspace> {
    Box::new(ReagentWorkspace {
        words: [u64::MAX; REAGENT_WORKSPACE_WORDS],
    })
}

/// Every kind of task, and the same in Rust.
fn tasks() -> Vec<(ReagentTask, Task<'static>)> {
    let start = Pose {
        translation: [1.0, -2.0, 0.5].into(),
        ..Pose::IDENTITY
    };
    let modes = [Mode::Fast, Mode::Polish, Mode::Verify, Mode::Refine];
    let mut tasks = Vec::new();
    for (i, mode) in modes.into_iter().enumerate() {
        let mut task = reagent_task();
        task.mode = i as i32;
        task.start = start.into();
        let expected = Task {
            mode,
            ..Task::new(Start::at(start))
        };
        tasks.push((task, expected));
    }
    const EYE: [f32; 3] = [50.0, -300.0, 200.0];
    static BEHIND: [[f32; 3]; 2] = [[0.0, 300.0, -100.0], [20.0, 310.0, -90.0]];
    let mut view = reagent_task();
    view.view_point = EYE.as_ptr();
    (view.background, view.background_points) = (BEHIND.as_flattened().as_ptr(), BEHIND.len());
    (view.steps, view.rotation_rad, view.along, view.across) = (2, 0.1, 0.2, 0.3);
    let uncertainty = Uncertainty {
        rotation_rad: 0.1,
        along: 0.2,
        across: 0.3,
    };
    let expected = Task {
        steps: 2,
        view_point: Some(EYE.into()),
        background: &BEHIND,
        ..Task::new(Start::Pose(Pose::IDENTITY, uncertainty))
    };
    tasks.push((view, expected));
    let mut anywhere = reagent_task();
    anywhere.anywhere = 1;
    tasks.push((anywhere, Task::new(Start::Anywhere)));
    tasks
}

/// What C is told of what Rust found.
#[cfg(feature = "pretrained-compact")]
fn told(found: &Answer) -> ReagentAnswer {
    let steps = found.policy.map_or(0, |policy| policy.steps);
    let refinement = found.refinement.as_ref();
    ReagentAnswer::of(found.target_from_source, found.verdict, steps, refinement)
}

#[cfg(feature = "pretrained-compact")]
#[test]
fn clouds_are_registered_as_in_rust() {
    use reagent_core::{Policy, Registrar, net::Scratch};
    let (source, target) = (bracket(0.0), bracket(0.37));
    let (from, to) = (source.as_flattened(), target.as_flattened());
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let mut workspace = workspace();
    let mut scratch = Box::new(Scratch::new());
    let policy = Policy::pretrained_compact().expect("a sound policy");
    let mut registrar = Registrar::new(policy, &mut scratch);
    let mut own = Box::new(Workspace::new());
    // SAFETY: pointers to live values.
    let made = unsafe { reagent_init(memory, compact().as_ptr(), compact().len()) };
    assert_eq!(made, ReagentStatus::Ok);
    for (task, expected) in tasks() {
        let clouds = [&source, &target].map(Vec::as_slice);
        let found = pipeline::register(&mut registrar, &mut own, clouds, &expected, |_| {
            Ok::<_, Error>(())
        });
        let mut answer = ReagentAnswer::default();
        // SAFETY: pointers to live values.
        let status = unsafe {
            let (from, to) = (from.as_ptr(), to.as_ptr());
            reagent_register(
                memory,
                &mut *workspace,
                from,
                600,
                to,
                600,
                &task,
                &mut answer,
            )
        };
        assert_eq!(status, ReagentStatus::Ok);
        assert_eq!(answer, told(&found.expect("sound clouds")), "{expected:?}");
        // It ended what was under way.
        // SAFETY: pointers to live values.
        let step = unsafe { reagent_step(memory, null_mut()) };
        assert_eq!(step, ReagentStatus::NotStarted);
        assert_eq!(answer.refined, expected.mode != Mode::Fast);
        if expected.mode.resolved() == Mode::Verify {
            assert_eq!(answer.verdict, ReagentVerdict::Converged, "{answer:?}");
            assert!(
                answer.probability > 0.5 && answer.overlap > 0.9,
                "{answer:?}"
            );
        }
    }
}

#[test]
fn clouds_far_from_the_origin_keep_their_digits() {
    let there = [
        [483_221.0, 5_456_871.0, 310.0],
        [483_250.0, 5_456_840.0, 300.0],
    ];
    let clouds = there.map(|at: [f64; 3]| -> Vec<[f64; 3]> {
        let near = bracket(0.0).into_iter();
        near.map(|p| core::array::from_fn(|k| f64::from(p[k]) + at[k]))
            .collect()
    });
    let mut origins = [[0.0f64; 3]; 2];
    let mut near = clouds
        .each_ref()
        .map(|cloud| vec![[0.0f32; 3]; cloud.len()]);
    for ((cloud, origin), near) in clouds.iter().zip(&mut origins).zip(&mut near) {
        let [xyz, origin, near] = [cloud.as_ptr().cast(), origin.as_ptr(), near.as_ptr().cast()];
        // SAFETY: as many doubles and floats as told.
        let told = unsafe {
            reagent_take_origin_off(xyz, cloud.len(), origin.cast_mut(), near.cast_mut().cast())
        };
        assert_eq!(told, ReagentStatus::Ok);
    }
    // Of the same cloud in two places the origins differ as the places do, and what is left is the same.
    for k in 0..3 {
        let apart = there[1][k] - there[0][k];
        assert!((origins[1][k] - origins[0][k] - apart).abs() < 1e-6);
    }
    let turned = Pose {
        rotation: reagent_core::pose::rotation_from_euler([0.3, -0.2, 0.5].into()),
        translation: [1.0, 2.0, 3.0].into(),
    };
    let given = ReagentPose::from(turned);
    let (mut rows, mut back) = ([[0.0f64; 4]; 3], ReagentPose::default());
    let [from, to] = origins.each_ref().map(|origin| origin.as_ptr());
    // SAFETY: twelve doubles, and three for each origin.
    let told = unsafe { reagent_far_pose(&given, from, to, rows.as_mut_ptr().cast()) };
    assert_eq!(told, ReagentStatus::Ok);
    // SAFETY: as above.
    let told = unsafe { reagent_near_pose(rows.as_ptr().cast(), from, to, &mut back) };
    assert_eq!(told, ReagentStatus::Ok);
    for (a, b) in given
        .rows
        .as_flattened()
        .iter()
        .zip(back.rows.as_flattened())
    {
        assert!((a - b).abs() < 1e-6, "{given:?} {back:?}");
    }
    // A point and its place agree to a tenth of a millimetre, and the rotation is one in all digits.
    let p = clouds[0][17];
    let [x, y, z] = turned.apply(near[0][17].into()).to_array().map(f64::from);
    for (k, [row, near]) in rows
        .iter()
        .zip([x, y, z])
        .map(|(r, n)| [r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3], n])
        .enumerate()
    {
        assert!((row - near - origins[1][k]).abs() < 1e-4);
        let [a, b, c, _] = rows[k];
        assert!((a * a + b * b + c * c - 1.0).abs() < 1e-12);
    }
    // SAFETY: null is refused.
    let told = unsafe { reagent_far_pose(&given, core::ptr::null(), to, rows.as_mut_ptr().cast()) };
    assert_eq!(told, ReagentStatus::Pointer);
}

#[test]
fn a_pose_is_refined_as_in_rust() {
    let (source, target) = (bracket(0.0), bracket(0.37));
    let (from, to) = (source.as_flattened(), target.as_flattened());
    let mut workspace = workspace();
    let mut own = Box::new(Workspace::new());
    let reached = Pose {
        translation: [0.5, 0.25, -1.0].into(),
        ..Pose::IDENTITY
    };
    for (task, expected) in tasks() {
        let clouds = [&source, &target].map(Vec::as_slice);
        let found = pipeline::refine(&mut own, clouds, reached, &expected, || Ok::<_, Error>(()));
        let found = found.expect("sound clouds");
        let mut answer = ReagentAnswer::default();
        // SAFETY: pointers to live values.
        let status = unsafe {
            let (from, to) = (from.as_ptr(), to.as_ptr());
            let reached = ReagentPose::from(reached);
            reagent_refine(
                &mut *workspace,
                from,
                600,
                to,
                600,
                &reached,
                &task,
                &mut answer,
            )
        };
        assert_eq!(status, ReagentStatus::Ok);
        let pose = found.map_or(reached, |found| found.refined.target_from_source);
        assert_eq!(answer.target_from_source, pose.into());
        let probability = found.map_or(0.0, |found| found.evidence.probability());
        assert_eq!(answer.probability, probability);
    }
}

/// A sphere against itself, turned: any turn about any axis fits; a box: half turns do.
#[test]
fn what_is_undetermined_is_told() {
    let mut workspace = workspace();
    let mut refined = |points: &[[f32; 3]]| {
        let xyz = points.as_flattened().as_ptr();
        let mut task = reagent_task();
        task.anywhere = 1;
        let mut answer = ReagentAnswer::default();
        let n = points.len();
        // SAFETY: pointers to live values.
        let status = unsafe {
            reagent_refine(
                &mut *workspace,
                xyz,
                n,
                xyz,
                n,
                &task.start,
                &task,
                &mut answer,
            )
        };
        assert_eq!(status, ReagentStatus::Ok);
        answer
    };
    let turned = |i: u16| {
        let z = f32::from(i) / 300.0 - 1.0;
        let (sine, cosine) = (f32::from(i) * 2.399_963).sin_cos();
        let radius = 0.3 + 0.2 * z * z;
        [radius * cosine, radius * sine, z]
    };
    let vase = refined(&(0..600).map(turned).collect::<Vec<_>>());
    // The same points fix the angle: turned by a little they fit worse. Without them only the axis would be told.
    assert!(vase.verdict == ReagentVerdict::Converged, "{vase:?}");
    let on_box = |i: u16| {
        let [a, b] = [0.754_877_7, 0.569_840_3].map(|step| (f32::from(i) * step).fract() - 0.5);
        let side = if i.is_multiple_of(2) { 0.5 } else { -0.5 };
        match i / 2 % 3 {
            0 => [a, 2.0 * b, 3.0 * side],
            1 => [a, 2.0 * side, 3.0 * b],
            _ => [side, 2.0 * a, 3.0 * b],
        }
    };
    let box_of = refined(&(0..900).map(on_box).collect::<Vec<_>>());
    assert_eq!(box_of.verdict, ReagentVerdict::Converged, "{box_of:?}");
    let named = box_of.other_poses.iter().take(box_of.others as usize);
    for pose in named {
        assert!(Pose::from_rows(pose.rows).checked().is_ok());
    }
}

#[test]
fn what_cannot_be_registered_is_refused_and_changes_nothing() {
    let (source, target) = (bracket(0.0), bracket(0.37));
    let (from, to) = (
        source.as_flattened().as_ptr(),
        target.as_flattened().as_ptr(),
    );
    let mut unsound = target.clone();
    unsound[7][1] = 2e12;
    let unsound = unsound.as_flattened().as_ptr();
    let one_place = [[1.0f32; 3]; 9];
    let one_place = one_place.as_flattened().as_ptr();
    let mut workspace = workspace();
    let workspace: *mut ReagentWorkspace = &raw mut *workspace;
    let mut untouched = memory();
    let untouched: *mut ReagentMemory = &raw mut *untouched;
    let good = reagent_task();
    let with = |change: fn(&mut ReagentTask)| {
        let mut task = good;
        change(&mut task);
        task
    };
    static NOWHERE: [f32; 3] = [0.0, f32::NAN, 0.0];
    let bent = ReagentPose {
        rows: [[2.0; 4]; 3],
    };
    let mut answer = ReagentAnswer::default();
    let into = &raw mut answer;
    let odd = into.wrapping_byte_add(1);
    let at = &good.start;
    use ReagentStatus::*;
    // SAFETY: pointers to live values, or such as must be refused.
    let found = unsafe {
        let refine =
            |task: ReagentTask| reagent_refine(workspace, from, 600, to, 600, at, &task, into);
        [
            (refine(with(|task| task.mode = 4)), NoSuchMode),
            (refine(with(|task| task.mode = -1)), NoSuchMode),
            (refine(with(|task| task.along = -1.0)), BadUncertainty),
            (
                refine(with(|task| task.rotation_rad = f32::NAN)),
                BadUncertainty,
            ),
            (
                refine(with(|task| task.view_point = NOWHERE.as_ptr())),
                BadViewPoint,
            ),
            (
                refine(with(|task| {
                    task.view_point = NOWHERE.as_ptr().wrapping_byte_add(1)
                })),
                Pointer,
            ),
            (refine(with(|task| task.background_points = 9)), Pointer),
            (
                refine(with(|task| task.background_points = 1 << 20)),
                TooManyPoints,
            ),
            (
                refine(with(|task| task.start.rows[0][3] = f32::INFINITY)),
                BadPose,
            ),
            (
                reagent_refine(workspace, from, 600, to, 600, &bent, &good, into),
                BadPose,
            ),
            (
                reagent_refine(workspace, from, 600, to, 600, null(), &good, into),
                Pointer,
            ),
            (
                reagent_refine(workspace, from, 600, to, 600, at, null(), into),
                Pointer,
            ),
            (
                reagent_refine(workspace, from, 600, to, 600, at, &good, odd),
                Pointer,
            ),
            (
                reagent_refine(null_mut(), from, 600, to, 600, at, &good, into),
                Pointer,
            ),
            (
                reagent_refine(workspace, null(), 600, to, 600, at, &good, into),
                Pointer,
            ),
            (
                reagent_refine(workspace, from, 2, to, 600, at, &good, into),
                TooFewPoints,
            ),
            (
                reagent_refine(workspace, from, 600, to, 0, at, &good, into),
                TargetEmpty,
            ),
            (
                reagent_refine(workspace, from, 600, to, 4097, at, &good, into),
                TargetTooManyPoints,
            ),
            (
                reagent_refine(workspace, unsound, 600, to, 600, at, &good, into),
                NotFinite,
            ),
            (
                reagent_refine(workspace, from, 600, unsound, 600, at, &good, into),
                TargetNotFinite,
            ),
            (
                reagent_refine(workspace, one_place, 9, to, 600, at, &good, into),
                NoExtent,
            ),
            (
                reagent_refine(workspace, from, 600, one_place, 9, at, &good, into),
                NoExtent,
            ),
            (
                reagent_register(untouched, workspace, from, 600, to, 600, &good, into),
                NotInitialised,
            ),
            (
                reagent_register(null_mut(), workspace, from, 600, to, 600, &good, into),
                Pointer,
            ),
        ]
    };
    for (index, (found, expected)) in found.into_iter().enumerate() {
        assert_eq!(found, expected, "call {index}");
    }
    assert_eq!(answer, ReagentAnswer::default());
}

/// Of any bits, on a border, or ordinary.
fn number(random: &mut u32) -> f32 {
    const BORDERS: [f32; 8] = [
        0.0,
        -0.0,
        1e-45,
        1e12,
        3.4e38,
        f32::INFINITY,
        f32::NAN,
        -1e-20,
    ];
    let mut next = || {
        *random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *random >> 8
    };
    match next() % 16 {
        0 => f32::from_bits(next() << 8),
        1 => BORDERS[next() as usize % BORDERS.len()],
        _ => next() as f32 / 8_388_608.0 - 1.0,
    }
}

#[test]
fn whatever_comes_in_only_poses_go_out() {
    let mut workspace = workspace();
    let mut random = 7;
    let mut done = 0;
    for case in 0..400 {
        let mut cloud = |points: usize| -> Vec<[f32; 3]> {
            let unit = 10f32.powi(case % 25 - 12);
            let ordinary = |i: usize| [i % 5, i % 7, i % 3].map(|x| x as f32 * unit);
            let mut cloud: Vec<_> = (0..points).map(ordinary).collect();
            if case % 3 == 0 {
                cloud[1] = core::array::from_fn(|_| number(&mut random));
            }
            cloud
        };
        let (source, target) = (cloud(40), cloud(60));
        let mut task = reagent_task();
        task.mode = case % 4;
        task.anywhere = u32::from(case % 7 == 0);
        let mut spoilt = |often: i32, x: &mut f32| {
            if case % often == 0 {
                *x = number(&mut random);
            }
        };
        spoilt(5, &mut task.along);
        spoilt(11, &mut task.rotation_rad);
        let mut reached = task.start;
        spoilt(2, &mut reached.rows[1][3]);
        spoilt(13, &mut reached.rows[0][0]);
        spoilt(6, &mut task.start.rows[2][3]);
        let eye: [f32; 3] = core::array::from_fn(|_| number(&mut random));
        if case % 2 == 0 {
            task.view_point = eye.as_ptr();
        }
        let (from, to) = (source.as_flattened(), target.as_flattened());
        let mut answer = ReagentAnswer::default();
        // SAFETY: pointers to live values.
        let status = unsafe {
            let (from, to) = (from.as_ptr(), to.as_ptr());
            reagent_refine(
                &mut *workspace,
                from,
                40,
                to,
                60,
                &reached,
                &task,
                &mut answer,
            )
        };
        if status != ReagentStatus::Ok {
            assert_eq!(answer, ReagentAnswer::default());
            continue;
        }
        done += 1;
        let others = answer.other_poses.iter().take(answer.others as usize);
        for pose in [&answer.target_from_source].into_iter().chain(others) {
            assert!(
                Pose::from_rows(pose.rows).checked().is_ok(),
                "{case} {pose:?}"
            );
        }
        assert!((0.0..=1.0).contains(&answer.probability), "{case}");
        let covariance = answer.covariance.as_flattened();
        assert!(
            covariance.iter().all(|x| x.is_finite()),
            "{case} {covariance:?}"
        );
    }
    assert!(done > 100, "{done}");
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
