//! Clouds, starts, view points and frames with any numbers: the answer is true, and its pose is rigid.

use super::{cases, number};
use glam::Vec3;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseError;
use reagent_core::evidence::FEWEST_DISTINCT;
use reagent_core::net::Scratch;
use reagent_core::pipeline::{self, Answer, Mode, Progress, Task};
use reagent_core::polish::{Refined, Workspace};
use reagent_core::pose::rotation_from_euler;
use reagent_core::start::{Start, Uncertainty};
use reagent_core::{Error, Frame, Policy, Pose, Registrar, Verdict};
use std::collections::BTreeSet;

type Cloud = Vec<[f32; 3]>;

/// A point on a surface, from two numbers from -1 to 1.
fn on(shape: u8, u: f32, v: f32) -> [f32; 3] {
    let angle = core::f32::consts::PI * v;
    let width = (1.0 - u * u).max(0.0).sqrt();
    let [x, y, z] = [width * angle.cos(), width * angle.sin(), u];
    match shape {
        0 => [x, y, z],
        1 => [x, 0.5 * y, z.abs()],
        2 => [0.2 * x, y, z],
        3 => [u, v, 0.0],
        4 => [u, 0.0, 0.0],
        5 => [u, u, u],
        6 => [(4.0 * v).round(), (4.0 * u).round(), 0.0],
        // A bracket: two plates.
        _ if v > 0.0 => [u, 2.0 * v - 1.0, 0.0],
        _ => [u, 1.0, 0.6 * (v + 1.0)],
    }
}

/// A cloud of some shape, unit and place; some points coincide, some are replaced.
fn made() -> impl Strategy<Value = Cloud> {
    let points = vec((-1.0f32..1.0, -1.0f32..1.0), 3..300);
    let unit = prop_oneof![Just(1.0f32), (-30i32..=30).prop_map(|e| 10f32.powi(e))];
    let offset = prop_oneof![3 => Just(0.0f32), 1 => number()];
    let repeated = prop_oneof![2 => Just(0.0f32), 1 => 0.0f32..1.0];
    let replaced = prop_oneof![
        2 => Just(Vec::new()),
        1 => vec((any::<prop::sample::Index>(), [number(), number(), number()]), 1..4),
    ];
    (0u8..9, points, unit, offset, repeated, replaced).prop_map(
        |(shape, points, unit, offset, repeated, replaced)| {
            let place = |&(u, v): &(f32, f32)| on(shape, u, v).map(|x| x * unit + offset);
            let mut cloud: Cloud = points.iter().map(place).collect();
            let (count, first) = ((repeated * cloud.len() as f32) as usize, cloud[0]);
            cloud[..count].fill(first);
            for (at, [x, y, z]) in replaced {
                let at = at.index(cloud.len());
                cloud[at] = [x, y, z];
            }
            cloud
        },
    )
}

fn cloud() -> impl Strategy<Value = Cloud> {
    prop_oneof![
        6 => made(),
        1 => vec([number(), number(), number()], 0..200),
    ]
}

/// Two clouds: of different shapes, or one of them the other, moved or in another unit.
fn clouds() -> impl Strategy<Value = [Cloud; 2]> {
    let moved = (made(), pose(), -5i32..=5).prop_map(|(cloud, pose, exponent)| {
        let unit = 10f32.powi(exponent);
        let source = cloud
            .iter()
            .map(|&p| (pose.apply(p.into()) * unit).to_array());
        [source.collect(), cloud]
    });
    prop_oneof![[cloud(), cloud()], moved]
}

fn pose() -> impl Strategy<Value = Pose> {
    let turned = (
        [-4.0f32..4.0, -4.0f32..4.0, -4.0f32..4.0],
        (number(), -1.0f32..1.0, -1.0f32..1.0),
    );
    let turned = turned.prop_map(|(angles, translation)| Pose {
        rotation: rotation_from_euler(angles.into()),
        translation: translation.into(),
    });
    let row = || [number(), number(), number(), number()];
    let any = [row(), row(), row()].prop_map(Pose::from_rows);
    prop_oneof![2 => Just(Pose::IDENTITY), 4 => turned, 1 => any]
}

fn start() -> impl Strategy<Value = Start> {
    let uncertain = (pose(), [number(), number(), number()]);
    let uncertain = uncertain.prop_map(|(pose, [rotation_rad, along, across])| {
        let uncertainty = Uncertainty {
            rotation_rad,
            along,
            across,
        };
        Start::Pose(pose, uncertainty)
    });
    prop_oneof![pose().prop_map(Start::at), uncertain, Just(Start::Anywhere)]
}

/// Points that no sensor sees, or that are as far away as possible.
static BACKGROUND: [[f32; 3]; 5] = [
    [f32::NAN; 3],
    [f32::INFINITY, 0.0, 1.0],
    [f32::MAX, -f32::MAX, f32::MIN_POSITIVE],
    [0.0; 3],
    [1e12, 1.0, -1e12],
];

fn task() -> impl Strategy<Value = Task<'static>> {
    const MODES: [Mode; 4] = [Mode::Fast, Mode::Polish, Mode::Verify, Mode::Refine];
    let view_point = prop_oneof![Just(None), [number(), number(), number()].prop_map(Some)];
    let frame = prop_oneof![
        4 => Just(None),
        1 => ([number(), number(), number()], number()).prop_map(Some),
    ];
    (
        prop::sample::select(&MODES[..]),
        start(),
        0usize..11,
        view_point,
        frame,
    )
        .prop_map(|(mode, start, steps, view_point, frame)| Task {
            mode,
            steps,
            view_point: view_point.map(Vec3::from_array),
            background: &BACKGROUND,
            frame: frame.map(|(centre, scale)| Frame {
                centre: Vec3::from_array(centre),
                scale,
            }),
            ..Task::new(start)
        })
}

fn register([source, target]: [&[[f32; 3]]; 2], task: &Task) -> Result<Answer, Error> {
    let policy = Policy::pretrained_compact().expect("a sound policy");
    let mut scratch = Box::new(Scratch::new());
    let mut workspace = Box::new(Workspace::new());
    let mut registrar = Registrar::new(policy, &mut scratch);
    let watch = |progress: Progress<'_, '_>| {
        if let Progress::Step(_, registration) = progress {
            // Robots publish this pose.
            registration.target_from_source().checked()?;
        }
        Ok(())
    };
    pipeline::register(
        &mut registrar,
        &mut workspace,
        [source, target],
        task,
        watch,
    )
}

fn distinct(cloud: &[[f32; 3]]) -> usize {
    // Zeros of either sign are equal.
    let bits = cloud.iter().map(|p| p.map(|x| (x + 0.0).to_bits()));
    bits.collect::<BTreeSet<_>>().len()
}

fn check(answer: &Answer, clouds: [&[[f32; 3]]; 2]) -> Result<(), TestCaseError> {
    let is_a_pose = |pose: Pose| pose.checked().is_ok();
    prop_assert!(is_a_pose(answer.target_from_source));
    if let Some(policy) = answer.policy {
        prop_assert!(is_a_pose(policy.target_from_source), "{policy:?}");
    }
    let Some(found) = &answer.refinement else {
        // The policy's own verdict does not count if there is hardly anything to see.
        let few = clouds
            .map(distinct)
            .into_iter()
            .any(|n| n < FEWEST_DISTINCT);
        prop_assert!(!few || answer.verdict != Verdict::Converged, "{answer:?}");
        return Ok(());
    };
    let share = |x: f32| (0.0..=1.0).contains(&x);
    let probability = answer.probability.expect("of a refined pose");
    prop_assert!(share(probability));
    for Refined {
        target_from_source,
        residual,
        rotation_constraint,
        overlap,
        inlier_rmse,
        extents_ratio,
        ..
    } in [found.refined, found.polished]
    {
        prop_assert!(is_a_pose(target_from_source));
        prop_assert!(
            share(residual.source) && share(residual.target),
            "{residual:?}"
        );
        prop_assert!(share(overlap) && share(rotation_constraint) && inlier_rmse >= 0.0);
        prop_assert!(inlier_rmse.is_finite() && extents_ratio.is_finite() && extents_ratio >= 0.0);
    }
    for &pose in found.undetermined.poses.iter().flatten() {
        prop_assert!(is_a_pose(pose));
    }
    if let Some(axis) = found.undetermined.axis {
        prop_assert!(axis.point.is_finite() && (axis.direction.length() - 1.0).abs() < 1e-3);
    }
    if answer.verdict == Verdict::Converged {
        let residual = found.refined.residual;
        prop_assert!(
            residual.source < 0.95 && residual.target < 0.995,
            "{residual:?}"
        );
        prop_assert!(probability >= 0.5);
        let fewest = clouds.map(distinct).into_iter().min();
        prop_assert!(
            fewest >= Some(FEWEST_DISTINCT),
            "{fewest:?} distinct points"
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(400))]

    #[test]
    fn nothing_untrue_is_said(clouds in clouds(), task in task()) {
        let clouds = clouds.each_ref().map(Vec::as_slice);
        if let Ok(answer) = register(clouds, &task) {
            check(&answer, clouds)?;
        }
    }
}

/// 800 points each: a target, a second sample of it, and another object.
fn drawn() -> [Cloud; 3] {
    let golden = 0.618_034_f32;
    let point = |shape: u8, i: usize| {
        let u = 2.0 * ((i as f32 + 0.5) / 800.0) - 1.0;
        let v = 2.0 * (i as f32 * golden).fract() - 1.0;
        on(shape, u, v)
    };
    let again = |i: usize| {
        let u = 2.0 * ((i as f32 + 0.1) / 800.0) - 1.0;
        let v = 2.0 * (i as f32 * golden + 0.3).fract() - 1.0;
        on(1, u, v)
    };
    [
        (0..800).map(|i| point(1, i)).collect(),
        (0..800).map(again).collect(),
        (0..800).map(|i| point(2, i)).collect(),
    ]
}

/// Every case in which a wrong pose was called right, or a pose was infinite.
#[test]
fn what_once_was_called_right_is_not() {
    let [target, same, other] = drawn();
    let verdict = |source: &Cloud, target: &Cloud| -> Result<Verdict, Error> {
        let clouds = [source, target].map(Vec::as_slice);
        let answer = register(clouds, &Task::new(Start::at(Pose::IDENTITY)))?;
        check(&answer, clouds).expect("true");
        Ok(answer.verdict)
    };
    assert_eq!(verdict(&same, &target), Ok(Verdict::Converged));

    let spoilt = |cloud: &Cloud, by: &dyn Fn(usize, &mut [f32; 3])| {
        let mut cloud = cloud.clone();
        cloud.iter_mut().enumerate().for_each(|(i, p)| by(i, p));
        cloud
    };
    let mut wrong = vec![other.clone()];
    for zeros in [24, 25, 26, 50, 100, 200, 400, 700, 790, 797] {
        wrong.push(spoilt(&other, &|i, p| {
            if i < zeros {
                *p = [0.0; 3]
            }
        }));
    }
    wrong.push(spoilt(&same, &|i, p| {
        if i < 790 {
            *p = [0.0; 3]
        }
    }));
    for exponent in [3, 9, 18, 20, 30] {
        wrong.push(spoilt(&other, &|_, p| {
            *p = p.map(|x| x * 10f32.powi(exponent))
        }));
        wrong.push(spoilt(&other, &|_, p| {
            *p = p.map(|x| x + 10f32.powi(exponent))
        }));
    }
    for far in [
        1e6,
        1e10,
        1e15,
        1e18,
        1e19,
        1e20,
        1e25,
        1e30,
        3.4e38,
        f32::NAN,
    ] {
        wrong.push(spoilt(&other, &|i, p| {
            if i == 5 {
                p[2] = far
            }
        }));
    }
    for (i, source) in wrong.iter().enumerate() {
        assert_ne!(verdict(source, &target), Ok(Verdict::Converged), "{i}");
    }
    let all_at = |point| vec![point; 800];
    for place in [[0.0; 3], [0.3, 0.2, 0.1]] {
        assert_eq!(verdict(&all_at(place), &target), Err(Error::NoExtent));
    }
    for bad in [
        spoilt(&all_at([0.0; 3]), &|i, p| {
            if i == 0 {
                p[0] = 1.0
            }
        }),
        spoilt(&target, &|i, p| {
            if i == 3 {
                p[0] = 1e10
            }
        }),
        spoilt(&target, &|i, p| {
            if i < 400 {
                *p = [0.0; 3]
            }
        }),
        spoilt(&target, &|_, p| *p = p.map(|x| x * 1e-20)),
    ] {
        assert_ne!(verdict(&other, &bad), Ok(Verdict::Converged));
    }
}

/// Neither the policy alone nor the pipeline gives a pose that is not rigid.
#[test]
fn starts_and_frames_that_are_none_are_refused() {
    let [target, same, _] = drawn();
    let clouds = [&same, &target].map(Vec::as_slice);
    let policy = Policy::pretrained_compact().expect("a sound policy");
    let mut scratch = Box::new(Scratch::new());
    let mut registrar = Registrar::new(policy, &mut scratch);
    let mut far = Pose::IDENTITY;
    far.translation.x = 3e38;
    let frame = Frame::of(&target).expect("extent");
    let found = registrar.register(clouds[0], clouds[1], frame, far, 10);
    assert_eq!(found.err(), Some(Error::BadPose));
    for scale in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-38, 1e38] {
        let frame = Frame { scale, ..frame };
        let found = registrar.register(clouds[0], clouds[1], frame, Pose::IDENTITY, 10);
        assert_eq!(found.err(), Some(Error::BadFrame), "{scale}");
        for mode in [Mode::Fast, Mode::Verify] {
            let task = Task {
                mode,
                frame: Some(frame),
                ..Task::new(Start::Anywhere)
            };
            assert_eq!(register(clouds, &task).err(), Some(Error::BadFrame));
        }
    }
    let nowhere = Vec3::new(f32::NAN, 0.0, 0.0);
    let task = Task {
        view_point: Some(nowhere),
        ..Task::new(Start::Anywhere)
    };
    assert_eq!(register(clouds, &task).err(), Some(Error::BadViewPoint));
}
