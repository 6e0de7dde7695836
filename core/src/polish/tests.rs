use super::*;
use crate::loss::COMPARED;
use crate::pose::rotation_from_euler;
use crate::start::Start;
use proptest::prelude::*;

/// Pseudo-random numbers from -1 to 1.
pub(crate) struct Numbers(pub(crate) u32);

impl Numbers {
    pub(crate) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    pub(crate) fn point(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

/// Points of an uneven box with a knob: no symmetry, planes in every direction.
pub(crate) fn part(n: usize, seed: u32) -> Vec<[f32; 3]> {
    let mut numbers = Numbers(seed);
    let half = [0.8, 0.5, 0.3];
    let mut on_box = |i: usize| {
        let mut p = numbers.point();
        p.iter_mut().zip(half).for_each(|(x, h)| *x *= h);
        p[i % 3] = if i.is_multiple_of(2) {
            half[i % 3]
        } else {
            -half[i % 3]
        };
        if i.is_multiple_of(5) {
            p = [
                0.15 * p[0] + 0.4,
                0.2 * p[1] + 0.2,
                0.3 + 0.5 * (p[2] + 0.3),
            ];
        }
        p
    };
    (0..n).map(&mut on_box).collect()
}

pub(crate) fn moved(cloud: &[[f32; 3]], pose: Pose) -> Vec<[f32; 3]> {
    cloud
        .iter()
        .map(|&p| pose.apply(p.into()).to_array())
        .collect()
}

pub(crate) fn pose(angles: [f32; 3], translation: [f32; 3]) -> Pose {
    Pose {
        rotation: rotation_from_euler(angles.into()),
        translation: translation.into(),
    }
}

/// Angle in degrees, and distance, between two poses.
pub(crate) fn error(a: Pose, b: Pose) -> (f32, f32) {
    let q = glam::Quat::from_mat3(&(a.rotation * b.rotation.transpose())).normalize();
    let angle = 2.0 * q.xyz().length().atan2(q.w.abs());
    (angle.to_degrees(), (a.translation - b.translation).length())
}

fn polish(source: &[[f32; 3]], target: &[[f32; 3]], initial: Pose) -> Refined {
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(source, target, &mut workspace).expect("valid clouds");
    refiner.polish(initial).expect("a rigid pose")
}

#[test]
fn a_right_pose_of_a_thin_part_loses_little_of_a_coarse_look() {
    // Two thin plates, an L: the points are dense, since there is little surface.
    let plates = |seed| {
        let mut numbers = Numbers(seed);
        let plate = |k: usize| {
            let [u, v, side] = numbers.point();
            let side = 0.02 * side.signum();
            match k % 2 {
                0 => [u, 0.15 * v, side],
                _ => [side - 0.98, 0.15 * v, 0.3 * u + 0.3],
            }
        };
        (0..2048).map(plate).collect::<Vec<_>>()
    };
    let (source, target) = (plates(5), plates(6));
    let mut workspace = Box::new(Workspace::new());
    let refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
    let at = refiner.inside(Pose::IDENTITY);
    let loss = refiner.coarse_loss(at, 512, crate::search::SIFT_SCALE);
    assert!(loss < 0.4, "{loss}");
}

#[test]
fn another_sample_of_a_surface_is_found_in_any_unit() {
    let truth = pose([0.1, -0.15, 0.2], [0.05, 0.1, -0.05]);
    for unit in [1.0, 1000.0] {
        let scale = |cloud: Vec<[f32; 3]>| -> Vec<[f32; 3]> {
            cloud.into_iter().map(|p| p.map(|x| x * unit)).collect()
        };
        let source = scale(moved(&part(700, 1), truth.inverse()));
        let target = scale(part(900, 2));
        let found = polish(&source, &target, Pose::IDENTITY);
        let truth = Pose {
            translation: truth.translation * unit,
            ..truth
        };
        let (angle, distance) = error(found.target_from_source, truth);
        assert!(angle < 0.5 && distance < 0.01 * unit, "{angle} {distance}");
        assert!(
            found.residual.mean() < 0.3 && found.overlap > 0.8 && found.rotation_constraint > 0.05,
            "{found:?}"
        );
    }
}

#[test]
fn equal_clouds_are_found_exactly_and_every_kernel_has_the_same_bits() {
    let truth = pose([0.05, 0.1, -0.1], [0.03, 0.0, -0.02]);
    let target = part(500, 3);
    let source = moved(&target, truth.inverse());
    let mut first = None;
    for isa in Isa::all() {
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::with_isa(isa, &source, &target, &mut workspace).expect("valid");
        let found = refiner.polish(Pose::IDENTITY).expect("rigid");
        let (angle, distance) = error(found.target_from_source, truth);
        assert!(
            angle < 1e-3 && distance < 1e-5,
            "{} {angle} {distance}",
            isa.name()
        );
        assert_eq!(*first.get_or_insert(found), found, "{}", isa.name());
    }
}

#[test]
fn parts_are_found_in_wholes_and_points_of_nothing_do_not_pull() {
    let target = part(1500, 4);
    let mut source: Vec<_> = part(1500, 5).into_iter().filter(|p| p[0] < 0.3).collect();
    let wrong = source
        .iter()
        .take(120)
        .map(|p| [p[0] - 0.9, p[1], p[2] + 0.6]);
    let wrong: Vec<_> = wrong.collect();
    source.extend(wrong);
    let found = polish(
        &source,
        &target,
        pose([0.06, -0.04, 0.05], [0.03, 0.02, -0.03]),
    );
    let (angle, distance) = error(found.target_from_source, Pose::IDENTITY);
    assert!(angle < 1.0 && distance < 0.015, "{angle} {distance}");
}

#[test]
fn clouds_beyond_the_capacity_are_thinned_and_bad_ones_refused() {
    let many = part(crate::dims::MAX_POINTS, 6);
    let found = polish(
        &many,
        &part(3000, 7),
        pose([0.05, 0.0, 0.03], [0.0, 0.02, 0.0]),
    );
    assert!(
        error(found.target_from_source, Pose::IDENTITY).0 < 0.3,
        "{found:?}"
    );
    let mut workspace = Box::new(Workspace::new());
    let mut refused = |s: &[[f32; 3]], t: &[[f32; 3]]| Refiner::new(s, t, &mut workspace).err();
    assert_eq!(refused(&[], &many), Some(Error::EmptyCloud));
    assert_eq!(refused(&many, &[[1.0; 3]; 5]), Some(Error::NoExtent));
    assert_eq!(
        refused(&[[f32::NAN; 3]; 4], &many),
        Some(Error::NotFinite { index: 0 })
    );
    let mut refiner = Refiner::new(&many, &many, &mut workspace).expect("valid");
    let mut skewed = Pose::IDENTITY;
    skewed.rotation.x_axis.y = 1.0;
    assert_eq!(refiner.polish(skewed).err(), Some(Error::BadPose));
    assert_eq!(
        refiner.verify(skewed, &Start::Anywhere).err(),
        Some(Error::BadPose)
    );
}

/// Clouds that fix no pose, or barely: lines, planes, duplicates, few points, tiny and huge ones.
fn degenerate() -> impl Strategy<Value = Vec<[f32; 3]>> {
    let shape = (0..6u8, 3..80usize, any::<u32>(), -20..20i32);
    shape.prop_map(|(kind, n, seed, exponent)| {
        let mut numbers = Numbers(seed);
        let unit = 2f32.powi(exponent);
        let point = |i: usize| {
            let [x, y, z] = numbers.point();
            match kind {
                0 => [x, 0.0, 0.0],
                1 => [x, y, 0.0],
                2 => [(i % 2) as f32, 0.0, 0.0],
                3 => [x, y, z],
                4 if i == 0 => [1e6, y, z],
                4 => [x, y, z],
                _ => [x, x, -x + f32::from(i.is_multiple_of(3))],
            }
            .map(|x| x * unit)
        };
        (0..if seed % 7 == 0 { 3 } else { n }).map(point).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_known_motion_of_any_cloud_is_found(seed in any::<u32>(), n in 200..600usize, angles in prop::array::uniform3(-0.06f32..0.06), shift in prop::array::uniform3(-0.03f32..0.03)) {
        let truth = pose(angles, shift);
        let mut numbers = Numbers(seed);
        let target: Vec<_> = (0..n).map(|_| numbers.point()).collect();
        let found = polish(&moved(&target, truth.inverse()), &target, Pose::IDENTITY);
        let (angle, distance) = error(found.target_from_source, truth);
        prop_assert!(angle < 0.01 && distance < 1e-4, "{} {}", angle, distance);
    }

    #[test]
    fn nothing_panics_and_nothing_gets_worse(source in degenerate(), target in degenerate(), angles in prop::array::uniform3(-3.0f32..3.0), shift in prop::array::uniform3(-2.0f32..2.0)) {
        let initial = pose(angles, shift);
        let mut workspace = Box::new(Workspace::new());
        let Ok(mut refiner) = Refiner::new(&source, &target, &mut workspace) else {
            return Ok(());
        };
        let before = refiner.residual(initial).expect("rigid");
        let polished = refiner.polish(initial).expect("rigid");
        let verified = refiner.verify(initial, &Start::at(initial)).expect("rigid");
        for found in [polished, verified.polished] {
            prop_assert!(found.residual.mean() <= before.mean(), "{:?} {:?}", found, before);
        }
        for found in [polished, verified.best, verified.polished] {
            prop_assert!(found.target_from_source.checked().is_ok(), "{:?}", found);
            prop_assert!((0.0..=1.0).contains(&found.residual.mean()) && (0.0..0.34).contains(&found.rotation_constraint), "{:?}", found);
        }
        let probability = crate::evidence::Evidence::verified(&verified).probability();
        prop_assert!((0.0..=1.0).contains(&probability));
    }
}

/// A camera at the origin sees one end of a bent bar in front of a wall to its right; to the left, nothing was measured. A bar
/// that continues to the right would hide the wall.
#[test]
fn what_would_hide_the_background_counts_against_a_pose() {
    let bend = |x: f32, y: f32| [x, y, 5.0 + 0.3 * y * y];
    let grid = |columns: core::ops::Range<i32>, z: Option<f32>| -> Vec<[f32; 3]> {
        let rows = |i: i32| (-10..10).map(move |j| [i, j].map(|k| 0.05 * (k as f32 + 0.5)));
        let place = |[x, y]: [f32; 2]| z.map_or(bend(x, y), |z| [x * z / 5.0, y * z / 5.0, z]);
        columns.flat_map(rows).map(place).collect()
    };
    let (end, bar, wall) = (
        grid(-10..10, None),
        grid(-10..30, None),
        grid(11..40, Some(9.0)),
    );
    let mut workspace = Workspace::new();
    let mut residuals = |background: &[[f32; 3]]| {
        let mut refiner = Refiner::new(&end, &bar, &mut workspace).expect("clouds");
        refiner.set_sensor(Vec3::ZERO, background);
        // As it lies, the bar continues to the right; moved by its length, to the left.
        [0.0, 1.0].map(|shift| {
            let there = refiner.residual(pose([0.0; 3], [shift, 0.0, 0.0]));
            there.expect("a pose").mean()
        })
    };
    let [right, left] = residuals(&[]);
    assert!((right - left).abs() < 0.02, "{right} {left}");
    let [hiding, free] = residuals(&wall);
    assert!(
        hiding > right + 0.03 && (free - left).abs() < 0.02,
        "{hiding} {free}"
    );
    // Points that are not finite, or behind the camera, were not seen.
    let nothing = [[f32::NAN; 3], [0.0, 0.0, -5.0], [f32::INFINITY, 0.0, 1.0]];
    assert_eq!(residuals(&nothing)[0], residuals(&[[f32::NAN; 3]])[0]);
}

/// Two sheets that overlap by half continue beyond each other's edges. The same points above the middle of one sheet are
/// explained no worse, point by point, but no edge is there.
#[test]
fn what_lies_beyond_an_edge_speaks_less_against_a_pose_than_what_lies_off_a_surface() {
    let mut numbers = Numbers(9);
    let mut sheet = |x: f32, z: f32| -> Vec<[f32; 3]> {
        let place = |[u, v, _]: [f32; 3]| [x + 0.5 * u, v, z];
        (0..512).map(|_| place(numbers.point())).collect()
    };
    let target = [sheet(-0.5, 0.0), sheet(0.5, 0.0)].concat();
    let (shared, beyond, above) = (sheet(0.5, 0.0), sheet(1.5, 0.0), sheet(-0.5, 0.6));
    let mut workspace = Workspace::new();
    let mut loss = |rest: &[[f32; 3]]| {
        let source = [&shared[..], rest].concat();
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
        let at = refiner.inside(Pose::IDENTITY);
        refiner.match_both(at, COMPARED);
        let [loss, of_source] = refiner.keep_matched_losses(0, at);
        (loss / (2 * COMPARED) as f32, of_source)
    };
    let ((going_on, all), (off, all_off)) = (loss(&beyond), loss(&above));
    assert!((all - all_off).abs() < 0.05, "{all} {all_off}");
    assert!(going_on < off - 0.1, "{going_on} {off}");
}

#[test]
fn what_may_be_the_objects_lies_near_it() {
    let (mut source, target) = (part(800, 1), part(900, 2));
    for p in source.iter_mut().take(200) {
        p[0] += 1.8;
    }
    let inside = polish(&source, &target, Pose::IDENTITY).inside;
    assert!((inside - 0.75).abs() < 0.05, "{inside}");
}

#[test]
fn points_of_something_else_far_away_do_not_change_the_sizes() {
    let target = part(900, 2);
    for (share, away) in [(0, 0.0), (80, 30.0), (240, 6.0)] {
        let mut source = part(800, 1);
        let wall = source.iter_mut().take(share);
        wall.for_each(|p| p[2] = away);
        let found = polish(&source, &target, Pose::IDENTITY);
        let ratio = found.extents_ratio;
        assert!((0.7..1.5).contains(&ratio), "{share} {away} {ratio}");
    }
}
