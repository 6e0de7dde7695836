//! Bad input: it is refused, or gives nothing but poses.

use super::*;

#[test]
fn calls_out_of_order_and_bad_pointers_are_refused() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let mut result = ReagentResult::default();
    let cloud = [[0.0f32, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let xyz = cloud.as_flattened().as_ptr();
    let grid = ReagentGrid::default();
    // SAFETY: pointers to live values, or pointers that must be refused.
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
    static UNPREPARED: [u64; REAGENT_MODEL_WORDS] = [7; REAGENT_MODEL_WORDS];
    let mut model = model();
    let model: *mut ReagentModel = &raw mut *model;
    static NOWHERE: [f32; 3] = [0.0, f32::NAN, 0.0];
    static AWAY: [[f32; 3]; 600] = [[0.0, 0.0, 1.0]; 600];
    let bent = ReagentPose {
        rows: [[2.0; 4]; 3],
    };
    let mut answer = ReagentAnswer::default();
    let into = &raw mut answer;
    let odd = into.wrapping_byte_add(1);
    let at = &good.start;
    use ReagentStatus::*;
    // SAFETY: pointers to live values, or pointers that must be refused.
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
            (
                refine(with(|task| task.model = (&raw const UNPREPARED).cast())),
                NotPrepared,
            ),
            (
                refine(with(|task| {
                    task.model = null::<ReagentModel>().wrapping_byte_add(1)
                })),
                Pointer,
            ),
            (reagent_prepare(model, workspace, one_place, 9), NoExtent),
            (reagent_prepare(model, workspace, to, 0), TargetEmpty),
            (
                reagent_prepare(model, workspace, unsound, 600),
                TargetNotFinite,
            ),
            (reagent_prepare(model, null_mut(), to, 600), Pointer),
            (reagent_prepare(null_mut(), workspace, to, 600), Pointer),
            (refine(with(|task| task.background_points = 9)), Pointer),
            (
                refine(with(|task| task.background_points = 1 << 20)),
                BackgroundTooManyPoints,
            ),
            (refine(with(|task| task.outward_directions = 600)), Pointer),
            (
                refine(with(|task| {
                    (task.outward, task.outward_directions) = (AWAY.as_flattened().as_ptr(), 599)
                })),
                OutwardCount,
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

/// A number of random bits, at a border, or ordinary.
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
