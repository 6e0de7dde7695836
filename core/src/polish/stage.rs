//! Stages of a refinement: their steps, their points, and their gate, the distance from which on a match has no weight.

/// The steps of one stage.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Most steps.
    pub(crate) iterations: usize,
    /// Points of each cloud that are matched, approximately.
    pub(crate) points: usize,
    /// The gate, in median distances.
    pub(crate) gate: f32,
    /// Widest gate, in neighbourhood radii.
    pub(crate) widest: f32,
    /// Weight of point-to-point distances, relative to point-to-plane distances.
    pub(crate) tangential: f32,
    /// A step with a turn (radians) and a shift below this ends the stage.
    pub(super) settled: f32,
}

impl Stage {
    /// The squared gate, from the median squared distance and the radius of a neighbourhood.
    pub(super) fn gate(&self, median: f32, radius: f32) -> f32 {
        let (least, widest) = (LEAST_GATE * radius, self.widest * radius);
        (self.gate * self.gate * median)
            .max(least * least)
            .min(widest * widest)
            .max(1e-12)
    }
}

/// Pulls the pose in from where a policy ends.
pub(super) const NEAR: Stage = Stage {
    iterations: 12,
    points: 512,
    gate: 4.0,
    widest: f32::INFINITY,
    tangential: 0.0,
    settled: 3e-4,
};
/// Finishes the refinement.
pub(super) const FINE: Stage = Stage {
    iterations: 10,
    points: usize::MAX,
    gate: 3.0,
    widest: WIDEST_GATE,
    tangential: 0.2,
    settled: 3e-4,
};
/// As `NEAR` and `FINE`, for a hypothesis that is to be compared with others.
pub(super) const BRIEF_NEAR: Stage = Stage {
    iterations: 6,
    points: 256,
    settled: 3e-3,
    ..NEAR
};
pub(super) const BRIEF_FINE: Stage = Stage {
    iterations: 4,
    points: 384,
    settled: 3e-3,
    ..FINE
};
/// Narrowest gate, in neighbourhood radii.
const LEAST_GATE: f32 = 0.02;
/// Widest gate of the last steps, in neighbourhood radii. Where clouds overlap in part, the median distance is that of points
/// without a counterpart.
const WIDEST_GATE: f32 = 0.4;
