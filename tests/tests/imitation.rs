//! The cloning loss and its gradient against the reference, and against finite differences.

use glam::Vec3;
use host_train::buffer::Observation;
use host_train::env::Problem;
use host_train::expert::Expert;
use host_train::nn::{Parameters, Search, Shape, VALUE};
use host_train::optim::Adam;
use host_train::train::{RollOut, Trainer};
use reagent_core::pose::centroid;
use reagent_core::{Action, Pose};
use reagent_tests::{Golden, reference_parameters};

fn trainer(parameters: Parameters) -> Trainer {
    let adam = Adam::new(parameters.values.len());
    let mut trainer = Trainer::new(parameters, adam, 0, 1, RollOut::default(), Expert::Steady);
    trainer.search_in(Search::F32);
    trainer
}

fn problem(source: Vec<[f32; 3]>, target: Vec<[f32; 3]>) -> Problem {
    Problem {
        centroid: centroid(&source),
        source,
        target,
        registering: Pose::IDENTITY,
    }
}

fn observe(problem: usize, labels: &[i64]) -> Observation {
    let ids: Vec<u8> = labels.iter().map(|&id| id as u8).collect();
    Observation {
        problem,
        pose: Pose::IDENTITY,
        expert: Action {
            translation: [ids[0], ids[1], ids[2]],
            rotation: [ids[3], ids[4], ids[5]],
        },
    }
}

#[test]
fn loss_and_gradient_at_alpha_zero_equal_the_reference() {
    let Some(golden) = Golden::full() else { return };
    let mut trainer = trainer(reference_parameters(&golden));
    let (source, target) = (golden.clouds("loss.source"), golden.clouds("loss.target"));
    let problems: Vec<Problem> = source
        .into_iter()
        .zip(target)
        .map(|(s, t)| problem(s, t))
        .collect();
    let (_, labels) = golden.i64("loss.expert_action");
    let batch: Vec<Observation> = labels
        .chunks(6)
        .enumerate()
        .map(|(i, labels)| observe(i, labels))
        .collect();
    let loss = trainer.gradient(&problems, &batch);

    for (name, value) in [
        ("loss.clone_t", loss.translation),
        ("loss.clone_r", loss.rotation),
        ("loss.clone", loss.total()),
        ("loss.total_alpha0", loss.total()),
    ] {
        let expected = f64::from(golden.f32(name).1[0]);
        assert!(
            (value - expected).abs() < 1e-5,
            "{name}: {value} {expected}"
        );
    }
    let gradient = trainer.last_gradient();
    // The reference file has norms only; these elements are PyTorch's autograd on the same weights and
    // batch, in a separate derivation that reproduces the file's loss and norms.
    let leading = Golden::extract("imitation.safetensors");
    for (i, layer) in gradient.layers.iter().enumerate() {
        for (part, values) in [("weight", gradient.weight(i)), ("bias", gradient.bias(i))] {
            let name = format!("loss.grad_norm_alpha0.{}.{part}", layer.name);
            let expected = f64::from(golden.f32(&name).1[0]);
            let norm = values
                .iter()
                .map(|&g| f64::from(g).powi(2))
                .sum::<f64>()
                .sqrt();
            assert!(
                (norm - expected).abs() <= 1e-4 * expected,
                "{name}: {norm} {expected}"
            );
            if i >= VALUE {
                continue;
            }
            let name = format!("loss.grad_first8_alpha0.{}.{part}", layer.name);
            for (&g, expected) in values.iter().zip(leading.f32(&name).1) {
                let close = (f64::from(g) - f64::from(expected)).abs() <= 1e-4 * norm;
                assert!(close, "{name}: {g} {expected}");
            }
        }
    }
}

#[test]
fn gradients_equal_finite_differences_on_a_small_shape() {
    let shape = Shape {
        embed: [16, 16, 32],
        head: [16, 16],
    };
    let mut trainer = trainer(Parameters::random(shape, 5));
    let cloud = |seed: u64| -> Vec<[f32; 3]> {
        host_train::dataset::procedural::model(seed, 0).points[..60].to_vec()
    };
    let problems = vec![problem(cloud(1), cloud(2)), problem(cloud(3), cloud(4))];
    let turned = Pose {
        rotation: reagent_core::pose::rotation_from_euler(Vec3::new(0.2, -0.4, 0.3)),
        translation: Vec3::new(0.1, 0.2, -0.3),
    };
    let mut batch = vec![
        observe(0, &[0, 3, 5, 7, 10, 1]),
        observe(1, &[5, 5, 5, 5, 5, 5]),
        observe(0, &[9, 8, 2, 4, 6, 0]),
    ];
    batch[2].pose = turned;
    trainer.gradient(&problems, &batch);
    let gradient = trainer.last_gradient().clone();
    let mut parameters = trainer.parameters.clone();
    let loss_at = |parameters: &Parameters| {
        let mut trainer = self::trainer(parameters.clone());
        trainer.gradient(&problems, &batch).total()
    };
    let step = 2e-3f32;
    for layer in gradient.layers.clone().iter().take(9) {
        let range = layer.weight.start..layer.bias.end;
        // The derivative along the gradient of one layer is the square of its norm.
        let norm2: f64 = gradient.values[range.clone()]
            .iter()
            .map(|&g| f64::from(g).powi(2))
            .sum();
        let scale = step / norm2.sqrt() as f32;
        let mut at = |sign: f32| {
            for i in range.clone() {
                parameters.values[i] =
                    trainer.parameters.values[i] + sign * scale * gradient.values[i];
            }
            let loss = loss_at(&parameters);
            parameters.values[range.clone()]
                .copy_from_slice(&trainer.parameters.values[range.clone()]);
            loss
        };
        let difference = (at(1.0) - at(-1.0)) / (2.0 * f64::from(step));
        let expected = norm2.sqrt();
        assert!(
            (difference - expected).abs() < 1e-2 * expected + 1e-5,
            "{}: finite difference {difference}, gradient {expected}",
            layer.name
        );
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let shape = Shape {
        embed: [16, 16, 32],
        head: [16, 16],
    };
    let train = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| {
            let mut trainer = trainer(Parameters::random(shape, 5));
            let problems = (0..8)
                .map(|i| {
                    let model = host_train::dataset::procedural::model(7, i);
                    let mut rng =
                        host_train::random::stream(1, host_train::random::Purpose::Augment, i);
                    Problem::from(host_train::augment::noisy_sample(
                        &mut rng,
                        &model.points,
                        100,
                    ))
                })
                .collect();
            trainer.update(problems, 1e-3);
            trainer.parameters.values
        })
    };
    assert_eq!(train(1), train(3));
}
