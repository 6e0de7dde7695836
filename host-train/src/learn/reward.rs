//! The step reward: did the source come closer to where it belongs (paper, eq. 12)?

use crate::dataset::Point;
use reagent_core::kernels::Isa;
use reagent_core::view::View;

/// Reward of a step that brought the clouds closer.
pub const CLOSER: f32 = 0.5;
/// Reward of a step that took them apart.
pub const FARTHER: f32 = -0.6;
/// Reward of a step that changed nothing.
pub const SAME: f32 = -0.1;

/// One-sided Chamfer distance: mean over `points` of the squared distance to the nearest point of `truth`. NaN
/// where either is empty.
pub fn chamfer(points: &[Point], truth: &[Point]) -> f32 {
    chamfer_seen(points, &View::IDENTITY, truth)
}

/// As [`chamfer`], for a cloud under a view.
pub fn chamfer_seen(points: &[Point], view: &View, truth: &[Point]) -> f32 {
    reagent_core::chamfer::chamfer(Isa::best(), points, view, truth)
}

/// Reward for the distance before and after a step. Only equal bits count as unchanged.
pub fn reward(before: f32, after: f32) -> f32 {
    if after < before {
        CLOSER
    } else if after > before {
        FARTHER
    } else {
        SAME
    }
}
