//! What the shape leaves open: an axis about which the clouds may be turned, a direction along which they may be moved, and other
//! poses that fit as well as the best.

use super::fold::Fold;
use super::search::SLIPPERY;
use super::{Contender, HARDLY_EXPLAINED, HERE, RANKED, THERE};
use crate::covariance::Covariance;
use crate::error::Error;
use crate::polish::{Candidate, Refined, Refiner};
use crate::pose::Pose;
use crate::rotation::Rotation;
use crate::search::SAME;
use crate::solve::Rigid;
use core::f32::consts::{PI, TAU};
use glam::Vec3;

/// Standard errors below which a difference of losses is what sampling explains: more than of independent points, since
/// errors of neighbours are alike.
const TIED: f32 = 4.0;
/// Turns about an axis, in either sense, by which it is seen how well the shape fixes the angle, radians.
const TURNS: [f32; 6] = [0.175, 0.35, 0.7, 1.3, 2.2, PI];
/// How firmly the weakest turn is held, as a share of what holds all turns ([`Refiner::least_held_turn`]): from here on, no turn is tried.
const HELD: f32 = 0.25;
/// If any turn in one sense fits, how many of the turns in the other may seem not to, by chance.
const CHANCE: usize = 1;
/// Shifts along a direction, in either sense, by which it is seen how well the shape fixes the place, target radii.
const SHIFTS: [f32; 9] = [0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.9, 1.1, 1.4];
/// How often the step between the last of these that fits and the next is halved, to see how far it fits.
const HALVED: usize = 2;
/// Cosine of the angle below which two directions are one.
const ALONG: f32 = 0.99;

/// Poses named as fitting equally well, at most.
pub const OTHERS: usize = 5;

/// What the shape leaves open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undetermined {
    /// Axis about which the source can be turned without fitting worse.
    pub axis: Option<Axis>,
    /// Direction along which the source can be moved without fitting worse.
    pub slide: Option<Slide>,
    /// Whether the axis, about which any turn fits, may have any direction: a ball.
    pub any_rotation: bool,
    /// Rotational symmetry whose turns leave the fit as it is.
    pub fold: Option<Fold>,
    /// Other poses that fit as well, target_from_source, without those that the symmetry makes of the given pose, and of these
    /// ([`Fold::of_others`]): [`Undetermined::copies`] lists all.
    pub poses: [Option<Pose>; OTHERS],
}

/// A line in the target's frame, and how far the source may be turned about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// On the line, in the target's units; a ball's centre.
    pub point: Vec3,
    /// Unit vector along it.
    pub direction: Vec3,
    /// Least and largest turn about it that fit as well, radians, by the right hand: the first is not positive, the second not
    /// negative; -π and π where any turn does.
    pub range_rad: [f32; 2],
}

/// A direction in the target's frame, and how far the source may be moved along it: a piece of a bar on the whole bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// Unit vector.
    pub direction: Vec3,
    /// Least and largest shift along it that fit as well, in the target's units; the first is not positive, the second not negative.
    pub range: [f32; 2],
}

impl Undetermined {
    /// Nothing: no other pose was found to fit as well.
    pub const NOTHING: Undetermined = Undetermined {
        axis: None,
        slide: None,
        any_rotation: false,
        fold: None,
        poses: [None; OTHERS],
    };

    /// Whether no turn, no shift and no other pose fits as well.
    pub fn is_nothing(&self) -> bool {
        *self == Undetermined::NOTHING
    }

    /// All other poses that are named as fitting as well as the given one, what the axis and the direction leave open aside.
    pub fn copies(&self, given: Pose) -> impl Iterator<Item = Pose> {
        let fold = self.fold;
        let turned = move |pose, fold: Option<Fold>| {
            fold.into_iter().flat_map(move |fold| fold.copies(pose))
        };
        let of_others = fold.filter(|fold| fold.of_others);
        let others = self.poses.into_iter().flatten();
        let others =
            others.flat_map(move |pose| core::iter::once(pose).chain(turned(pose, of_others)));
        turned(given, fold).chain(others)
    }

    /// Keeps a symmetry. If parts of its turn fit as well, or the open turn reaches from one of its turns to the next, any turn
    /// about its axis is open instead.
    fn take(&mut self, fold: Fold, is_any: bool) -> bool {
        let reaches = |axis: Axis| {
            let [least, most] = axis.range_rad;
            let is_same = axis.direction.dot(fold.direction).abs() > ALONG;
            is_same && (most - least) * f32::from(fold.order) >= TAU
        };
        if is_any || self.axis.is_some_and(reaches) {
            self.axis = Some(Axis {
                point: fold.point,
                direction: fold.direction,
                range_rad: [-PI, PI],
            });
            return false;
        }
        self.fold = Some(fold);
        true
    }

    /// A pose's covariance, with what is open in it.
    pub(crate) fn widen(&self, mut covariance: Covariance) -> Covariance {
        if let Some(Axis {
            point,
            direction,
            range_rad,
        }) = self.axis
        {
            let towards = point - covariance.about;
            covariance.move_to(if self.any_rotation {
                point
            } else {
                covariance.about + towards.reject_from_normalized(direction)
            });
            covariance.open_turn(direction, range_rad);
            if self.any_rotation {
                let (right, up) = direction.any_orthonormal_pair();
                covariance.open_turn(right, range_rad);
                covariance.open_turn(up, range_rad);
            }
        }
        if let Some(slide) = self.slide {
            covariance.open_shift(slide.direction, slide.range);
        }
        covariance
    }

    /// Whether two poses differ by what the axis, the direction and the symmetry leave open, and by little else.
    // Called at three places: inlined, it takes a kilobyte of a board's flash at each.
    #[inline(never)]
    pub(super) fn is_open(&self, a: Rigid, b: Rigid) -> bool {
        let is_turned = match self.axis {
            Some(Axis { direction, .. }) => {
                let along = |at: Rigid| at.rotation.matrix().transpose() * direction;
                along(a).dot(along(b)) > ALONG
            }
            None => a.rotation.likeness(b.rotation) > SAME,
        } || self
            .fold
            .is_some_and(|fold| fold.confuses(a.rotation, b.rotation, SAME));
        let mut apart = a.centre() - b.centre();
        if let Some(Slide { direction, .. }) = self.slide {
            apart -= direction * direction.dot(apart);
        }
        is_turned && apart.length_squared() < 0.15 * 0.15
    }
}

impl Refiner<'_> {
    /// Polishes a pose, and says what turn is open if planes hardly hold it.
    pub(crate) fn polish_and_examine(
        &mut self,
        pose: Pose,
    ) -> Result<(Refined, Undetermined), Error> {
        let at = self.inside(pose.checked()?);
        let found = self.polish_inside(at);
        let refined = self.refined(&found, pose);
        let mut undetermined = Undetermined::NOTHING;
        if found.rotation_constraint < SLIPPERY {
            (undetermined.axis, undetermined.any_rotation) = self.free_turns(found.at);
        }
        Ok((refined, undetermined))
    }

    /// What fits as well as the best.
    pub(super) fn undetermined(
        &mut self,
        best: usize,
        found: &Candidate,
        contenders: &[Option<Contender>; RANKED],
    ) -> Undetermined {
        let (axis, any_rotation) = self.free_turns(found.at);
        let mut undetermined = Undetermined {
            axis,
            any_rotation,
            slide: self.free_slide(found.at),
            ..Undetermined::NOTHING
        };
        let is_tied = |i: usize| i != best && self.losses().excess(i, best).score() < TIED;
        let tied: [bool; RANKED] = core::array::from_fn(is_tied);
        let rivals = contenders.iter().zip(tied);
        let rivals = rivals.filter_map(|(held, is_tied)| held.filter(|_| is_tied));
        let is_full = |axis: Axis| axis.range_rad == [-PI, PI];
        let mut fold = None;
        // Of a pose that explains little, any turn fits as well.
        if found.residual.source < HARDLY_EXPLAINED
            && !axis.is_some_and(is_full)
            && let Some((found, is_any)) = self.fold(found.at, rivals.map(|held| held.at))
        {
            fold = undetermined
                .take(self.fold_outside(found), is_any)
                .then_some(found);
        }
        // What is named, and so not named again: the same poses, and those that differ from them by what is open.
        let mut named = [None; 1 + OTHERS];
        named[0] = Some(found.at);
        let without = Undetermined {
            fold: None,
            ..undetermined
        };
        for (contender, is_tied) in contenders.iter().zip(tied) {
            let Some(contender) = contender.filter(|_| is_tied) else {
                continue;
            };
            let of_others = fold.is_some_and(|fold| fold.of_others);
            let is_open = |(i, &other): (usize, &Rigid)| {
                let open = if i == 0 || of_others {
                    &undetermined
                } else {
                    &without
                };
                open.is_open(contender.at, other)
            };
            let is_named = named.iter().flatten().enumerate().any(is_open);
            let free = named.iter_mut().find(|named| named.is_none());
            if let (false, Some(place)) = (is_named, free) {
                *place = Some(contender.at);
                if let Some(fold) = fold.as_mut().filter(|fold| fold.of_others) {
                    fold.of_others = self.allows(*fold, contender.at);
                }
            }
        }
        undetermined.fold = fold.map(|fold| self.fold_outside(fold));
        let others = named.iter().skip(1).flatten();
        for (place, &at) in undetermined.poses.iter_mut().zip(others) {
            *place = Some(self.outside(at));
        }
        undetermined
    }

    /// The axis about which the clouds may be turned and fit as well, and whether it may have any direction.
    fn free_turns(&mut self, at: Rigid) -> (Option<Axis>, bool) {
        let turn = self.least_held_turn(at);
        let (axis, centre) = (turn.axis, turn.centre());
        if turn.held >= HELD {
            return (None, false);
        }
        self.keep_losses(HERE, at);
        let through = turn.through(axis);
        let fits = |refiner: &mut Self, angle: f32| refiner.fits_turned(at, [axis, through], angle);
        let [back, forth] =
            [-1.0, 1.0].map(|sense| reach(&TURNS, |angle| fits(self, sense * angle)));
        let [most_back, most_forth] = [back, forth].map(|end| end.map_or(0.0, |(angle, _)| angle));
        let (farther, other_sense) = if most_back > most_forth {
            (back, 1.0)
        } else {
            (forth, -1.0)
        };
        let Some((angle, there)) = farther else {
            return (None, false);
        };
        // A turn that fits all around in one sense does so in the other, too.
        let misses = |refiner: &mut Self| {
            let misses = TURNS.iter().filter(|&angle| {
                let there = fits(refiner, other_sense * angle);
                there.is_none()
            });
            misses.count()
        };
        let is_full = angle == PI && (most_back == most_forth || misses(self) <= CHANCE);
        let (right, up) = axis.any_orthonormal_pair();
        let any_rotation = is_full
            && [right, up].into_iter().all(|across| {
                let line = [across, turn.through(across)];
                self.fits_turned(at, line, 0.5 * PI).is_some()
            });
        // Not quite that of the least constraint: what else was drawn near moves it to where the shape's own one is.
        let turn = there.rotation.after(at.rotation.inverse());
        let line = turn.line(there.shift - turn.matrix() * at.shift);
        let of_line = |point| if any_rotation { centre } else { point };
        let line = line.filter(|(direction, point)| direction.is_finite() && point.is_finite());
        let axis = line.map(|(direction, point)| Axis {
            point: self.target_centre() + of_line(point) * self.target_scale(),
            direction: direction * direction.dot(axis).signum(),
            range_rad: if is_full {
                [-PI, PI]
            } else {
                [-most_back, most_forth]
            },
        });
        (axis, any_rotation && axis.is_some())
    }

    /// The direction along which the clouds may be moved and fit as well.
    fn free_slide(&mut self, at: Rigid) -> Option<Slide> {
        let (direction, held) = self.least_held_shift(at);
        if held >= SLIPPERY || direction == Vec3::ZERO {
            return None;
        }
        self.keep_losses(HERE, at);
        let fits = |refiner: &mut Self, shift: f32| {
            let moved = Rigid {
                shift: at.shift + direction * shift,
                ..at
            };
            refiner.fits_as_well([Vec3::ZERO, direction], moved)
        };
        let range = [-1.0, 1.0].map(|sense| {
            let end = reach(&SHIFTS, |shift| fits(self, sense * shift));
            end.map(|(shift, _)| sense * shift)
        });
        let scale = self.target_scale();
        (range != [None; 2]).then(|| Slide {
            direction,
            range: range.map(|shift| shift.unwrap_or(0.0) * scale),
        })
    }

    /// The pose after a turn about a line, given by its direction and a point, if the clouds fit as well there. See
    /// [`Self::fits_as_well`].
    #[inline(never)]
    pub(super) fn fits_turned(
        &mut self,
        at: Rigid,
        [direction, point]: [Vec3; 2],
        angle_rad: f32,
    ) -> Option<Rigid> {
        let there = at.turned_about(point, Rotation::about(direction, angle_rad));
        self.fits_as_well([direction, point.cross(direction)], there)
    }

    /// The pose, if the clouds fit as well there as under the one whose losses were kept. What is open is held: all else may be a little
    /// off, since the axis of a shape is not quite that of its points.
    #[inline(never)]
    fn fits_as_well(&mut self, open: [Vec3; 2], there: Rigid) -> Option<Rigid> {
        let there = self.drawn_near_but(open, there);
        self.keep_losses(THERE, there);
        let fits = self.losses().excess(THERE, HERE).score() < TIED;
        fits.then_some(there)
    }
}

/// The largest of growing steps that fits, and its pose. Where the next one does not fit, the step between them is halved a few times.
fn reach(steps: &[f32], mut fits: impl FnMut(f32) -> Option<Rigid>) -> Option<(f32, Rigid)> {
    let mut reached = None;
    for &step in steps {
        let Some(there) = fits(step) else {
            let (mut last, mut there) = reached?;
            let mut missed = step;
            for _ in 0..HALVED {
                let between = 0.5 * (last + missed);
                match fits(between) {
                    Some(at) => (last, there) = (between, at),
                    None => missed = between,
                }
            }
            return Some((last, there));
        };
        reached = Some((step, there));
    }
    reached
}

/// How much less probable the next pose is than the best, unless it differs from that by what is open.
pub(super) fn lead(
    best: usize,
    contenders: &[Option<Contender>; RANKED],
    open: &Undetermined,
) -> f32 {
    let Some(winner) = contenders.get(best).copied().flatten() else {
        return f32::INFINITY;
    };
    let others = contenders.iter().enumerate().filter(|&(i, _)| i != best);
    let others = others.filter_map(|(_, contender)| *contender);
    let energies = others
        .filter(|other| !open.is_open(other.at, winner.at))
        .map(|other| other.energy);
    energies.fold(f32::INFINITY, f32::min) - winner.energy
}

#[cfg(test)]
mod tests;
