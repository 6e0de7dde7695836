//! A registration as the interactive view reads it: clouds thinned and rounded, poses in the target's frame.

use crate::dataset::Point;
use crate::register::trace::{Probabilities, Traced};
use glam::Vec3;
use reagent_core::verdict::Percent;
use reagent_core::{Frame, Pose};
use serde::Serialize;

/// Most points of a cloud that are shown.
const POINTS: usize = 700;
/// Coordinates are stored as whole thousandths of the target's radius.
const QUANTA: f32 = 1000.0;

/// One registration as the page's script reads it.
#[derive(Debug, Serialize)]
pub struct View<'a> {
    name: &'a str,
    policy: &'a str,
    /// Points of the source and the target before thinning.
    points: [usize; 2],
    /// Thousandths of the target's radius, from its centre; x, y, z of one point after the other.
    source: Vec<i32>,
    target: Vec<i32>,
    /// The target's radius in the clouds' units.
    radius: f32,
    /// The pose before each step and after the last one, then the final pose if something followed; rows of `[R |
    /// t]`, in the target's frame.
    poses: Vec<Vec<f64>>,
    /// Isotropic errors of each pose: degrees, clouds' units.
    errors: Option<Vec<[f64; 2]>>,
    steps: Vec<StepView>,
    /// What followed the steps, and the verdict.
    answer: Option<String>,
}

/// One step, translation axes first.
#[derive(Debug, Serialize)]
struct StepView {
    ids: Vec<u8>,
    /// Signed steps: clouds' units, then radians.
    signed: Vec<f32>,
    /// Probabilities in thousandths.
    probabilities: Option<Vec<Vec<u16>>>,
}

impl View<'_> {
    /// The view of a traced registration.
    pub fn of(traced: &Traced) -> View<'_> {
        let header = &traced.header;
        let frame = Frame::of(&header.target).unwrap_or(Frame::IDENTITY);
        let rows = std::iter::once(header.initial)
            .chain(traced.steps.iter().map(|s| s.target_from_source));
        let rows = rows.chain(traced.answer.iter().map(|answer| answer.target_from_source));
        let poses: Vec<Pose> = rows.map(Pose::from_rows).collect();
        let errors = header.truth.map(|truth| {
            let truth = Pose::from_rows(truth);
            poses.iter().map(|pose| errors(pose, &truth)).collect()
        });
        let answer = traced.answer.as_ref().map(|answer| {
            let probability = answer.probability.map(|p| format!(", {}", Percent(p)));
            format!(
                "{}: {}{}",
                answer.mode,
                answer.verdict,
                probability.unwrap_or_default()
            )
        });
        View {
            answer,
            name: &header.name,
            policy: &header.policy,
            points: [header.source.len(), header.target.len()],
            source: quantised(&header.source, frame),
            target: quantised(&header.target, frame),
            radius: frame.scale,
            poses: poses.iter().map(|pose| normalised(pose, frame)).collect(),
            errors,
            steps: traced
                .steps
                .iter()
                .map(|step| StepView {
                    ids: [step.translation_id, step.rotation_id].concat(),
                    signed: [step.translation, step.rotation_rad].concat(),
                    probabilities: step
                        .translation_probability
                        .zip(step.rotation_probability)
                        .map(|(t, r)| thousandths(&t).chain(thousandths(&r)).collect()),
                })
                .collect(),
        }
    }
}

fn thousandths(of_axes: &Probabilities) -> impl Iterator<Item = Vec<u16>> + '_ {
    let thousandth = |p: &f32| (p * 1000.0).round() as u16;
    of_axes
        .iter()
        .map(move |axis| axis.iter().map(thousandth).collect())
}

/// Points at equal steps in the cloud's order, in whole thousandths of the frame's scale.
fn quantised(cloud: &[Point], frame: Frame) -> Vec<i32> {
    let shown = cloud.len().min(POINTS);
    (0..shown)
        .flat_map(|i| {
            let point = Vec3::from(cloud[i * cloud.len() / shown]);
            let seen = (point - frame.centre) / frame.scale * QUANTA;
            seen.to_array().map(|x| x.round() as i32)
        })
        .collect()
}

/// The pose in the target's normalised frame: `x_n = (x - c) / s`, so `t_n = (R c + t - c) / s`.
fn normalised(pose: &Pose, frame: Frame) -> Vec<f64> {
    let translation = (pose.apply(frame.centre) - frame.centre) / frame.scale;
    let rows = Pose {
        rotation: pose.rotation,
        translation,
    }
    .to_rows();
    let rounded = |x: f32| (f64::from(x) * 1e5).round() / 1e5;
    rows.iter().flatten().map(|x| rounded(*x)).collect()
}

/// Angle between the rotations, degrees, by `|R - R*| = 2 sqrt(2) sin(angle / 2)`; and distance between the translations.
fn errors(pose: &Pose, truth: &Pose) -> [f64; 2] {
    let difference = (pose.rotation - truth.rotation).to_cols_array();
    let norm = difference
        .iter()
        .map(|x| f64::from(*x).powi(2))
        .sum::<f64>()
        .sqrt();
    let angle = 2.0 * (norm / 8f64.sqrt()).min(1.0).asin();
    let distance = f64::from((pose.translation - truth.translation).length());
    let rounded = |x: f64| (x * 1e5).round() / 1e5;
    [rounded(angle.to_degrees()), rounded(distance)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;

    #[test]
    fn errors_are_an_angle_and_a_length() {
        let turned = Pose {
            rotation: Mat3::from_rotation_z(0.3),
            translation: Vec3::new(0.0, 3.0, 4.0),
        };
        let [angle, distance] = errors(&turned, &Pose::IDENTITY);
        assert!((angle - 0.3f64.to_degrees()).abs() < 1e-4, "{angle}");
        assert!((distance - 5.0).abs() < 1e-5);
    }

    #[test]
    fn clouds_are_thinned_and_poses_follow_them_into_the_targets_frame() {
        let target: Vec<Point> = (0..4000)
            .map(|i| [10.0 + (i % 3) as f32, 5.0, 1.0])
            .collect();
        let frame = Frame::of(&target).expect("extent");
        let flat = quantised(&target, frame);
        assert_eq!(flat.len(), 3 * POINTS);
        assert!(flat.iter().all(|x| x.abs() <= 1001));
        let pose = Pose {
            rotation: Mat3::from_rotation_x(0.5),
            translation: Vec3::new(1.0, 2.0, 3.0),
        };
        let moved = normalised(&pose, frame);
        let point = Vec3::new(11.0, 7.0, 3.0);
        let seen = (point - frame.centre) / frame.scale;
        let expected = (pose.apply(point) - frame.centre) / frame.scale;
        let x = moved[0] as f32 * seen.x
            + moved[1] as f32 * seen.y
            + moved[2] as f32 * seen.z
            + moved[3] as f32;
        assert!((x - expected.x).abs() < 1e-3, "{x} {expected}");
    }
}
