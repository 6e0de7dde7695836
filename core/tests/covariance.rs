//! The covariance of a refined pose: errors are as large as it says. The mean of the normalised squared error would be 6 for an
//! exact covariance; 1.5 to 8 is required, for the same points seen twice and for independent samples.

use glam::Quat;
use nalgebra::{Matrix6, Vector6};
use reagent_core::covariance::Covariance;
use reagent_core::pipeline::{self, Mode, Task};
use reagent_core::polish::{Refiner, Workspace};
use reagent_core::pose::rotation_from_euler;
use reagent_core::start::Start;
use reagent_core::{Error, Pose};

type Points = Vec<[f32; 3]>;

/// Squared error in units of the covariance; its mean is the number of dimensions, 6, for an exact covariance.
fn normalised_error_squared(truth: Pose, estimate: Pose, covariance: &Covariance) -> f64 {
    let error = truth.after(estimate.inverse());
    let turn = Quat::from_mat3(&error.rotation).to_scaled_axis();
    let shift = error.apply(covariance.about) - covariance.about;
    let numbers = turn.to_array().into_iter().chain(shift.to_array());
    let e = Vector6::from_iterator(numbers.map(f64::from));
    let c = Matrix6::from_fn(|i, j| f64::from(covariance.matrix[i][j]));
    let inverse = c.cholesky().expect("positive definite").inverse();
    (e.transpose() * inverse * e)[0]
}

/// Pseudo-random numbers from -1 to 1.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Nearly Gaussian, with standard deviation 1.
    fn noise(&mut self) -> f32 {
        (0..12).map(|_| 0.5 * self.next()).sum()
    }

    fn point(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

/// A point on one of three shapes with a radius of about 1: a box with a knob, an ellipsoid with a flat side, a bracket.
fn on(shape: u32, numbers: &mut Numbers, i: usize) -> [f32; 3] {
    let [x, y, z] = numbers.point();
    match shape {
        0 => {
            let half = [0.8, 0.5, 0.3];
            let side = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            let mut p = [x * half[0], y * half[1], z * half[2]];
            p[i % 3] = side * half[i % 3];
            match i % 5 {
                0 => [
                    0.15 * p[0] + 0.4,
                    0.2 * p[1] + 0.2,
                    0.3 + 0.5 * (p[2] + 0.3),
                ],
                _ => p,
            }
        }
        1 => {
            let [x, y, z] = glam::Vec3::new(x, y, z)
                .normalize_or(glam::Vec3::X)
                .to_array();
            [0.9 * x, 0.6 * y, (0.4 * z).min(0.25)]
        }
        _ => match i % 3 {
            0 => [0.8 * x, 0.4 * y, 0.0],
            1 => [0.8 * x, 0.4, 0.3 + 0.3 * y],
            _ => [0.3 * x - 0.5, 0.2 * y, 0.2],
        },
    }
}

/// Mean over pairs of clouds of a thousand points, in some unit, with noise of this standard deviation in radii.
fn mean(unit: f32, deviation: f32, same_points: bool) -> f64 {
    const PAIRS: u32 = 60;
    let mut workspace = Box::new(Workspace::new());
    let mut all = Vec::new();
    let mut noise = Numbers(3);
    for pair in 0..PAIRS {
        let mut noisy = |seed: u32| -> Points {
            let mut numbers = Numbers(seed);
            let mut draw = |i| on(pair % 3, &mut numbers, i);
            let mut spoil = |p: [f32; 3]| p.map(|x| unit * (x + deviation * noise.noise()));
            (0..1000).map(|i| spoil(draw(i))).collect()
        };
        let target = noisy(pair);
        let source = noisy(if same_points { pair } else { 1000 + pair });
        let truth = Pose {
            rotation: rotation_from_euler([0.02, -0.03, 0.01].into()),
            translation: glam::Vec3::new(0.01, 0.0, -0.02) * unit,
        };
        let back = truth.inverse();
        let source: Points = source
            .iter()
            .map(|&p| back.apply(p.into()).to_array())
            .collect();
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("valid clouds");
        let refined = refiner.polish(truth).expect("rigid");
        let error =
            normalised_error_squared(truth, refined.target_from_source, &refined.covariance);
        all.push(error);
    }
    let by_shape = [0, 1, 2].map(|shape| all.iter().skip(shape).step_by(3).sum::<f64>() / 20.0);
    println!("{unit} {deviation} {same_points}: of each shape {by_shape:.2?}");
    all.iter().sum::<f64>() / all.len() as f64
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    for (unit, deviation) in [(1.0, 0.01), (1000.0, 0.01), (1.0, 0.003)] {
        for same_points in [true, false] {
            let mean = mean(unit, deviation, same_points);
            let pairs = format!("unit {unit}, noise {deviation}, same points {same_points}");
            println!("{pairs}: {mean:.2}");
            assert!((1.5..8.0).contains(&mean), "{pairs}: {mean}");
        }
    }
}

/// About an axis that fits any turn, the angle is unknown, and all else is known as well as the covariance says.
#[test]
fn what_an_open_turn_leaves_known_is_as_far_off_as_the_covariance_says() {
    const PAIRS: u32 = 20;
    let mut workspace = Box::new(Workspace::new());
    let mut sum = 0.0;
    for pair in 0..PAIRS {
        let cone = |seed: u32| -> Points {
            let mut numbers = Numbers(seed);
            let point = |_| {
                let (angle, z) = (core::f32::consts::PI * numbers.next(), numbers.next());
                let radius = 0.4 + 0.2 * z;
                let p = [radius * angle.cos(), radius * angle.sin(), 0.8 * z];
                p.map(|x| x + 0.005 * numbers.noise())
            };
            (0..1000).map(point).collect()
        };
        let (source, mut target) = (cone(pair), cone(1000 + pair));
        // The centre of what is left lies beside the axis.
        target.retain(|&[x, ..]| x > -0.1);
        let start = Pose {
            rotation: rotation_from_euler([0.03, -0.02, 0.5].into()),
            translation: glam::Vec3::new(0.02, 0.01, -0.02),
        };
        let task = Task {
            mode: Mode::Verify,
            ..Task::new(Start::at(start))
        };
        let go_on = || Ok::<(), Error>(());
        let found = pipeline::refine(&mut workspace, [&source, &target], start, &task, go_on);
        let found = found.expect("clouds").expect("a refinement");
        assert!(found.undetermined.axis.is_some(), "pair {pair}");
        let refined = found.refined;
        let pose = refined.target_from_source;
        sum += normalised_error_squared(Pose::IDENTITY, pose, &refined.covariance);
    }
    let mean = sum / f64::from(PAIRS);
    println!("{mean:.2}");
    assert!((1.0..10.0).contains(&mean), "{mean}");
}
