//! Stages of a refinement: how many steps, on how many points, and from which distance a match has no weight.

/// Steps of one kind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Steps at most.
    pub(crate) iterations: usize,
    /// Points of each cloud that are matched, about.
    pub(crate) points: usize,
    /// Distance from which a match has no weight, in median distances.
    pub(crate) gate: f32,
    /// The same at most, in radii of a neighbourhood.
    pub(crate) widest: f32,
    /// Weight of the distance between points beside that between planes.
    pub(crate) tangential: f32,
    /// A turn (radians) and shift below this end it.
    pub(super) settled: f32,
}

impl Stage {
    /// Squared distance from which a match has no weight, by the median squared distance.
    pub(super) fn gate(&self, median: f32, radius: f32) -> f32 {
        let (least, widest) = (LEAST_GATE * radius, self.widest * radius);
        (self.gate * self.gate * median)
            .max(least * least)
            .min(widest * widest)
            .max(1e-12)
    }
}

/// Draws near from where a policy ends.
pub(super) const NEAR: Stage = Stage {
    iterations: 12,
    points: 512,
    gate: 4.0,
    widest: f32::INFINITY,
    tangential: 0.0,
    settled: 3e-4,
};
/// Finishes.
pub(super) const FINE: Stage = Stage {
    iterations: 10,
    points: usize::MAX,
    gate: 3.0,
    widest: WIDEST_GATE,
    tangential: 0.2,
    settled: 3e-4,
};
/// The same for a hypothesis that is to be compared with others.
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
/// A match closer than this always counts, in radii of a neighbourhood.
const LEAST_GATE: f32 = 0.02;
/// Widest gate of the last steps, in radii of a neighbourhood: where clouds overlap in part, the median is that of
/// points without a counterpart.
const WIDEST_GATE: f32 = 0.4;
