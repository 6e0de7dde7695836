//! The distributions, compared with the moments that the paper's protocol implies.

use super::*;
use crate::random::{Purpose, Rng, stream};
use proptest::prelude::*;
use rayon::prelude::*;

fn rng(index: u64) -> Rng {
    stream(1, Purpose::Augment, index)
}

fn cube(n: usize) -> Vec<Point> {
    let mut rng = stream(3, Purpose::Shape, 0);
    (0..n)
        .map(|_| std::array::from_fn(|_| rng.random_range(-0.5..0.5)))
        .collect()
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    (mean, variance.sqrt())
}

#[test]
fn offsets_have_the_papers_ranges() {
    let mut rng = rng(0);
    let (mut angle, mut shift) = (0.0, 0.0);
    for _ in 0..4000 {
        let pose = random_rigid(&mut rng);
        let trace = pose.rotation.x_axis.x + pose.rotation.y_axis.y + pose.rotation.z_axis.z;
        angle += ((trace - 1.0) / 2.0).acos().to_degrees() / 4000.0;
        shift += pose.translation.length() / 4000.0;
        // R = Rx(a) Ry(b) Rz(c), every angle in [0, 45) degrees.
        let angles = reagent_core::pose::euler_from_rotation(&pose.rotation);
        assert!(angles.min_element() > -1e-6 && angles.max_element() < FRAC_PI_4 + 1e-6);
        assert!(pose.translation.abs().max_element() <= 0.5);
    }
    assert!((angle - 44.7).abs() < 1.0, "mean rotation {angle} deg");
    assert!((shift - 0.484).abs() < 0.01, "mean translation {shift}");
}

#[test]
fn scale_is_normal_about_one_and_independent_on_the_axes() {
    let mut rng = rng(1);
    let draws: Vec<Vec3> = (0..20_000).map(|_| random_scale(&mut rng)).collect();
    let axis = |axis: usize| draws.iter().map(|f| f64::from(f[axis])).collect::<Vec<_>>();
    for k in 0..3 {
        let (mean, deviation) = moments(&axis(k));
        assert!(
            (mean - 1.0).abs() < 0.003 && (deviation - 0.1).abs() < 0.002,
            "{mean} {deviation}"
        );
        let (one, other) = (axis(k), axis((k + 1) % 3));
        let products: Vec<f64> = one
            .iter()
            .zip(other)
            .map(|(a, b)| (a - 1.0) * (b - 1.0))
            .collect();
        assert!(moments(&products).0.abs() < 3e-4, "correlated axes");
    }
    assert!(
        draws
            .iter()
            .all(|f| f.min_element() >= 0.5 && f.max_element() <= 1.5)
    );
}

#[test]
fn shear_keeps_volume_and_is_clipped_at_15_degrees() {
    let mut rng = rng(2);
    let mut angles = Vec::new();
    let mut mean = Mat3::ZERO;
    for _ in 0..20_000 {
        let matrix = random_shear(&mut rng);
        assert!(
            (matrix.determinant() - 1.0).abs() < 1e-5,
            "direction and normal are orthogonal"
        );
        let moved = matrix - Mat3::IDENTITY;
        mean += moved * (1.0 / 20_000.0);
        let tangent = moved
            .to_cols_array()
            .iter()
            .map(|x| x * x)
            .sum::<f32>()
            .sqrt();
        angles.push(f64::from(tangent.atan().to_degrees()));
    }
    // |N(0, 5)| has mean 5 sqrt(2 / pi) = 3.99 and mean square 25; .27 % lie beyond 15 degrees.
    let (size, _) = moments(&angles);
    let largest = angles.iter().copied().fold(0.0, f64::max);
    assert!((size - 3.99).abs() < 0.1, "{size}");
    assert!((largest - 15.0).abs() < 1e-3, "{largest}");
    let clipped = angles.iter().filter(|&&a| a > 14.999).count();
    assert!((20..100).contains(&clipped), "{clipped}");
    assert!(
        mean.abs_diff_eq(Mat3::ZERO, 2e-3),
        "no preferred direction: {mean}"
    );
}

#[test]
fn mirrors_reflect_at_planes_of_all_directions() {
    let mut rng = rng(3);
    let mut normals = Mat3::ZERO;
    for _ in 0..20_000 {
        let matrix = mirror_matrix(random_direction(&mut rng));
        assert!((matrix.determinant() + 1.0).abs() < 1e-5);
        assert!((matrix * matrix).abs_diff_eq(Mat3::IDENTITY, 1e-5));
        // (I - M) / 2 is n nᵀ, whose mean over the sphere is I / 3.
        normals += (Mat3::IDENTITY - matrix) * (0.5 / 20_000.0);
    }
    let third = Mat3::from_diagonal(Vec3::splat(1.0 / 3.0));
    assert!(normals.abs_diff_eq(third, 0.01), "{normals}");
}

#[test]
fn noise_has_its_deviation_and_its_clip() {
    let mut points = vec![[0.0f32; 3]; 4_000_000];
    jitter(&mut rng(4), &mut points);
    let noise: Vec<f64> = points
        .as_flattened()
        .iter()
        .map(|&x| f64::from(x))
        .collect();
    let (mean, deviation) = moments(&noise);
    assert!(
        mean.abs() < 2e-5 && (deviation - 0.01).abs() < 2e-5,
        "{mean} {deviation}"
    );
    // Of 12 million normal numbers about 7 lie beyond 5 deviations, so the clip is reached.
    let largest = noise.iter().map(|x| x.abs()).fold(0.0, f64::max);
    assert_eq!(largest as f32, JITTER_CLIP);
}

#[test]
fn every_point_is_drawn_equally_often() {
    let cloud: Vec<Point> = (0..64).map(|i| [i as f32, 0.0, 0.0]).collect();
    let (mut drawn, mut first) = ([0u32; 64], [0u32; 64]);
    let mut rng = rng(5);
    for _ in 0..8000 {
        let points = resample(&mut rng, &cloud, 24);
        first[points[0][0] as usize] += 1;
        points.iter().for_each(|p| drawn[p[0] as usize] += 1);
    }
    // 3000 and 125 expected, within five standard deviations of the binomial.
    assert!(
        drawn.iter().all(|&n| (2780..3220).contains(&n)),
        "{drawn:?}"
    );
    assert!(
        first.iter().all(|&n| (69..181).contains(&n)),
        "in no order: {first:?}"
    );
}

#[test]
fn noisy_clouds_are_drawn_independently() {
    // Distances between points survive rigid offsets; these clouds are compared without noise.
    let cloud: Vec<Point> = (0..2048).map(|i| [i as f32, 0.0, 0.0]).collect();
    let mut rng = rng(6);
    let common: Vec<f64> = (0..50)
        .map(|_| {
            let [a, b] = [(); 2].map(|()| resample(&mut rng, &cloud, 1024));
            let ids = |c: &[Point]| {
                c.iter()
                    .map(|p| p[0] as u32)
                    .collect::<std::collections::HashSet<_>>()
            };
            ids(&a).intersection(&ids(&b)).count() as f64
        })
        .collect();
    let (mean, _) = moments(&common);
    assert!((mean - 512.0).abs() < 12.0, "{mean}");
}

proptest! {
    #[test]
    fn resampling_takes_each_point_once_before_any_twice(n in 1usize..80, k in 0usize..200, seed: u64) {
        let cloud: Vec<Point> = (0..n).map(|i| [i as f32, 1.0, 2.0]).collect();
        let drawn = resample(&mut stream(seed, Purpose::Augment, 0), &cloud, k);
        prop_assert_eq!(drawn.len(), k);
        let mut times = vec![0; n];
        drawn.iter().for_each(|p| times[p[0] as usize] += 1);
        if k <= n {
            prop_assert!(times.iter().all(|&t| t <= 1));
        } else {
            prop_assert!(times.iter().all(|&t| t >= 1));
        }
    }

    #[test]
    fn one_affine_map_is_scale_then_shear_then_mirror(seed: u64) {
        let mut cloud = cube(50);
        transform(&mut cloud, &Pose { rotation: Mat3::IDENTITY, translation: Vec3::new(0.3, -2.0, 1.0) });
        let mut step_by_step = cloud.clone();
        let mut whole = cloud.clone();
        let mut rng = stream(seed, Purpose::Augment, 0);
        affine(&mut whole, &random_affine(&mut rng, centroid(&cloud)));
        let mut rng = stream(seed, Purpose::Augment, 0);
        scale(&mut step_by_step, random_scale(&mut rng));
        let shear = random_shear(&mut rng);
        linear(&mut step_by_step, &shear);
        linear(&mut step_by_step, &mirror_matrix(random_direction(&mut rng)));
        for (a, b) in whole.iter().zip(&step_by_step) {
            prop_assert!(Vec3::from(*a).distance(Vec3::from(*b)) < 1e-5);
        }
    }
}

/// Mean distance from the points of the moved source to their nearest target points.
fn misfit(sample: &Sample) -> f32 {
    let nearest = |&p: &Point| {
        let seen = sample.target_from_source.apply(p.into());
        let distances = sample.target.iter().map(|&q| seen.distance(q.into()));
        distances.fold(f32::INFINITY, f32::min)
    };
    sample.source.iter().map(nearest).sum::<f32>() / sample.source.len() as f32
}

#[test]
fn clean_samples_register_exactly_and_noisy_ones_to_the_noise() {
    let clean = clean_sample(&mut rng(7), &cube(256), 64);
    assert!(misfit(&clean) < 1e-5, "{}", misfit(&clean));
    let noisy = noisy_sample(&mut rng(8), &cube(256), 256);
    assert!(
        (0.005..0.05).contains(&misfit(&noisy)),
        "{}",
        misfit(&noisy)
    );
}

#[test]
fn half_of_the_sources_are_cropped_and_cluttered() {
    let disturbance = Disturbance {
        min_overlap: 0.5,
        max_outliers: 0.2,
    };
    let whole = |i| noisy_sample(&mut rng(i), &cube(256), 256);
    let mut shares = Vec::new();
    for i in 0..200 {
        let mut sample = whole(i);
        disturbance.apply(&mut rng(1000 + i), &mut sample);
        let before = whole(i);
        assert_eq!(sample.target, before.target, "targets stay whole");
        if sample != before {
            let kept = |p: &&Point| before.source.iter().any(|q| distance(p, q) < 1e-5);
            let kept = sample.source.iter().filter(kept).count();
            let n = sample.source.len();
            shares.push((n as f32 / 256.0, 1.0 - kept as f32 / n as f32));
            let seen = sample.source.iter().map(|&p| {
                let [x, y, z] = sample.target_from_source.apply(p.into()).to_array();
                x.hypot(y).hypot(z)
            });
            assert!(seen.fold(0.0, f32::max) < 2.0, "where the target is");
        }
    }
    assert!((80..120).contains(&shares.len()), "{}", shares.len());
    let overlaps = || shares.iter().map(|s| s.0);
    let outliers = || shares.iter().map(|s| s.1);
    let mean = |sum: f32| sum / shares.len() as f32;
    assert!((mean(overlaps().sum()) - 0.75).abs() < 0.05);
    assert!((mean(outliers().sum()) - 0.1).abs() < 0.02);
    assert!(overlaps().all(|s| (0.5..=1.0).contains(&s)) && outliers().all(|s| s <= 0.21));

    let mut sample = whole(3);
    Disturbance::NONE.apply(&mut rng(3), &mut sample);
    assert_eq!(sample, whole(3));
}

fn distance(p: &Point, q: &Point) -> f32 {
    (0..3).map(|k| (p[k] - q[k]).abs()).fold(0.0, f32::max)
}

#[test]
fn samples_depend_on_their_stream_only_not_on_the_thread() {
    let cloud = cube(256);
    let draw = |i: u64| {
        let clean = clean_sample(&mut rng(2 * i), &cloud, 64);
        (clean, noisy_sample(&mut rng(2 * i + 1), &cloud, 64))
    };
    let in_turn: Vec<_> = (0..40).map(draw).collect();
    assert_ne!(in_turn[4], in_turn[5]);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        let parallel: Vec<_> = pool.install(|| (0..40).into_par_iter().map(draw).collect());
        assert_eq!(parallel, in_turn, "{threads} threads");
    }
    assert_eq!(cloud, cube(256), "the model itself is never deformed");
}
