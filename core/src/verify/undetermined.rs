//! What the shape leaves open: other poses that fit as well as the best, and an axis about which the clouds may be turned.

use super::search::SLIPPERY;
use super::{Contender, RANKED};
use crate::loss::CONTENDERS;
use crate::polish::{Candidate, Refiner};
use crate::pose::Pose;
use crate::rotation::Rotation;
use crate::search::is_same;
use crate::solve::Rigid;
use glam::Vec3;

/// Standard errors below which a difference of losses is what sampling explains: more than of independent points, since
/// errors of neighbours are alike.
const EXPLAINED: f32 = 4.0;
/// Turns about an axis, in both senses, by which it is seen how well the shape fixes the angle, radians.
const AXIS_TURNS: [f32; 6] = [0.175, 0.35, 0.7, 1.3, 2.2, core::f32::consts::PI];

/// Poses named as fitting equally well, at most.
pub const OTHERS: usize = 5;

/// What the shape leaves open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undetermined {
    /// Turned about this axis the clouds fit as well.
    pub axis: Option<Axis>,
    /// Other poses that fit as well, target_from_source.
    pub poses: [Option<Pose>; OTHERS],
}

/// A line in the target's frame, and how far the source may be turned about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// On the line, in the target's units.
    pub point: Vec3,
    /// Unit vector along it.
    pub direction: Vec3,
    /// Largest angle that fits as well in both senses, radians: π where any does.
    pub half_angle_rad: f32,
}

impl Undetermined {
    /// Nothing: no other pose was found to fit as well.
    pub const NOTHING: Undetermined = Undetermined {
        axis: None,
        poses: [None; OTHERS],
    };
}

impl Refiner<'_> {
    /// What fits as well as the best.
    pub(super) fn undetermined(
        &mut self,
        best: usize,
        found: &Candidate,
        contenders: &[Option<Contender>; RANKED],
    ) -> Undetermined {
        let mut undetermined = Undetermined::NOTHING;
        let axis =
            (found.rotation_constraint < SLIPPERY).then(|| self.least_constraint(found.at).0);
        let half_angle_rad = axis.map_or(0.0, |axis| self.free_angle(found.at, axis));
        let axis = axis.filter(|_| half_angle_rad > 0.0);
        if let Some(direction) = axis {
            let point = self.target_centre();
            undetermined.axis = Some(Axis {
                point,
                direction,
                half_angle_rad,
            });
        }
        // What is named, and so not named again: the same poses, and the same turned about the open axis.
        let mut named = [None; 1 + OTHERS];
        named[0] = Some(found.at);
        let is_named = |named: &[Option<Rigid>], at: Rigid| {
            let turned = |other| axis.is_some_and(|axis| differ_by_turn(at, other, axis));
            let mut named = named.iter().flatten();
            named.any(|&other| is_same(at, other) || turned(other))
        };
        for (i, contender) in contenders.iter().enumerate() {
            let Some(contender) = contender else { continue };
            if i == best || is_named(&named, contender.at) {
                continue;
            }
            let fits_as_well = self.losses().excess(i, best).score() < EXPLAINED;
            let free = named.iter_mut().find(|named| named.is_none());
            if let (true, Some(place)) = (fits_as_well, free) {
                *place = Some(contender.at);
            }
        }
        let others = named.iter().skip(1).flatten();
        for (place, &at) in undetermined.poses.iter_mut().zip(others) {
            *place = Some(self.outside(at));
        }
        undetermined
    }

    /// Largest angle by which the clouds may be turned about an axis in both senses and fit as well; 0 if by none.
    fn free_angle(&mut self, at: Rigid, axis: Vec3) -> f32 {
        const HERE: usize = CONTENDERS - 1;
        const TURNED: usize = CONTENDERS - 2;
        self.keep_losses(HERE, at);
        let mut free = 0.0;
        for angle in AXIS_TURNS {
            let fits = [0.5 * angle, -0.5 * angle].into_iter().all(|half| {
                let (sine, cosine) = libm::sincosf(half);
                self.keep_losses(TURNED, at.turned(Rotation::new(axis * sine, cosine)));
                self.losses().excess(TURNED, HERE).score() < EXPLAINED
            });
            if !fits {
                break;
            }
            free = angle;
        }
        free
    }
}

/// How much less probable the next pose is than the best, unless the best turned about the open axis is meant.
pub(super) fn lead(
    best: usize,
    contenders: &[Option<Contender>; RANKED],
    open: Option<Axis>,
) -> f32 {
    let Some(winner) = contenders.get(best).copied().flatten() else {
        return f32::INFINITY;
    };
    let others = contenders.iter().enumerate().filter(|&(i, _)| i != best);
    let others = others.filter_map(|(_, contender)| *contender);
    let apart = |other: &Contender| {
        open.is_none_or(|axis| !differ_by_turn(other.at, winner.at, axis.direction))
    };
    let energies = others.filter(apart).map(|other| other.energy);
    energies.fold(f32::INFINITY, f32::min) - winner.energy
}

/// Whether two poses differ by a turn about an axis through the target's centre, and by little else.
fn differ_by_turn(a: Rigid, b: Rigid, axis: Vec3) -> bool {
    let along = |at: Rigid| at.turn.matrix().transpose() * axis;
    along(a).dot(along(b)) > 0.99 && (a.centre() - b.centre()).length_squared() < 0.15 * 0.15
}
