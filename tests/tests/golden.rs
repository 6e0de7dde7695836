//! The mathematics and the network, compared with the numbers of the authors' implementation.

#[path = "golden/network.rs"]
mod network;

use glam::{Mat3, Vec3};
use host_train::augment;
use host_train::learn::env::{Accumulation, Problem};
use host_train::learn::expert::Expert;
use host_train::learn::optim::{Adam, Schedule};
use host_train::learn::reward::{chamfer, reward};
use reagent_core::pose::{centroid, euler_from_rotation, rotation_from_euler};
use reagent_core::sight::Sight;
use reagent_core::steps::STEPS;
use reagent_core::{Action, Pose};
use reagent_tests::Golden;

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
            let view = Accumulation::Global.view(mu, pose);
            for (n, &p) in clouds[i].iter().enumerate() {
                let seen = Vec3::from_array(view.see(p));
                assert!(seen.abs_diff_eq(Vec3::from_array(about[i][n]), 1e-5));
                let p = Vec3::from_array(p);
                assert!(
                    pose.apply(p)
                        .abs_diff_eq(Vec3::from_array(plain[i][n]), 1e-5)
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
                        true_pose: targets[i],
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
            // Near gimbal lock many angles give one matrix, so matrices are compared.
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
