//! The combined loss and its gradient compared with the reference and with finite differences; returns and advantages,
//! and the effect of the authors' order of them.

use glam::Vec3;
use host_train::learn::buffer::{Buffer, Observation};
use host_train::learn::env::Problem;
use host_train::learn::loss::Losses;
use host_train::learn::nn::{Parameters, Search, Shape};
use host_train::learn::optim::Adam;
use host_train::learn::ppo::PpoSettings;
use host_train::train::{Method, RollOut, Trainer};
use reagent_core::{Action, Pose};
use reagent_tests::{Golden, reference_parameters};

fn trainer(parameters: Parameters, method: Method) -> Trainer {
    let adam = Adam::new(parameters.values.len());
    let method = Method {
        search: Search::F32,
        ..method
    };
    Trainer::new(parameters, adam, 0, 1, RollOut::default(), method)
}

fn problem(source: Vec<[f32; 3]>, target: Vec<[f32; 3]>) -> Problem {
    let identity = Pose::IDENTITY;
    Problem::new(source, target, identity)
}

fn action(labels: &[i64]) -> Action {
    let ids: Vec<u8> = labels.iter().map(|&id| id as u8).collect();
    Action {
        translation: [ids[0], ids[1], ids[2]],
        rotation: [ids[3], ids[4], ids[5]],
    }
}

fn observe(problem: usize, labels: &[i64]) -> Observation {
    Observation {
        problem,
        pose: Pose::IDENTITY,
        expert: action(labels),
        action: Action::STOP,
        log_probability: [-2.4; 6],
        value: 0.0,
        reward: 0.0,
        discounted_return: 0.0,
        advantage: 0.0,
    }
}

/// The problems and the mini-batch of the reference's loss.
fn reference_batch(golden: &Golden) -> (Vec<Problem>, Vec<Observation>) {
    let (source, target) = (golden.clouds("loss.source"), golden.clouds("loss.target"));
    let pairs = source.into_iter().zip(target);
    let problems = pairs.map(|(s, t)| problem(s, t)).collect();
    let (_, expert) = golden.i64("loss.expert_action");
    let (_, taken) = golden.i64("loss.action");
    let [old, returns, advantages] =
        ["old_logprob", "returns", "advantages"].map(|name| golden.f32(&format!("loss.{name}")).1);
    let batch = expert
        .chunks(6)
        .enumerate()
        .map(|(i, labels)| Observation {
            action: action(&taken[6 * i..6 * i + 6]),
            log_probability: std::array::from_fn(|k| old[6 * i + k]),
            discounted_return: returns[i],
            advantage: advantages[i],
            ..observe(i, labels)
        })
        .collect();
    (problems, batch)
}

fn norm(values: &[f32]) -> f64 {
    let squares = values.iter().map(|&g| f64::from(g).powi(2));
    squares.sum::<f64>().sqrt()
}

#[test]
fn all_parts_of_the_loss_equal_the_reference() {
    let Some(golden) = Golden::full() else { return };
    let (problems, batch) = reference_batch(&golden);
    let expect = |name: &str, value: f64| {
        let expected = f64::from(golden.f32(name).1[0]);
        let close = (value - expected).abs() < 1e-5;
        assert!(close, "{name}: {value} {expected}");
    };
    let [imitation, combined] = [0.0, 2.0].map(|alpha| {
        let mut trainer = trainer(reference_parameters(&golden), Method::new(alpha));
        trainer.gradient(&problems, &batch)
    });
    for losses in [imitation, combined] {
        expect("loss.clone_t", losses.clone_translation);
        expect("loss.clone_r", losses.clone_rotation);
        expect("loss.clone", losses.imitation());
        expect("loss.policy", losses.policy);
        expect("loss.entropy", losses.entropy);
    }
    expect("loss.total_alpha0", imitation.total);
    expect("loss.value", combined.value);
    let ppo = combined.reinforcement(&PpoSettings::new(2.0));
    expect("loss.ppo", ppo);
    expect("loss.total_alpha2", combined.total);

    // The reference's own ratios give the share outside the range and the distance that they moved.
    let (_, ratios) = golden.f32("loss.ratio");
    let n = ratios.len() as f64;
    let outside = ratios.iter().filter(|r| !(0.8..=1.2).contains(*r)).count();
    assert_eq!(combined.clip_fraction, outside as f64 / n);
    let kl = |&r: &f32| f64::from(r) - 1.0 - f64::from(r).ln();
    let kl = ratios.iter().map(kl).sum::<f64>() / n;
    assert!((combined.approx_kl - kl).abs() < 1e-5);
}

#[test]
fn gradients_at_alpha_0_and_2_equal_the_reference() {
    let Some(golden) = Golden::full() else { return };
    let (problems, batch) = reference_batch(&golden);
    // The reference file has only norms at alpha 0; these leading elements are PyTorch's autograd on the
    // same weights and batch, in a separate derivation that reproduces the file's loss and norms.
    let leading = Golden::extract("imitation.safetensors");
    for (alpha, norms, first8) in [
        (0.0, "loss.grad_norm_alpha0", None),
        (2.0, "loss.grad_norm", Some("loss.grad_first8")),
    ] {
        let mut trainer = trainer(reference_parameters(&golden), Method::new(alpha));
        trainer.gradient(&problems, &batch);
        let gradient = trainer.last_gradient();
        for (i, layer) in gradient.layers.iter().enumerate() {
            for (part, values) in [("weight", gradient.weight(i)), ("bias", gradient.bias(i))] {
                let parameter = format!("{}.{part}", layer.name);
                let expected = f64::from(golden.f32(&format!("{norms}.{parameter}")).1[0]);
                let norm = norm(values);
                let close = (norm - expected).abs() <= 1e-4 * expected;
                assert!(close, "alpha {alpha} {parameter}: {norm} {expected}");
                let first = match first8 {
                    Some(name) => golden.f32(&format!("{name}.{parameter}")).1,
                    // The value head has no gradient at alpha 0.
                    None if i >= gradient.shape.value() => continue,
                    None => {
                        let name = format!("loss.grad_first8_alpha0.{parameter}");
                        leading.f32(&name).1
                    }
                };
                for (&g, expected) in values.iter().zip(first) {
                    let close = (f64::from(g) - f64::from(expected)).abs() <= 1e-4 * norm;
                    assert!(close, "alpha {alpha} {parameter}: {g} {expected}");
                }
            }
        }
    }
}

#[test]
fn one_step_on_the_combined_loss_equals_the_reference() {
    let Some(golden) = Golden::full() else { return };
    let (problems, batch) = reference_batch(&golden);
    let mut parameters = reference_parameters(&golden);
    let mut trainer = trainer(parameters.clone(), Method::new(2.0));
    trainer.gradient(&problems, &batch);
    let gradient = trainer.last_gradient().clone();
    let mut adam = Adam::new(parameters.values.len());
    adam.step(&mut parameters.values, &gradient.values, 1e-3);
    for (i, layer) in parameters.layers.iter().enumerate() {
        let parts = [
            ("weight", parameters.weight(i), gradient.weight(i)),
            ("bias", parameters.bias(i), gradient.bias(i)),
        ];
        for (part, values, gradients) in parts {
            let name = format!("{}.{part}", layer.name);
            let expected = golden.f32(&format!("loss.after_adam_norm.{name}")).1[0];
            let norm = norm(values);
            assert!((norm - f64::from(expected)).abs() <= 1e-4 * norm, "{name}");
            let (_, first) = golden.f32(&format!("loss.after_adam_first8.{name}"));
            for ((&value, expected), &g) in values.iter().zip(first).zip(gradients) {
                // The first step is the rate times the gradient's sign, which is noise where there is no gradient.
                let close = (value - expected).abs() < 1e-6 || g.abs() < 1e-6;
                assert!(close, "{name}: {value} {expected} {g}");
            }
        }
    }
    let mut after = self::trainer(parameters, Method::new(2.0));
    let total = after.gradient(&problems, &batch).total;
    let expected = f64::from(golden.f32("loss.total_alpha2_after_step").1[0]);
    assert!((total - expected).abs() < 2e-4, "{total} {expected}");
}

/// A buffer of `[trajectories, steps]` rewards and values.
fn buffer(trajectories: usize, rewards: &[f32], values: &[f32]) -> Buffer {
    let steps = rewards.len() / trajectories;
    let at = |i: usize| i % trajectories * steps + i / trajectories;
    Buffer {
        problems: Vec::new(),
        trajectories,
        observations: (0..rewards.len())
            .map(|i| Observation {
                reward: rewards[at(i)],
                value: values[at(i)],
                ..observe(0, &[5; 6])
            })
            .collect(),
    }
}

#[test]
fn returns_and_advantages_equal_the_reference() {
    let Some(golden) = Golden::full() else { return };
    let [rewards, values, returns, advantages] =
        ["rewards", "values", "returns", "advantages"].map(|n| golden.f32(&format!("gae.{n}")).1);
    let (trajectories, steps) = (4, 10);
    let mut buffer = buffer(trajectories, &rewards, &values);
    buffer.compute_returns(&PpoSettings::new(2.0), &[]);
    for (i, o) in buffer.observations.iter().enumerate() {
        let row = i % trajectories * steps + i / trajectories;
        assert!((o.discounted_return - returns[row]).abs() < 1e-5, "{i}");
        assert!((o.advantage - advantages[row]).abs() < 1e-5, "{i}");
    }
    // With a value after the last step, the return is the old one plus the discounted value.
    let settings = PpoSettings::new(2.0);
    let plain = buffer.clone();
    buffer.compute_returns(&settings, &[3.0; 4]);
    for (i, (o, plain)) in buffer
        .observations
        .iter()
        .zip(&plain.observations)
        .enumerate()
    {
        let left = (steps - i / trajectories) as i32;
        let more = 3.0 * settings.gamma.powi(left);
        assert!((o.discounted_return - plain.discounted_return - more).abs() < 1e-5);
        let more = 3.0 * settings.gamma * (settings.gamma * settings.lambda).powi(left - 1);
        assert!((o.advantage - plain.advantage - more).abs() < 1e-5);
    }
}

/// In the authors' code samples are step-major and returns cloud-major, so nearly all samples learn from the return of
/// another cloud at another step. Here each sample keeps its own.
#[test]
fn the_authors_order_gives_samples_the_returns_of_others() {
    let Some(golden) = Golden::full() else { return };
    let (_, samples) = golden.i64("buffer_order.sample_traj_cloud_step");
    let (_, returns) = golden.i64("buffer_order.return_traj_cloud_step");
    let (clouds, steps) = (3, 4);
    let authors = |i: i64, clouds: i64, steps: i64| {
        let (trajectory, row) = (i / (clouds * steps), i % (clouds * steps));
        let sample = [trajectory, row % clouds, row / clouds];
        (sample, [trajectory, row / steps, row % steps])
    };
    for i in 0..24 {
        let (sample, given) = authors(i, clouds, steps);
        let row = 3 * i as usize..3 * i as usize + 3;
        assert_eq!(samples[row.clone()], sample);
        assert_eq!(returns[row], given);
    }
    let own = |clouds, steps| {
        let rows = 0..clouds * steps;
        rows.filter(|&i| {
            let (sample, given) = authors(i, clouds, steps);
            sample == given
        })
        .count()
    };
    assert_eq!(own(32, 10), 2, "of the 320 samples of one trajectory");

    // A reward of 1 in only trajectory 1's first step: our code credits that step, theirs, because of the order, the
    // first trajectory's fifth sample.
    let (trajectories, steps) = (3usize, 4usize);
    let mut rewards = [0.0; 12];
    rewards[steps] = 1.0;
    let mut ours = buffer(trajectories, &rewards, &[0.0; 12]);
    ours.compute_returns(&PpoSettings::new(2.0), &[]);
    let credited: Vec<usize> = (0..12)
        .filter(|&i| ours.observations[i].advantage != 0.0)
        .collect();
    assert_eq!(credited, [1], "step 0 of trajectory 1");
    let (sample, given) = authors(steps as i64, 3, 4);
    assert_eq!((sample, given), ([0, 1, 1], [0, 1, 0]));
}

/// The whole gradient of the combined loss with every option, value head included.
#[test]
fn gradients_equal_finite_differences_on_a_small_shape() {
    let shape = Shape {
        extra: 0,
        embed: [16, 16, 32],
        head: [16, 16],
    };
    let mut method = Method::new(2.0);
    method.ppo.entropy_weight = 0.3;
    method.ppo.normalise_advantages = true;
    method.ppo.clip_values = true;
    // With other seeds a ReLU may switch within the difference step.
    let mut trainer = trainer(Parameters::random(shape, 8), method);
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
    for (i, o) in batch.iter_mut().enumerate() {
        let x = i as f32;
        o.action = action(&[1, 2, 9, 4, 8, 7]);
        o.log_probability = [-2.4, -2.1, -2.5, -2.9, -2.35, -2.38];
        o.advantage = 1.0 - x;
        // The second value is outside its clipping range, on the side where the plain error counts.
        o.value = 0.5 * x;
        o.discounted_return = 1.0 - x;
    }
    trainer.gradient(&problems, &batch);
    let gradient = trainer.last_gradient().clone();
    let mut parameters = trainer.agent.parameters.clone();
    let loss_at = |parameters: &Parameters| -> Losses {
        let mut trainer = self::trainer(parameters.clone(), method);
        trainer.gradient(&problems, &batch)
    };
    let step = 1e-3f32;
    for layer in &gradient.layers {
        let range = layer.weight.start..layer.bias.end;
        // The derivative along the gradient of one layer is the square of its norm.
        let norm = norm(&gradient.values[range.clone()]);
        let scale = step / norm as f32;
        let start = &trainer.agent.parameters.values;
        let mut at = |sign: f32| {
            for i in range.clone() {
                parameters.values[i] = start[i] + sign * scale * gradient.values[i];
            }
            let loss = loss_at(&parameters).total;
            parameters.values[range.clone()].copy_from_slice(&start[range.clone()]);
            loss
        };
        let difference = (at(1.0) - at(-1.0)) / (2.0 * f64::from(step));
        assert!(norm > 1e-4, "{}: no gradient", layer.name);
        assert!(
            (difference - norm).abs() < 1e-2 * norm + 1e-5,
            "{}: finite difference {difference}, gradient {norm}",
            layer.name
        );
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let shape = Shape {
        extra: 1,
        embed: [16, 16, 32],
        head: [16, 16],
    };
    let train = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| {
            let mut trainer = trainer(Parameters::random(shape, 5), Method::new(2.0));
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
            let stats = trainer.update(problems, 1e-3).expect("finite");
            (trainer.agent.parameters.values, stats)
        })
    };
    assert_eq!(train(1), train(3));
}
