use super::Undetermined;
use crate::Error;
use crate::pipeline::{Mode, Task, refine};
use crate::polish::Workspace;
use crate::polish::tests::{Numbers, moved, pose};
use crate::pose::Pose;
use crate::start::Start;
use crate::verify::tests::{brick, revolved, vase, verify};
use core::f32::consts::PI;
use glam::Vec3;

#[test]
fn how_far_a_piece_of_a_bar_may_be_moved_along_it_is_told() {
    let mut numbers = Numbers(7);
    let mut bar = |count: usize, least: f32, most: f32| -> Vec<[f32; 3]> {
        let point = |k: usize| {
            let (along, across) = (numbers.next(), numbers.next());
            let x = least + (most - least) * 0.5 * (along + 1.0);
            match k % 4 {
                0 => [x, 0.2 * across, 0.1],
                1 => [x, 0.2 * across, -0.1],
                2 => [x, 0.2, 0.1 * across],
                _ => [x, -0.2, 0.1 * across],
            }
        };
        (0..count).map(point).collect()
    };
    // More points than are compared: of both clouds some of everywhere.
    let (target, piece) = (bar(1500, -1.0, 1.0), bar(1200, -0.6, 0.2));
    let found = verify(&piece, &target, Pose::IDENTITY);
    let slide = found.undetermined.slide.expect("a direction");
    assert!(slide.direction.x.abs() > 0.99, "{slide:?}");
    let middle = found.best.target_from_source.apply([-0.2, 0.0, 0.0].into());
    for shift in slide.range {
        let end = middle.x + shift * slide.direction.x;
        assert!((0.45..0.75).contains(&end.abs()), "{end} {slide:?}");
    }
    assert_eq!(found.undetermined.axis, None);
}

#[test]
fn a_body_of_revolution_may_be_turned_by_any_angle() {
    let mut numbers = Numbers(9);
    let mut vases = || revolved(&mut numbers, 1000, vase, 0.8);
    let (source, target) = (vases(), vases());
    let found = verify(&source, &target, pose([0.0, 0.05, 0.4], [0.02, 0.0, 0.0]));
    let axis = found.undetermined.axis.expect("an axis");
    assert!(axis.direction.z.abs() > 0.99, "{axis:?}");
    assert_eq!(axis.range_rad, [-PI, PI]);
}

/// Points of a thin-walled tube. Neighbourhoods take in both sides of its wall, so estimated normals tell little of it.
fn tube(numbers: &mut Numbers, count: usize) -> Vec<[f32; 3]> {
    let sides = [0.55, 0.45].map(|radius| (radius, count / 2));
    let side = |(radius, count)| {
        let side = revolved(numbers, count, |_| 1.0, 0.5).into_iter();
        side.map(move |[x, y, z]| [radius * x, radius * y, z])
    };
    sides.into_iter().flat_map(side).collect()
}

#[test]
fn a_tube_and_a_part_of_a_rod_may_be_turned_by_any_angle() {
    let mut numbers = Numbers(17);
    let mut rod = |count| revolved(&mut numbers, count, |_| 0.4, 0.9);
    let (whole, mut part) = (rod(1000), rod(1400));
    // Its centre is beside the axis.
    part.retain(|&[x, ..]| x > -0.15);
    let tubes = [(); 2].map(|()| tube(&mut numbers, 1000));
    let [first, second] = tubes;
    for (source, target) in [(first, second), (whole, part)] {
        let found = verify(&source, &target, pose([0.0, 0.05, 0.4], [0.02, 0.0, 0.0]));
        let axis = found.undetermined.axis.expect("an axis");
        assert!(axis.direction.z.abs() > 0.99, "{axis:?}");
        assert_eq!(axis.range_rad, [-PI, PI]);
        let across = axis.point.truncate().length();
        assert!(across < 0.05, "{axis:?}");
        assert!(!found.undetermined.any_rotation);
    }
}

#[test]
fn a_ball_may_be_turned_about_any_axis_through_its_centre() {
    let mut numbers = Numbers(19);
    let centre = Vec3::new(0.3, -0.2, 0.1);
    let mut ball = || -> Vec<[f32; 3]> {
        let mut point = || Vec3::from_array(numbers.point()).normalize_or(Vec3::X);
        (0..1000).map(|_| (point() + centre).to_array()).collect()
    };
    let (source, target) = (ball(), ball());
    let mut workspace = Box::new(Workspace::new());
    let start = Start::at(pose([0.3, 0.2, 0.4], [0.05, 0.0, 0.0]));
    let task = Task {
        mode: Mode::Verify,
        ..Task::new(start)
    };
    let go_on = || Ok::<(), Error>(());
    let found = refine(
        &mut workspace,
        [&source, &target],
        start.pose(),
        &task,
        go_on,
    );
    let found = found.expect("clouds").expect("a refinement");
    assert!(found.undetermined.any_rotation);
    let covariance = found.refined.covariance;
    assert!(
        (covariance.about - centre).length() < 0.01,
        "{covariance:?}"
    );
    let deviation = |i: usize| covariance.matrix[i][i].sqrt();
    assert!((0..3).all(|i| deviation(i) > 1.0), "{covariance:?}");
    assert!((3..6).all(|i| deviation(i) < 0.02), "{covariance:?}");
}

/// Tracking and quick modes compare no poses, but do not claim to know an angle that planes leave free.
#[test]
fn polishing_alone_tells_of_an_open_turn() {
    let mut numbers = Numbers(23);
    let mut vases = || revolved(&mut numbers, 1000, vase, 0.8);
    let clouds = [&vases()[..], &vases()[..]];
    let block = [
        &brick([0.9, 0.5, 0.3], 1000, 3)[..],
        &brick([0.9, 0.5, 0.3], 1000, 4)[..],
    ];
    let mut workspace = Box::new(Workspace::new());
    let mut refined = |clouds, mode| {
        let task = Task {
            mode,
            ..Task::new(Start::at(Pose::IDENTITY))
        };
        let go_on = || Ok::<(), Error>(());
        let found = refine(&mut workspace, clouds, Pose::IDENTITY, &task, go_on);
        found.expect("clouds").expect("a refinement")
    };
    for mode in [Mode::Polish, Mode::Refine] {
        let found = refined(clouds, mode);
        assert!(found.undetermined.axis.is_some(), "{mode}");
        assert!(found.refined.covariance.matrix[2][2] > 1.0, "{mode}");
        assert_eq!(refined(block, mode).undetermined, Undetermined::NOTHING);
    }
}

/// A piece of a vase's wall may be turned until it reaches the gap in that: farther in one sense than in the other.
#[test]
fn a_turn_may_be_open_farther_in_one_sense_than_in_the_other() {
    let mut numbers = Numbers(13);
    let mut wall = |from: f32, to: f32| -> Vec<[f32; 3]> {
        let whole = revolved(&mut numbers, 3000, vase, 0.8).into_iter();
        let is_between = |p: &[f32; 3]| {
            (from..to).contains(&p[1].atan2(p[0]).rem_euclid(core::f32::consts::TAU))
        };
        whole.filter(is_between).collect()
    };
    let (piece, vase) = (wall(0.6, 3.4), wall(0.3, 6.0));
    let found = verify(&piece, &vase, Pose::IDENTITY);
    let axis = found.undetermined.axis.expect("an axis");
    assert!(axis.direction.z.abs() > 0.99, "{axis:?}");
    let given = found.best.target_from_source.rotation.x_axis;
    let mut turns = axis
        .range_rad
        .map(|turn| given.y.atan2(given.x) + turn * axis.direction.z);
    turns.sort_by(f32::total_cmp);
    let [least, most] = turns;
    assert!(
        (-0.6..-0.1).contains(&least) && (2.3..2.9).contains(&most),
        "{turns:?} {axis:?}"
    );
}

/// A piece of a pin that stands beside a block's middle may be turned about the pin's axis, not about the whole's middle.
#[test]
fn the_axis_goes_through_what_may_be_turned() {
    let mut numbers = Numbers(11);
    let beside = pose([0.0; 3], [0.6, 0.1, 0.5]);
    let mut pin = || {
        let pin = revolved(&mut numbers, 600, |z| 0.25 + 0.1 * z, 0.4);
        moved(&pin, beside)
    };
    let source = pin();
    let block = brick([0.9, 0.5, 0.1], 700, 3);
    let target: Vec<_> = pin().into_iter().chain(block).collect();
    let found = verify(&source, &target, Pose::IDENTITY);
    let axis = found.undetermined.axis.expect("an axis");
    assert!(axis.direction.z.abs() > 0.99, "{axis:?}");
    let at = axis.point + axis.direction * (0.5 - axis.point.z) / axis.direction.z;
    assert!(
        (at.truncate() - glam::Vec2::new(0.6, 0.1)).length() < 0.03,
        "{axis:?}"
    );
}
