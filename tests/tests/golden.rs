//! The mathematics and the network against the numbers of the authors' implementation.

use glam::{Mat3, Vec3};
use host_train::augment;
use host_train::dataset::h5::H5File;
use host_train::dataset::pairs::PairSet;
use host_train::learn::agent::{Features, Seen, embed};
use host_train::learn::env::{Accumulation, Problem};
use host_train::learn::expert::Expert;
use host_train::learn::heads::Activations;
use host_train::learn::nn::{PackedEmbedding, Search};
use host_train::learn::optim::{Adam, Schedule};
use host_train::learn::reward::{chamfer, reward};
use host_train::policy::WeightFile;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::pose::{centroid, euler_from_rotation, rotation_from_euler};
use reagent_core::sight::Sight;
use reagent_core::steps::STEPS;
use reagent_core::view::View;
use reagent_core::{Action, Frame, Pose, Registrar};
use reagent_tests::{Golden, reference_parameters, shared};

const EXTRACT: &str = "reference.safetensors";

/// Poses of an array `[.., 4, 4]`.
fn poses(golden: &Golden, name: &str) -> Vec<Pose> {
    let (_, values) = golden.f32(name);
    values
        .chunks_exact(16)
        .map(|m| {
            Pose::from_rows(std::array::from_fn(|r| {
                std::array::from_fn(|c| m[4 * r + c])
            }))
        })
        .collect()
}

fn matrices(golden: &Golden, name: &str) -> Vec<Mat3> {
    let (_, values) = golden.f32(name);
    values
        .chunks_exact(9)
        .map(|m| Mat3::from_cols_slice(m).transpose())
        .collect()
}

fn vectors(golden: &Golden, name: &str) -> Vec<Vec3> {
    golden
        .f32(name)
        .1
        .chunks_exact(3)
        .map(Vec3::from_slice)
        .collect()
}

/// Actions of an array `[.., 2, 3]`.
fn actions(golden: &Golden, name: &str) -> Vec<Action> {
    let (_, ids) = golden.i64(name);
    ids.chunks_exact(6)
        .map(|a| Action {
            translation: std::array::from_fn(|i| a[i] as u8),
            rotation: std::array::from_fn(|i| a[3 + i] as u8),
        })
        .collect()
}

fn close(a: &Pose, b: &Pose, tolerance: f32) -> bool {
    a.rotation.abs_diff_eq(b.rotation, tolerance)
        && a.translation.abs_diff_eq(b.translation, tolerance)
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max)
}

#[test]
fn steps_accumulate_disentangled() {
    for golden in Golden::available(EXTRACT) {
        assert_eq!(golden.f32("step.signed_step_table").1, STEPS);
        let sources = golden.clouds("step.source");
        let expected = poses(&golden, "step.pose_disentangled");
        let global = poses(&golden, "step.pose_global");
        let plain = poses(&golden, "step.pose_plain");
        let mut now = vec![(Pose::IDENTITY, Pose::IDENTITY); sources.len()];
        for (i, action) in actions(&golden, "step.actions").into_iter().enumerate() {
            let b = i % sources.len();
            let mu = centroid(&sources[b]);
            let (disentangled, homogeneous) = &mut now[b];
            *disentangled = Accumulation::Global.step(disentangled, action);
            *homogeneous = Accumulation::Basic.step(homogeneous, action);
            assert!(close(disentangled, &expected[i], 1e-5), "row {i}");
            assert!(
                close(&disentangled.to_global(mu), &global[i], 1e-5),
                "row {i}"
            );
            assert!(close(homogeneous, &plain[i], 1e-5), "row {i}");
        }
    }
}

#[test]
fn poses_convert_and_apply() {
    for golden in Golden::available(EXTRACT) {
        let clouds = golden.clouds("convert.cloud");
        let disentangled = poses(&golden, "convert.to_disentangled");
        let global = poses(&golden, "convert.to_global");
        let plain = golden.clouds("convert.apply_plain");
        let about = golden.clouds("convert.apply_disentangled");
        for (i, pose) in poses(&golden, "convert.pose").iter().enumerate() {
            let mu = centroid(&clouds[i]);
            assert!(
                close(&pose.to_disentangled(mu), &disentangled[i], 1e-5),
                "row {i}"
            );
            assert!(close(&pose.to_global(mu), &global[i], 1e-5), "row {i}");
            for (n, &p) in clouds[i].iter().enumerate() {
                let p = Vec3::from_array(p);
                assert!(
                    pose.apply(p)
                        .abs_diff_eq(Vec3::from_array(plain[i][n]), 1e-5)
                );
                assert!(
                    pose.apply_about(mu, p)
                        .abs_diff_eq(Vec3::from_array(about[i][n]), 1e-5)
                );
            }
        }
    }
}

#[test]
fn experts_label_as_the_reference() {
    for golden in Golden::available(EXTRACT) {
        for group in ["expert", "expert.edge"] {
            let sources = poses(&golden, &format!("{group}.pose_source"));
            let targets = poses(&golden, &format!("{group}.pose_target"));
            for (expert, name) in [(Expert::Steady, "steady"), (Expert::Greedy, "greedy")] {
                let expected = actions(&golden, &format!("{group}.action_{name}"));
                for i in 0..expected.len() {
                    let problem = Problem {
                        source: Vec::new(),
                        target: Vec::new(),
                        chosen: Vec::new(),
                        sight: Sight::ALL,
                        centroid: Vec3::ZERO,
                        registering: targets[i],
                    };
                    let remaining = Accumulation::Global.remaining(&sources[i], &problem);
                    let action = expert.action(&remaining);
                    assert_eq!(action, expected[i], "{group} {name} row {i}");
                }
            }
        }
    }
}

#[test]
fn euler_angles_go_there_and_back() {
    for golden in Golden::available(EXTRACT) {
        let angles = vectors(&golden, "euler.angles");
        let back = vectors(&golden, "euler.angles_back");
        for (i, matrix) in matrices(&golden, "euler.matrix").into_iter().enumerate() {
            assert!(
                rotation_from_euler(angles[i]).abs_diff_eq(matrix, 1e-6),
                "row {i}"
            );
            let ours = euler_from_rotation(&matrix);
            // Near gimbal lock many angles give one matrix: compare matrices there.
            if (5..=12).contains(&i) {
                assert!(
                    rotation_from_euler(ours).abs_diff_eq(matrix, 1e-3),
                    "row {i}: {ours}"
                );
            } else {
                assert!(
                    ours.abs_diff_eq(back[i], 1e-5),
                    "row {i}: {ours} {}",
                    back[i]
                );
            }
        }
        let (_, is_nan) = golden.i64("euler.gimbal.is_nan");
        assert!(
            is_nan.contains(&1),
            "the reference gives NaN beyond the clamp"
        );
        for matrix in matrices(&golden, "euler.gimbal.matrix") {
            assert!(euler_from_rotation(&matrix).is_finite());
        }
    }
}

#[test]
fn rewards_follow_the_chamfer_distance() {
    for golden in Golden::available(EXTRACT) {
        let [before, after, truth] =
            ["before", "after", "true"].map(|name| golden.clouds(&format!("reward.cloud_{name}")));
        let [cd_before, cd_after, rewards] = ["chamfer_before", "chamfer_after", "reward"]
            .map(|name| golden.f32(&format!("reward.{name}")).1);
        for i in 0..rewards.len() {
            let (b, a) = (
                chamfer(&before[i], &truth[i]),
                chamfer(&after[i], &truth[i]),
            );
            assert!((b - cd_before[i]).abs() <= 1e-5 * (1.0 + b), "row {i}");
            assert!((a - cd_after[i]).abs() <= 1e-5 * (1.0 + a), "row {i}");
            assert_eq!(reward(b, a), rewards[i], "row {i}");
        }
        let (x, y) = (golden.clouds("reward.cd.x"), golden.clouds("reward.cd.y"));
        let (xy, yx) = (golden.f32("reward.cd.xy").1, golden.f32("reward.cd.yx").1);
        for i in 0..x.len() {
            assert!((chamfer(&x[i], &y[i]) - xy[i]).abs() < 1e-5);
            assert!((chamfer(&y[i], &x[i]) - yx[i]).abs() < 1e-5);
        }
    }
}

#[test]
fn augmentation_matrices_agree() {
    for golden in Golden::available(EXTRACT) {
        let (_, angles) = golden.f32("augment.shear.angle");
        let directions = vectors(&golden, "augment.shear.direction");
        let normals = vectors(&golden, "augment.shear.normal");
        for (i, expected) in matrices(&golden, "augment.shear.matrix").iter().enumerate() {
            let matrix = augment::shear_matrix(angles[i], directions[i], normals[i]);
            assert!(matrix.abs_diff_eq(*expected, 1e-6), "row {i}");
        }
        let normals = vectors(&golden, "augment.mirror.normal");
        for (i, expected) in matrices(&golden, "augment.mirror.matrix")
            .iter()
            .enumerate()
        {
            assert!(
                augment::mirror_matrix(normals[i]).abs_diff_eq(*expected, 1e-6),
                "row {i}"
            );
        }
        let mut cloud = golden.clouds("augment.scale.cloud").remove(0);
        augment::scale(&mut cloud, vectors(&golden, "augment.scale.factors")[0]);
        let expected = golden.f32("augment.scale.out").1;
        assert!(largest_difference(cloud.as_flattened(), &expected) < 1e-6);
    }
}

#[test]
fn amsgrad_and_its_schedule_agree() {
    for golden in Golden::available(EXTRACT) {
        let (_, mut parameters) = golden.f32("adam.param_start");
        let (_, rates) = golden.f32("adam.lr");
        let (_, gradients) = golden.f32("adam.grads");
        let (_, expected) = golden.f32("adam.param_after");
        let n = parameters.len();
        let schedule = Schedule {
            initial: rates[0],
            halve_every: 3,
        };
        let mut adam = Adam::new(n);
        for (step, gradient) in gradients.chunks_exact(n).enumerate() {
            assert_eq!(schedule.rate(step as u32), rates[step]);
            adam.step(&mut parameters, gradient, rates[step]);
            let difference = largest_difference(&parameters, &expected[step * n..(step + 1) * n]);
            assert!(difference < 1e-6, "step {step}: {difference}");
        }
    }
}

#[test]
fn forward_pass_of_the_trainer_and_of_the_robot() {
    let Some(golden) = Golden::full() else { return };
    let parameters = reference_parameters(&golden);
    let (sources, targets) = (
        golden.clouds("forward.source"),
        golden.clouds("forward.target"),
    );
    let batch = sources.len();

    // The trainer's batched pass: features, logits, values.
    let packed = PackedEmbedding::with_search(&parameters, Search::F32);
    let in_bytes = PackedEmbedding::with_search(&parameters, Search::Int8);
    let [source, target] = [&sources, &targets].map(|clouds| {
        let seen: Vec<Seen<'_>> = clouds
            .iter()
            .map(|points| Seen {
                points: points.as_slice().into(),
                view: View::IDENTITY,
            })
            .collect();
        let mut features = Features::default();
        embed(&in_bytes, 1024, &seen, &mut features);
        let searched = features.clone();
        embed(&packed, 1024, &seen, &mut features);
        assert_eq!(searched.values.len(), features.values.len());
        // Searched in 8 bits, a feature is exact or that of a point that comes close.
        let other = features.critical.iter().zip(&searched.critical);
        let other = other.filter(|(a, b)| a != b).count();
        assert!(other * 8 < features.critical.len(), "{other} other points");
        assert!(largest_difference(&searched.values, &features.values) < 5e-3);
        for (searched, exact) in searched.values.iter().zip(&features.values) {
            assert!(*searched < exact + 1e-6, "no point beats the maximum");
        }
        features
    });
    assert!(largest_difference(&source.values, &golden.f32("forward.feat_source").1) < 1e-5);
    assert!(largest_difference(&target.values, &golden.f32("forward.feat_target").1) < 1e-5);
    let rows: Vec<usize> = (0..batch).collect();
    let mut activations = Activations::default();
    activations.forward(&parameters, (&source, &rows), (&target, &rows));
    activations.estimate(&parameters);
    let values = &activations.values;
    assert!(largest_difference(values, &golden.f32("forward.value").1) < 1e-5);
    for (head, name) in ["forward.logits_t", "forward.logits_r"]
        .into_iter()
        .enumerate()
    {
        let (_, expected) = golden.f32(name);
        for b in 0..batch {
            for i in 0..33 {
                let logit = activations.heads[head].logits[i * batch + b];
                assert!((logit - expected[b * 33 + i]).abs() < 1e-5);
            }
        }
    }

    // The robot's pass, on every kernel set of this machine.
    let file = WeightFile::from_parameters(&parameters).expect("deployable");
    let argmax = actions(&golden, "forward.argmax");
    let (_, logits_t) = golden.f32("forward.logits_t");
    for isa in Isa::all() {
        let mut scratch = Box::new(Scratch::new());
        let mut registrar = Registrar::with_isa(isa, file.policy(), &mut scratch);
        for b in 0..batch {
            let mut registration = registrar
                .start(&sources[b], &targets[b], Frame::IDENTITY, Pose::IDENTITY)
                .expect("sound clouds");
            let step = registrar.step(&mut registration).expect("started");
            assert_eq!(step.action, argmax[b], "{}", isa.name());
            assert!(largest_difference(&step.logits_t, &logits_t[b * 33..][..33]) < 1e-5);
        }
    }
}

#[test]
fn whole_registrations_take_the_reference_s_steps() {
    let Some(golden) = Golden::full() else { return };
    for group in ["registration", "registration_centred"] {
        let mut parameters = reference_parameters(&golden);
        let clouds = if group == "registration" {
            "forward"
        } else {
            for (layer, name) in [(5, "policy_t"), (8, "policy_r")] {
                let (_, bias) = golden.f32(&format!("{group}.{name}.bias"));
                parameters.layer_mut(layer).1.copy_from_slice(&bias);
            }
            group
        };
        let file = WeightFile::from_parameters(&parameters).expect("deployable");
        let sources = golden.clouds(&format!("{clouds}.source"));
        let targets = golden.clouds(&format!("{clouds}.target"));
        let expected = actions(&golden, &format!("{group}.actions"));
        let global = poses(&golden, &format!("{group}.pose_global"));
        let (_, logits_r) = golden.f32(&format!("{group}.logits_r"));
        let finals = golden.clouds(&format!("{group}.final_cloud"));
        let batch = sources.len();
        for isa in Isa::all() {
            let mut scratch = Box::new(Scratch::new());
            let mut registrar = Registrar::with_isa(isa, file.policy(), &mut scratch);
            for b in 0..batch {
                let mut registration = registrar
                    .start(&sources[b], &targets[b], Frame::IDENTITY, Pose::IDENTITY)
                    .expect("sound clouds");
                for s in 0..10 {
                    let row = s * batch + b;
                    let step = registrar.step(&mut registration).expect("started");
                    assert_eq!(
                        step.action,
                        expected[row],
                        "{group} {} step {s} pair {b}",
                        isa.name()
                    );
                    let pose = registration.target_from_source();
                    assert!(
                        close(&pose, &global[row], 1e-5),
                        "{group} step {s} pair {b}"
                    );
                    assert!(largest_difference(&step.logits_r, &logits_r[row * 33..][..33]) < 2e-5);
                }
                let pose = registration.target_from_source();
                for (&p, &q) in sources[b].iter().zip(&finals[b]) {
                    assert!(
                        pose.apply(Vec3::from_array(p))
                            .abs_diff_eq(Vec3::from_array(q), 1e-5)
                    );
                }
            }
        }
    }
}

#[test]
fn the_imported_checkpoint_takes_every_recorded_action() {
    let (Some(checkpoint), Some(recorded), Some(pairs)) = (
        shared("fixtures/reference_checkpoint.zip"),
        shared("fixtures/reference_poses.h5"),
        shared("data/pairs_models.h5"),
    ) else {
        return;
    };
    let parameters = host_train::policy::import::pytorch(&checkpoint).expect("a checkpoint");
    let file = WeightFile::from_parameters(&parameters).expect("deployable");
    let pairs = PairSet::load(&pairs).expect("pairs");
    let (_, ids) = H5File::open(&recorded)
        .and_then(|file| file.read_i64("actions", "[M,10,2,3] i64"))
        .expect("recorded actions");
    let (expected, _) = ids.as_chunks::<6>();
    assert_eq!(expected.len(), 10 * pairs.source.len());
    let mut scratch = Box::new(Scratch::new());
    let mut registrar = Registrar::new(file.policy(), &mut scratch);
    for (i, (source, target)) in pairs.source.iter().zip(&pairs.target).enumerate() {
        let mut registration = registrar
            .start(source, target, Frame::IDENTITY, Pose::IDENTITY)
            .expect("sound clouds");
        for s in 0..10 {
            let Action {
                translation,
                rotation,
            } = registrar.step(&mut registration).expect("started").action;
            let taken: Vec<i64> = translation
                .iter()
                .chain(&rotation)
                .map(|&id| id.into())
                .collect();
            assert_eq!(taken, expected[10 * i + s], "pair {i} step {s}");
        }
    }
}
