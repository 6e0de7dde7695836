//! Whole registrations and refined poses: the same as in Rust.

use super::*;
use reagent_core::Error;
#[cfg(feature = "pretrained-compact")]
use reagent_core::pipeline::Answer;
use reagent_core::pipeline::{self, Mode, Task};
use reagent_core::polish::Workspace;
use reagent_core::start::{Start, Uncertainty};

/// Every kind of task, and its equivalent in Rust.
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
    static UPWARD: [[f32; 3]; 600] = [[0.0, 0.0, 1.0]; 600];
    let mut view = reagent_task();
    view.view_point = EYE.as_ptr();
    (view.background, view.background_points) = (BEHIND.as_flattened().as_ptr(), BEHIND.len());
    (view.outward, view.outward_directions) = (UPWARD.as_flattened().as_ptr(), UPWARD.len());
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
        outward: &UPWARD,
        ..Task::new(Start::Pose(Pose::IDENTITY, uncertainty))
    };
    tasks.push((view, expected));
    let mut anywhere = reagent_task();
    anywhere.anywhere = 1;
    tasks.push((anywhere, Task::new(Start::Anywhere)));
    tasks
}

/// What C reports of an answer in Rust.
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
        // It ended the registration in progress.
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

#[test]
fn a_prepared_model_changes_no_bit_and_one_of_another_target_is_left_aside() {
    let (source, target) = (bracket(0.0), bracket(0.37));
    let (from, to) = (
        source.as_flattened().as_ptr(),
        target.as_flattened().as_ptr(),
    );
    let (mut workspace, mut model) = (workspace(), model());
    let refined = |model: *const ReagentModel, workspace: &mut ReagentWorkspace| {
        let mut task = reagent_task();
        task.model = model;
        let mut answer = ReagentAnswer::default();
        let at = &task.start;
        // SAFETY: pointers to live values.
        let status =
            unsafe { reagent_refine(workspace, from, 600, to, 600, at, &task, &mut answer) };
        assert_eq!(status, ReagentStatus::Ok);
        answer
    };
    let expected = refined(null(), &mut workspace);
    for prepared in [to, from] {
        // SAFETY: pointers to live values.
        let status = unsafe { reagent_prepare(&mut *model, &mut *workspace, prepared, 600) };
        assert_eq!(status, ReagentStatus::Ok);
        assert_eq!(refined(&*model, &mut workspace), expected);
    }
}

#[test]
fn pixels_without_a_depth_may_stand_in_the_background() {
    let (source, target) = (bracket(0.0), bracket(0.37));
    let (from, to) = (source.as_flattened(), target.as_flattened());
    let eye = [50.0f32, 20.0, 500.0];
    let mut workspace = workspace();
    let mut refined = |background: &[[f32; 3]]| {
        let mut task = reagent_task();
        task.view_point = eye.as_ptr();
        task.background = background.as_flattened().as_ptr();
        task.background_points = background.len();
        let mut answer = ReagentAnswer::default();
        let (from, to, at) = (from.as_ptr(), to.as_ptr(), &task.start);
        // SAFETY: pointers to live values.
        let status =
            unsafe { reagent_refine(&mut *workspace, from, 600, to, 600, at, &task, &mut answer) };
        assert_eq!(status, ReagentStatus::Ok);
        answer
    };
    let wall = |i: u16| {
        [
            f32::from(i % 40) * 4.0 - 30.0,
            f32::from(i / 40) * 4.0 - 30.0,
            -90.0,
        ]
    };
    let mut background: Vec<[f32; 3]> = (0..1600).map(wall).collect();
    let expected = refined(&background);
    background.extend([
        [f32::NAN; 3],
        [0.0, f32::NAN, 0.0],
        [0.0, 0.0, f32::NEG_INFINITY],
    ]);
    assert_eq!(refined(&background), expected);
}

/// A turned sphere against itself fits under any turn about any axis; a box fits under half turns.
#[test]
fn what_is_undetermined_is_told() {
    let mut workspace = workspace();
    let mut refined = |source: &[[f32; 3]], target: &[[f32; 3]]| {
        let [from, to] = [source, target].map(|points| points.as_flattened().as_ptr());
        let mut task = reagent_task();
        task.anywhere = 1;
        let mut answer = ReagentAnswer::default();
        // SAFETY: pointers to live values.
        let status = unsafe {
            reagent_refine(
                &mut *workspace,
                from,
                source.len(),
                to,
                target.len(),
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
    let vase: Vec<_> = (0..600).map(turned).collect();
    let vase = refined(&vase, &vase);
    // The shared points fix the angle: turned by a little, they fit worse. Without them, only the axis would be known.
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
    let box_of: Vec<_> = (0..900).map(on_box).collect();
    let box_of = refined(&box_of, &box_of);
    assert_eq!(box_of.verdict, ReagentVerdict::Converged, "{box_of:?}");
    assert_eq!((box_of.fold_order, box_of.any_rotation), (0, false));
    let mut numbers = 7u32;
    let mut next = || {
        numbers = numbers.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (numbers >> 8) as f32 / (1 << 24) as f32 - 0.5
    };
    let of_prism = |i: u16| {
        let [a, b] = [next(), next()];
        let turn = f32::from(i % 6) * core::f32::consts::FRAC_PI_3;
        let (sine, cosine) = turn.sin_cos();
        // A side, whose width is that of a hexagon; it grows along the axis.
        let radius = 1.0 + 0.5 * b;
        let [x, y] = [radius, 2.0 * a * radius * 0.577_350_3];
        [x * cosine - y * sine, x * sine + y * cosine, 2.0 * b]
    };
    let both: Vec<_> = (0..1900).map(of_prism).collect();
    let (source, target) = both.split_at(900);
    let prism = refined(source, target);
    assert_eq!(prism.verdict, ReagentVerdict::Converged, "{prism:?}");
    assert_eq!((prism.fold_order, prism.others), (6, 5), "{prism:?}");
    assert!(prism.fold_direction[2].abs() > 0.99, "{prism:?}");
    let named = box_of.other_poses.iter().take(box_of.others as usize);
    for pose in named {
        assert!(Pose::from_rows(pose.rows).checked().is_ok());
    }
}
