use super::*;
use crate::dataset::mesh::Mesh;
use glam::{Mat3, Vec2};
use std::f32::consts::FRAC_PI_2;

const SIZE: [usize; 2] = [64, 48];

/// A square plate of 20 mm.
fn plate(quarter_turns: usize) -> BopModel {
    let corner = |x: f32, y: f32| Vec3::new(10.0 * x, 10.0 * y, 0.0);
    let vertices = vec![
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ];
    let points: Vec<[f32; 3]> = vertices.iter().map(|v| v.to_array()).collect();
    BopModel {
        object: 7,
        name: "plate".into(),
        diameter_mm: 800f64.sqrt(),
        symmetries: (0..quarter_turns)
            .map(|k| turned(FRAC_PI_2 * k as f32))
            .collect(),
        mesh: Mesh {
            vertices,
            faces: vec![[0, 1, 2], [0, 2, 3]],
        },
        surface: points.clone(),
        metric_points: points,
    }
}

fn turned(angle: f32) -> Pose {
    Pose {
        rotation: Mat3::from_rotation_z(angle),
        translation: Vec3::ZERO,
    }
}

/// Its true pose: 100 mm ahead, where a pixel is a millimetre wide.
fn truth() -> Pose {
    at(0.0, 100.0)
}

fn at(x: f32, z: f32) -> Pose {
    Pose {
        rotation: Mat3::IDENTITY,
        translation: Vec3::new(x, 0.0, z),
    }
}

/// The camera's view: the plate, 20 by 20 pixels, in front of a wall. `change` gets a pixel's place and depth.
fn seen(change: impl Fn(Vec2, f32) -> f32) -> DepthImage {
    let camera = Pinhole {
        size: SIZE,
        focal: Vec2::splat(100.0),
        // No pixel lies on the diagonal along which the plate is divided.
        centre: Vec2::new(31.5, 23.3),
    };
    let depth = |pixel: usize| {
        let place = Vec2::new((pixel % SIZE[0]) as f32, (pixel / SIZE[0]) as f32) - camera.centre;
        let plate = place.abs().max_element() < 10.0;
        change(place, if plate { 100.0 } else { 300.0 })
    };
    let pixels = SIZE[0] * SIZE[1];
    DepthImage::new(camera, (0..pixels).map(depth).collect(), vec![true; pixels])
}

fn errors(quarter_turns: usize, seen: &DepthImage, estimate: Pose) -> PoseErrors {
    PoseErrors::of(&plate(quarter_turns), seen, &truth(), &estimate)
}

#[test]
fn the_true_pose_has_no_error() {
    let found = errors(1, &seen(|_, depth| depth), truth());
    assert_eq!((found.vsd, found.mssd, found.mspd), ([0.0; 10], 0.0, 0.0));
    let recall = AverageRecall::of([found, PoseErrors::MISSING]);
    assert_eq!(
        [recall.ar_vsd, recall.ar_mssd, recall.ar_mspd, recall.ar],
        [50.0; 4]
    );
}

/// 3 mm farther away: more than .1 of the 28.3 mm, less than .15. The same pixels see the plate. Its corners move from
/// 10 to 9.709 pixels along each axis, in an image a tenth as wide as MSPD's thresholds assume.
#[test]
fn an_error_in_depth_is_what_one_can_see() {
    let found = errors(1, &seen(|_, depth| depth), at(0.0, 103.0));
    assert_eq!(
        found.vsd,
        [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    );
    assert!((found.mssd - 3.0 / 800f64.sqrt()).abs() < 1e-6, "{found:?}");
    assert!(
        (found.mspd - 10.0 * (10.0 - 10.0 / 1.03) * 2f64.sqrt()).abs() < 1e-3,
        "{found:?}"
    );
    let recall = AverageRecall::of([found]);
    assert_eq!(
        [recall.ar_vsd, recall.ar_mssd, recall.ar_mspd],
        [80.0, 80.0, 100.0]
    );
    assert!((recall.ar - 260.0 / 3.0).abs() < 1e-9);
}

/// 4 mm to the side: 16 of 20 columns belong to both poses, 8 to one only.
#[test]
fn pixels_of_one_pose_only_are_wrong() {
    let found = errors(1, &seen(|_, depth| depth), at(4.0, 100.0));
    assert!(
        found.vsd.iter().all(|e| (e - 8.0 / 24.0).abs() < 1e-9),
        "{found:?}"
    );
    assert!((found.mspd - 40.0).abs() < 1e-3);
    let away = errors(1, &seen(|_, depth| depth), at(25.0, 100.0));
    assert_eq!(away.vsd, [1.0; 10]);
    let behind = errors(1, &seen(|_, depth| depth), at(0.0, -100.0));
    assert_eq!((behind.vsd, behind.mspd), ([1.0; 10], f64::INFINITY));
}

/// A quarter turn changes nothing if it is a symmetry; otherwise each corner moves by a side.
#[test]
fn the_nearest_of_the_symmetries_counts() {
    let image = seen(|_, depth| depth);
    let estimate = truth().after(turned(FRAC_PI_2));
    let (alike, other) = (errors(4, &image, estimate), errors(1, &image, estimate));
    assert!(alike.mssd < 1e-6 && alike.mspd < 1e-3, "{alike:?}");
    assert!(
        (other.mssd - 20.0 / 800f64.sqrt()).abs() < 1e-6,
        "{other:?}"
    );
    assert!((other.mspd - 200.0).abs() < 1e-3, "{other:?}");
    assert_eq!((alike.vsd, other.vsd), ([0.0; 10], [0.0; 10]));
}

/// Something 20 mm nearer hides the left half of the true pose: what lies there is not visible, and not wrong. Missing
/// measurements hide nothing, nor does something 10 mm nearer.
#[test]
fn what_is_hidden_does_not_count() {
    let share = |measured: f32| {
        let left = move |place: Vec2, depth: f32| if place.x < 0.0 { measured } else { depth };
        errors(1, &seen(left), at(-4.0, 100.0)).vsd[9]
    };
    // Of the right half, 10 columns, the estimate misses 4.
    assert!((share(80.0) - 4.0 / 10.0).abs() < 1e-9, "{}", share(80.0));
    for measured in [0.0, 90.0] {
        assert!(
            (share(measured) - 8.0 / 24.0).abs() < 1e-9,
            "{}",
            share(measured)
        );
    }
}

/// The truth is visible in front of a measured depth; the estimate behind it counts where the truth does.
#[test]
fn an_estimate_behind_what_was_measured_counts_where_the_truth_is_visible() {
    let found = errors(1, &seen(|_, depth| depth), at(0.0, 130.0));
    // Distances differ by more than half a diameter; 15.4 pixels a side of it are seen: 16.
    assert_eq!(found.vsd, [1.0; 10]);
    let found = errors(1, &seen(|_, depth| depth), at(0.0, 110.0));
    // 10 mm are .354 diameters: 18 by 18 pixels are right from .4 on, the others belong to the truth alone.
    let alone = 1.0 - 18.0 * 18.0 / 400.0;
    let right = |k: usize| (found.vsd[k] - alone).abs() < 1e-9;
    assert!(
        found.vsd[..7] == [1.0; 7] && (7..10).all(right),
        "{found:?}"
    );
}
