use super::*;
use crate::evidence::Evidence;
use crate::model::Model;
use crate::polish::Workspace;
use crate::polish::tests::{Numbers, error, moved, part, pose};
use crate::verdict::Verdict;
use glam::Vec3;

pub(super) fn verify(source: &[[f32; 3]], target: &[[f32; 3]], initial: Pose) -> Verified {
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(source, target, &mut workspace).expect("valid clouds");
    refiner
        .verify(initial, &Start::Anywhere)
        .expect("a rigid pose")
}

#[test]
fn a_target_that_is_ready_changes_no_bit() {
    let targets = [part(400, 4), part(500, 6)];
    let source = moved(&part(350, 5), pose([0.1, 0.2, -0.1], [0.3, 0.1, 0.2]));
    let start = Start::at(Pose::IDENTITY);
    let [mut fresh, mut used] = [(); 2].map(|()| Box::new(Workspace::new()));
    let mut models = targets.each_ref().map(|target| {
        let mut model = Box::new(Model::new());
        fresh.prepare(target, &mut model).expect("a cloud");
        model
    });
    for i in [0, 0, 1, 0, 1, 1] {
        let (target, model) = (&targets[i], &mut models[i]);
        *fresh = Workspace::new();
        let mut refiner = Refiner::new(&source, target, &mut fresh).expect("clouds");
        let expected = refiner.verify(Pose::IDENTITY, &start);
        // One workspace for all, which other targets used before.
        let mut refiner = Refiner::new(&source, target, &mut used).expect("clouds");
        assert_eq!(refiner.verify(Pose::IDENTITY, &start), expected);
        let mut refiner = Refiner::for_model(model, &source, &mut fresh).expect("clouds");
        assert_eq!(refiner.verify(Pose::IDENTITY, &start), expected);
    }
    let of_nothing = Model::new();
    let refused = Refiner::for_model(&of_nothing, &source, &mut fresh).map(|_| ());
    assert_eq!(refused, Err(Error::EmptyCloud));
}

#[test]
fn every_kernel_gives_the_same_bits() {
    use crate::kernels::Isa;
    // Half of the source has no counterpart.
    let mut source = moved(&part(400, 5), pose([0.1, 0.2, -0.1], [0.3, 0.1, 0.2]));
    let away = part(400, 7).into_iter().map(|[x, y, z]| [x + 1.4, y, z]);
    source.extend(away);
    let target = part(500, 4);
    let start = Start::at(Pose::IDENTITY);
    let verified = |isa| {
        let mut workspace = Box::new(Workspace::with_isa(isa));
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
        refiner
            .verify(Pose::IDENTITY, &start)
            .expect("a rigid pose")
    };
    let expected = verified(Isa::PORTABLE);
    for isa in Isa::all() {
        assert_eq!(verified(isa), expected, "{}", isa.name());
    }
}

#[test]
fn flips_are_found_and_taken_back() {
    use core::f32::consts::PI;
    let truth = pose([0.4, -0.2, 0.3], [0.2, -0.1, 0.3]);
    let source = moved(&part(800, 1), truth.inverse());
    let target = part(900, 2);
    for flip in [
        [PI, 0.0, 0.0],
        [0.0, PI, 0.0],
        [0.0, 0.0, PI],
        [0.0, PI / 2.0, 0.0],
    ] {
        let found = verify(&source, &target, pose(flip, [0.1, 0.0, 0.0]).after(truth));
        let (angle, distance) = error(found.best.target_from_source, truth);
        assert!(
            angle < 1.0 && distance < 0.02,
            "{flip:?} {angle} {distance}"
        );
        assert!(
            found.hypotheses > 0 && found.best.residual.mean() < found.polished.residual.mean()
        );
        assert!(Evidence::verified(&found).probability() > 0.5, "{found:?}");
    }
    let kept = verify(&source, &target, truth);
    assert_eq!(kept.best, kept.polished);
}

/// Points on a brick's faces.
pub(crate) fn brick(half: [f32; 3], count: usize, seed: u32) -> Vec<[f32; 3]> {
    let mut numbers = Numbers(seed);
    let point = |_| {
        let mut p = half.map(|half| half * numbers.next());
        let on = (3.0 * numbers.next().abs()) as usize % 3;
        p[on] = half[on] * p[on].signum();
        p
    };
    (0..count).map(point).collect()
}

#[test]
fn a_copy_that_is_hardly_nearer_to_the_start_does_not_take_the_place_of_the_pose_at_hand() {
    let square = [0.8, 0.8, 0.3];
    let (source, target) = (brick(square, 800, 21), brick(square, 900, 22));
    let mut workspace = Box::new(Workspace::new());
    // Turned back by a quarter, it fits as well: 50 degrees become -40, and 70 become -20.
    for (at_hand, given) in [(50.0f32, 50.0f32), (70.0, -20.0)] {
        let turned = |angle: f32| pose([0.0, 0.0, angle.to_radians()], [0.0; 3]);
        let source = moved(&source, turned(-at_hand));
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("valid clouds");
        let found = refiner.verify(turned(at_hand), &Start::at(Pose::IDENTITY));
        let found = found.expect("a rigid pose");
        let (angle, _) = error(found.best.target_from_source, turned(given));
        assert!(angle < 2.0, "{at_hand} {given} {angle}");
        let first = found.ranked[0].expect("the pose given out");
        let best = found.best.target_from_source;
        assert!(error(first.target_from_source, best).0 < 0.1, "{found:?}");
    }
}

/// A plate that is its own copy when turned by half a turn, but for the boss on it. The start is turned by half a turn.
#[test]
fn a_feature_that_settles_the_pose_overrules_the_start() {
    let plate = |seed: u32| {
        let boss = moved(
            &brick([0.12, 0.12, 0.1], 60, seed + 1),
            pose([0.0; 3], [0.55, 0.3, 0.15]),
        );
        [brick([0.9, 0.6, 0.08], 900, seed), boss].concat()
    };
    let (source, target) = (plate(41), plate(43));
    let turned = pose([0.0, 0.0, core::f32::consts::PI], [0.0; 3]);
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("valid clouds");
    let found = refiner
        .verify(turned, &Start::at(turned))
        .expect("a rigid pose");
    let (angle, _) = error(found.best.target_from_source, Pose::IDENTITY);
    assert!(angle < 2.0, "{found:?}");
}

#[test]
fn a_pose_has_the_lead_unless_another_fits_as_well() {
    // A brick fits as well upside down.
    let half = [1.0, 0.6, 0.3];
    let open = verify(&brick(half, 800, 11), &brick(half, 900, 12), Pose::IDENTITY);
    let closed = verify(&part(800, 1), &part(900, 2), Pose::IDENTITY);
    assert!(
        closed.support > 0 && open.support > 0,
        "{open:?} {closed:?}"
    );
    assert!(
        open.lead < 1.0 && closed.lead > 3.0,
        "{} {}",
        open.lead,
        closed.lead
    );
}

#[test]
fn it_ends_when_told_to() {
    #[derive(Debug, PartialEq)]
    enum Ended {
        Told,
        Failed(Error),
    }
    impl From<Error> for Ended {
        fn from(error: Error) -> Self {
            Ended::Failed(error)
        }
    }
    let target = part(900, 2);
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(&part(800, 1), &target, &mut workspace).expect("valid");
    let far = pose([core::f32::consts::PI, 0.0, 0.0], [0.1, 0.0, 0.0]);
    let mut asked = 0;
    let whole = refiner.verify_while(far, &Start::Anywhere, || {
        asked += 1;
        Ok::<(), Ended>(())
    });
    let whole = whole.expect("nobody ends it");
    // Asked before each hypothesis, and before each that is sifted or polished.
    assert!(asked > whole.hypotheses, "{asked}");
    for last in [1, whole.hypotheses, asked] {
        let mut left = last;
        let ended = refiner.verify_while(far, &Start::Anywhere, || {
            left -= 1;
            if left == 0 { Err(Ended::Told) } else { Ok(()) }
        });
        assert_eq!((ended, left), (Err(Ended::Told), 0));
    }
    let bad = Pose {
        rotation: glam::Mat3::ZERO,
        ..far
    };
    let failed = refiner.verify_while(bad, &Start::Anywhere, || Err(Ended::Told));
    assert!(matches!(failed, Err(Ended::Failed(Error::BadPose))));
}

#[test]
fn a_mirrored_part_is_told_unless_it_is_its_own_mirror_image() {
    let truth = pose([0.2, -0.1, 0.3], [0.1, -0.1, 0.05]);
    let mirrored = |[x, y, z]: [f32; 3]| [x, -y, z];
    // A box with a knob off both of its planes of symmetry, and one with two such knobs.
    let left = |seed| part(900, seed);
    let right = |seed| -> Vec<_> { part(900, seed).into_iter().map(mirrored).collect() };
    let both = |seed| -> Vec<_> {
        let mirror_image = part(450, seed + 10).into_iter().map(mirrored);
        part(450, seed).into_iter().chain(mirror_image).collect()
    };
    let of = |source: Vec<[f32; 3]>, target: &[[f32; 3]]| {
        let found = verify(&moved(&source, truth.inverse()), target, Pose::IDENTITY);
        let evidence = Evidence::verified(&found);
        (
            Verdict::of_evidence(&evidence),
            evidence.probability() > 0.2,
        )
    };
    assert_eq!(of(left(1), &left(2)), (Verdict::Converged, true));
    assert_eq!(of(right(1), &left(2)), (Verdict::Mirrored, false));
    assert_eq!(of(left(1), &right(2)), (Verdict::Mirrored, false));
    let twice: Vec<_> = both(1).into_iter().map(mirrored).collect();
    assert_eq!(of(twice, &both(2)), (Verdict::Converged, true));
}

#[test]
fn marks_of_what_is_invalid_change_nothing_but_what_is_left_out() {
    let truth = pose([0.2, -0.1, 0.3], [0.1, -0.1, 0.05]);
    let clean = [moved(&part(800, 1), truth.inverse()), part(900, 2)];
    for (of, mark) in [(0, -9999.0), (1, -9999.0), (0, 1e9), (1, 20.0)] {
        let mut clouds = clean.clone();
        clouds[of]
            .iter_mut()
            .step_by(10)
            .for_each(|p| *p = [mark; 3]);
        let found = verify(&clouds[0], &clouds[1], Pose::IDENTITY);
        let (angle, distance) = error(found.best.target_from_source, truth);
        assert!(angle < 1.0 && distance < 0.02, "{mark} {found:?}");
        let evidence = Evidence::verified(&found);
        assert_eq!(
            Verdict::of_evidence(&evidence),
            Verdict::Converged,
            "{mark}"
        );
        let mut left_out = [0.0; 2];
        left_out[of] = 0.1;
        assert_eq!(found.best.left_out, left_out, "{mark}");
    }
}

#[test]
fn another_object_is_refused() {
    let mut numbers = Numbers(3);
    let other: Vec<[f32; 3]> = (0..900)
        .map(|_| {
            let v = Vec3::new(numbers.next(), numbers.next(), numbers.next()).normalize();
            (v * Vec3::new(1.0, 0.3, 0.9)).to_array()
        })
        .collect();
    let found = verify(&part(800, 4), &other, Pose::IDENTITY);
    let evidence = Evidence::verified(&found);
    let probability = evidence.probability();
    assert!(probability < 0.2, "{probability} {found:?}");
    assert_eq!(Verdict::of_evidence(&evidence), Verdict::PoorFit);
}

#[test]
fn a_start_speaks_for_poses_that_explain_the_clouds() {
    let compared = 2.0 * COMPARED as f32;
    // Loss and surprise of a pose near the start, and of one half a turn away that fits better.
    let wins = |knows_background: bool, near: [f32; 2], far: [f32; 2]| {
        let [near, far] = [near, far]
            .map(|[loss, surprise]| energy([loss * compared, loss], surprise, knows_background));
        near < far
    };
    let near_wins = |near, far| wins(false, near, far);
    assert!(near_wins([0.58, 0.8], [0.45, 8.0]), "a box upside down");
    assert!(
        !near_wins([0.81, 1.8], [0.75, 8.0]),
        "scans that share a third"
    );
    assert!(near_wins([0.81, 1.8], [0.80, 8.0]), "both are as bad");
    assert!(
        wins(true, [0.81, 1.8], [0.75, 8.0]),
        "a mask that holds more background than object"
    );
}

/// A brick with a knob at a corner fits nearly as well the other way around, which is how it starts.
#[test]
fn a_start_does_not_speak_against_a_pose_that_fits_far_better() {
    let knobbed = |count, seed| {
        let knob = brick([0.2; 3], count / 4, seed + 1).into_iter();
        let knob = knob.map(|[x, y, z]| [x + 0.6, y + 0.2, z + 0.5]);
        let body = brick([0.8, 0.4, 0.3], count, seed);
        body.into_iter().chain(knob).collect::<Vec<_>>()
    };
    let (source, target) = (knobbed(700, 31), knobbed(800, 41));
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
    let around = pose([0.0, 0.0, core::f32::consts::PI], [0.0; 3]);
    let found = refiner.verify(around, &Start::at(around)).expect("a pose");
    let (angle, distance) = error(found.best.target_from_source, Pose::IDENTITY);
    assert!(angle < 3.0 && distance < 0.03, "{angle} {distance}");
    assert_eq!(found.undetermined, Undetermined::NOTHING);
}

/// Points of a surface of revolution about z: a radius at each height from -1 to 1, then scaled.
pub(crate) fn revolved(
    numbers: &mut Numbers,
    count: usize,
    radius: fn(f32) -> f32,
    height: f32,
) -> Vec<[f32; 3]> {
    let point = |_| {
        let (angle, z) = (core::f32::consts::PI * numbers.next(), numbers.next());
        let radius = radius(z);
        [radius * angle.cos(), radius * angle.sin(), height * z]
    };
    (0..count).map(point).collect()
}

pub(super) fn vase(z: f32) -> f32 {
    0.3 + 0.2 * z * z + 0.1 * z
}

/// The surface of a vase tells nothing about the angle, but the points that both clouds share do.
#[test]
fn shared_points_tell_the_angle_of_a_surface_of_revolution() {
    let mut numbers = Numbers(5);
    let vase = revolved(&mut numbers, 1600, vase, 0.8);
    let truth = pose([0.2, 0.1, 0.4], [0.1, 0.0, 0.0]);
    let source = moved(&vase[..1000], truth.inverse());
    let initial = pose([0.0, 0.0, 2.0], [0.0; 3]).after(truth);
    let found = verify(&source, &vase[500..1500], initial);
    let (angle, _) = error(found.best.target_from_source, truth);
    assert!(angle < 1.0, "{angle} {found:?}");
    assert!(found.polished.rotation_constraint < 0.02, "{found:?}");
}

#[test]
fn of_poses_side_by_side_the_one_that_fits_best_is_taken() {
    // Saw teeth with a period smaller than the distance within which poses are one hypothesis.
    const PERIOD: f32 = 0.14;
    let mut numbers = Numbers(5);
    let mut teeth = |count: usize| -> Vec<[f32; 3]> {
        let point = |_| {
            let [x, y] = [numbers.next(), 0.5 * numbers.next()];
            let within = x / PERIOD - (x / PERIOD).floor();
            [x, y, 0.1 * within]
        };
        (0..count).map(point).collect()
    };
    let (source, target) = (teeth(1000), teeth(1024));
    let beside = pose([0.0; 3], [PERIOD, 0.0, 0.0]);
    let mut workspace = Box::new(Workspace::new());
    let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("valid clouds");
    let polished = refiner.polish(beside).expect("a rigid pose");
    let (_, distance) = error(polished.target_from_source, beside);
    assert!(distance < 0.02, "{distance}");
    let found = refiner.verify(beside, &Start::at(beside));
    let found = found.expect("a rigid pose").best.target_from_source;
    let (angle, distance) = error(found, Pose::IDENTITY);
    assert!(angle < 1.0 && distance < 0.02, "{angle} {distance}");
}

/// Refinement of a shallow bowl of few points, whose walls neighbourhoods do not tell apart, leads away from the true pose.
#[test]
fn a_start_is_left_only_for_a_pose_that_is_more_probable() {
    let bowl = |n: usize, numbers: &mut Numbers, seen: bool| -> Vec<[f32; 3]> {
        let walls = [0.0, 0.06].into_iter().cycle();
        let points = walls.take(if seen { 2 * n } else { n }).map(|wall| {
            let [x, y, _] = numbers.point();
            [x, 0.8 * y, 0.4 * x * x + 0.3 * y * y + wall]
        });
        points.filter(|p| !seen || p[0] > -0.3).take(n).collect()
    };
    let mut workspace = Box::new(Workspace::new());
    for seed in 1..40 {
        let numbers = &mut Numbers(seed);
        let target = bowl(300, numbers, false);
        let source = bowl(200, numbers, true);
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("clouds");
        let start = Start::at(Pose::IDENTITY);
        let least = refiner.energy(Pose::IDENTITY, &start).expect("a pose");
        let at_hand = pose([1.5, 0.4, 0.8], [0.1, 0.1, 0.2]);
        let found = refiner.verify(at_hand, &start).expect("a pose");
        let energy = found.ranked[0].expect("a pose was found").energy;
        assert!(energy <= least + 1e-4, "{seed}: {energy} {least}");
    }
}
