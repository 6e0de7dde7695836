//! One registration of two clouds in the user's own units.

use crate::dataset::Point;
use crate::random::{Purpose, stream};
use rand::seq::index;
use reagent_core::dims::MAX_POINTS;
use reagent_core::net::Scratch;
use reagent_core::steps::STEPS;
use reagent_core::{Action, Error, Frame, Policy, Pose, Registrar, Verdict};
use serde::Serialize;

/// Points drawn from a cloud that exceeds the capacity.
pub const SUBSAMPLE: usize = 2048;

/// One step of a registration, as the trace file holds it: one JSON object a line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TraceLine {
    /// Number of the step, from 1.
    pub step: usize,
    /// Step ids of the translation along x, y, z (0 to 10, 5 is stop).
    pub translation_id: [u8; 3],
    /// Step ids of the rotation about x, y, z.
    pub rotation_id: [u8; 3],
    /// Signed translation, in the clouds' units.
    pub translation: [f32; 3],
    /// Signed rotation angles, radians.
    pub rotation_rad: [f32; 3],
    /// Pose after the step, rows of `[R | t]`, in the clouds' units.
    pub target_from_source: [[f32; 4]; 3],
}

/// A finished registration.
#[derive(Clone, Debug, PartialEq)]
pub struct Registered {
    /// Plain rigid transform in the clouds' units.
    pub target_from_source: Pose,
    /// Whether the policy ended by stopping.
    pub verdict: Verdict,
    /// Every step taken.
    pub trace: Vec<TraceLine>,
}

/// Registers `source [N, 3]` to `target [M, 3]`, both in the same unit of length, from `initial`. The policy
/// sees them in the target's frame: its mean at the origin, its farthest point at 1. Ends early where the
/// policy stops on every axis: it would do so again in every further step.
///
/// # Errors
/// Clouds or an initial pose that the core refuses.
pub fn register(
    policy: Policy<'_>,
    source: &[Point],
    target: &[Point],
    initial: Pose,
    steps: usize,
) -> Result<Registered, Error> {
    let mut scratch = Box::new(Scratch::new());
    let frame = Frame::of(target)?;
    let mut registrar = Registrar::new(policy, &mut scratch);
    let mut registration = registrar.start(source, target, frame, initial)?;
    let mut trace = Vec::with_capacity(steps);
    while registration.steps() < steps && registration.verdict() != Verdict::Converged {
        let action = registrar.step(&mut registration).action;
        trace.push(line(
            registration.steps(),
            action,
            frame,
            registration.target_from_source(),
        ));
    }
    Ok(Registered {
        target_from_source: registration.target_from_source(),
        verdict: registration.verdict(),
        trace,
    })
}

fn line(step: usize, action: Action, frame: Frame, pose: Pose) -> TraceLine {
    let signed = |ids: [u8; 3]| ids.map(|id| STEPS.get(usize::from(id)).copied().unwrap_or(0.0));
    TraceLine {
        step,
        translation_id: action.translation,
        rotation_id: action.rotation,
        translation: signed(action.translation).map(|t| t * frame.scale),
        rotation_rad: signed(action.rotation),
        target_from_source: pose.to_rows(),
    }
}

/// A cloud within the core's capacity: itself, or [`SUBSAMPLE`] of its points, drawn without replacement
/// from the seed's stream number `index`, in their order.
pub fn within_capacity(points: Vec<Point>, seed: u64, index: u64) -> Vec<Point> {
    if points.len() <= MAX_POINTS {
        return points;
    }
    let rng = &mut stream(seed, Purpose::Pairs, index);
    let mut chosen = index::sample(rng, points.len(), SUBSAMPLE).into_vec();
    chosen.sort_unstable();
    chosen.into_iter().map(|i| points[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_clouds_beyond_the_capacity_are_subsampled() {
        let cloud = |n: usize| (0..n).map(|i| [i as f32, 0.0, 0.0]).collect::<Vec<Point>>();
        assert_eq!(within_capacity(cloud(MAX_POINTS), 1, 0).len(), MAX_POINTS);
        let drawn = within_capacity(cloud(MAX_POINTS + 1), 1, 0);
        assert_eq!(drawn.len(), SUBSAMPLE);
        assert!(drawn.is_sorted_by(|a, b| a[0] < b[0]), "no point twice");
        assert_eq!(drawn, within_capacity(cloud(MAX_POINTS + 1), 1, 0));
        assert_ne!(drawn, within_capacity(cloud(MAX_POINTS + 1), 2, 0));
    }
}
