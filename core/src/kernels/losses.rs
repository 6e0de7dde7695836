//! What a pair of nearest points says of a fit, pairs in lanes.

use super::lanes::{Lanes, Vectors};
use crate::loss::GAP;

/// Loss of a point `apart` from the nearest of a surface sampled with neighbourhoods of `radius`, whose normal
/// there is given: 0 on the surface, half `scale` radii from it, 1 far away.
#[inline(always)]
pub(super) fn of_surface<L: Lanes>(
    apart: Vectors<L>,
    normal: Vectors<L>,
    radius: f32,
    scale: f32,
) -> L {
    let across = normal.dot(apart);
    let along = (apart.dot(apart) - across * across).max(L::all(0.0)).sqrt();
    let beyond = (along - L::all(GAP * radius)).max(L::all(0.0));
    saturating(across * across + beyond * beyond, scale * radius)
}

/// `d² / (d² + c²)` (Geman and McClure).
#[inline(always)]
fn saturating<L: Lanes>(squared: L, half: f32) -> L {
    squared / (squared + L::all((half * half).max(1e-12)))
}
