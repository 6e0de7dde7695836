//! Rotational symmetry: turns about an axis by equal parts of a full one, after which the clouds fit as well.

use super::HERE;
use super::search::ALIKE;
use crate::polish::Refiner;
use crate::pose::Pose;
use crate::rotation::Rotation;
use crate::search::{SAME, SIFT_POINTS, SIFT_SCALE};
use crate::solve::Rigid;
use core::f32::consts::TAU;
use glam::Vec3;

/// Orders of symmetry that are looked for. Two poses that differ by a half turn are named as they are.
const LEAST: u8 = 3;
const MOST: u8 = 36;
/// Highest order that is inferred from a half turn alone: boxes have half turns, too, and higher orders mostly show in other turns.
const MOST_OF_HALF: u8 = 12;
/// Cosine of half the angle, 177 degrees, from which on a turn is a half turn.
const NEARLY_HALF: f32 = 0.026;
/// Turns of a symmetry after which all points are compared, about.
const SEEN: u8 = 12;
/// Cosine of half the angle, 3.4 degrees, by which two poses that a symmetry confuses may miss one of its turns.
const MET: f32 = 0.999_55;
/// Parts of a symmetry's turn, by which it is seen whether any turn fits. They are not all multiples of a finer symmetry's.
const PARTS: [f32; 2] = [0.5, 0.38];
/// Distance by which they may be shifted along its axis, target radii.
const SHIFTED: f32 = 0.05;

/// A rotational symmetry: turned about this axis by any multiple of a full turn over `order`, the clouds fit as well. A flange with
/// six holes has one of order 6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fold {
    /// A point of the axis, in the target's frame and units.
    pub point: Vec3,
    /// Unit vector along it.
    pub direction: Vec3,
    /// Number of equivalent poses, the given one included; at least 3.
    pub order: u8,
    /// Whether it holds for the other poses that fit as well, too. It does not for those of a square face that is seen alone.
    pub of_others: bool,
}

impl Fold {
    /// The other poses that are equivalent to one.
    pub fn copies(self, pose: Pose) -> impl Iterator<Item = Pose> {
        (1..self.order).map(move |k| {
            let rotation = self.turn(f32::from(k)).matrix();
            Pose {
                rotation: rotation * pose.rotation,
                translation: self.point + rotation * (pose.translation - self.point),
            }
        })
    }

    /// Whether a rotation differs from another by one of its turns, to the cosine of half of an angle.
    pub(super) fn confuses(self, a: Rotation, b: Rotation, likeness: f32) -> bool {
        let between = b.after(a.inverse());
        (0..self.order).any(|k| self.turn(f32::from(k)).likeness(between) > likeness)
    }

    /// Its smallest turn.
    fn part_rad(self) -> f32 {
        TAU / f32::from(self.order)
    }

    /// A turn by so many of its smallest turns.
    fn turn(self, parts: f32) -> Rotation {
        Rotation::about(self.direction, parts * self.part_rad())
    }

    /// The pose after such a turn. As the pose, the axis is in the refiner's frame.
    fn turned(self, at: Rigid, parts: f32) -> Rigid {
        at.turned_about(self.point, self.turn(parts))
    }
}

impl Refiner<'_> {
    /// The symmetry of highest order that equally good poses suggest, if the clouds fit after each of its turns; and whether they
    /// fit after parts of a turn as well, so that any turn may be open. It is in the refiner's frame.
    #[inline(never)]
    pub(super) fn fold(
        &mut self,
        at: Rigid,
        tied: impl Iterator<Item = Rigid>,
    ) -> Option<(Fold, bool)> {
        let none = Rotation::new(Vec3::ZERO, 1.0);
        let mut tied = tied.peekable();
        tied.peek()?;
        self.keep_losses(HERE, at);
        let mut found: Option<Fold> = None;
        for other in tied {
            let between = other.rotation.after(at.rotation.inverse());
            let shift = other.shift - between.matrix() * at.shift;
            let Some((direction, point)) = between.line(shift) else {
                continue;
            };
            if direction.dot(shift).abs() > SHIFTED || between.likeness(none) > SAME {
                continue;
            }
            let least = found.map_or(LEAST, |found| found.order + 1);
            let is_half = between.likeness(none) < NEARLY_HALF;
            let most = if is_half { MOST_OF_HALF } else { MOST };
            let orders = (least..=most).rev();
            let mut folds = orders.map(|order| Fold {
                point,
                direction,
                order,
                of_others: true,
            });
            found = folds
                .find(|&fold| {
                    fold.confuses(at.rotation, other.rotation, MET) && self.allows(fold, at)
                })
                .or(found);
        }
        let found = found?;
        let is_any = PARTS
            .into_iter()
            .all(|part| self.fits_after(at, found, part));
        Some((found, is_any))
    }

    /// In the user's frame.
    pub(super) fn fold_outside(&self, fold: Fold) -> Fold {
        Fold {
            point: self.target_centre() + fold.point * self.target_scale(),
            ..fold
        }
    }

    /// Whether the clouds fit as well after the turns of a symmetry: by few points after all of them, and by all points after some.
    #[inline(never)]
    pub(super) fn allows(&mut self, fold: Fold, at: Rigid) -> bool {
        let [few, _] = SIFT_POINTS;
        let most = self.coarse_loss(at, few, SIFT_SCALE) + ALIKE;
        let is_alike = |k: u8| {
            let turned = fold.turned(at, f32::from(k));
            self.coarse_loss_below(most, turned, few, SIFT_SCALE) < most
        };
        if !(1..fold.order).all(is_alike) {
            return false;
        }
        let step = fold.order.saturating_sub(1) / SEEN + 1;
        let mut k = 1;
        while k < fold.order {
            if !self.fits_after(at, fold, f32::from(k)) {
                return false;
            }
            k = k.saturating_add(step);
        }
        true
    }

    fn fits_after(&mut self, at: Rigid, fold: Fold, parts: f32) -> bool {
        let line = [fold.direction, fold.point];
        let fits = self.fits_turned(at, line, parts * fold.part_rad());
        fits.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::Fold;
    use crate::polish::tests::{Numbers, error, moved, pose};
    use crate::pose::Pose;
    use crate::verify::tests::{brick, revolved, verify};
    use crate::verify::{Undetermined, Verified};
    use glam::Vec3;

    /// A wheel of so many spokes, each as long as the function says, about an axis beside the origin.
    fn wheel(spokes: u8, seed: u32, length: impl Fn(u8) -> f32) -> Vec<[f32; 3]> {
        let hub = revolved(&mut Numbers(seed), 240, |z| 0.2 + 0.3 * z, 0.3);
        let spoke = |k: u8| {
            let half = [0.4 * length(k), 0.08, 0.1];
            let spoke = moved(
                &brick(half, 160, seed + u32::from(k)),
                pose([0.0; 3], [0.2 + half[0], 0.0, 0.0]),
            );
            let turn = core::f32::consts::TAU * f32::from(k) / f32::from(spokes);
            moved(&spoke, pose([0.0, 0.0, turn], [0.0; 3]))
        };
        let spokes = (0..spokes).flat_map(spoke);
        let all: Vec<_> = hub.into_iter().chain(spokes).collect();
        moved(&all, pose([0.0; 3], [0.3, -0.2, 0.1]))
    }

    fn compared(spokes: u8, length: impl Fn(u8) -> f32) -> (Verified, Pose) {
        let truth = pose([0.4, 0.9, -0.7], [0.1, 0.0, 0.2]);
        let target = wheel(spokes, 40, &length);
        let source = moved(&wheel(spokes, 70, length), truth.inverse());
        (
            verify(&source, &target, pose([0.5, 0.8, -0.6], [0.1, 0.0, 0.2])),
            truth,
        )
    }

    #[test]
    fn a_wheel_of_seven_spokes_may_be_turned_by_each_of_its_parts() {
        let (found, truth) = compared(7, |_| 1.0);
        let fold = found.undetermined.fold.expect("a symmetry");
        assert_eq!(fold.order, 7);
        assert!(fold.direction.z.abs() > 0.999, "{fold:?}");
        let off = (fold.point - Vec3::new(0.3, -0.2, 0.1)).reject_from(fold.direction);
        assert!(off.length() < 0.02, "{fold:?}");
        let given = found.best.target_from_source;
        let copies: Vec<Pose> = found.undetermined.copies(given).collect();
        assert_eq!(copies.len(), 6);
        let all = || copies.iter().chain([&given]);
        for turn in 0..7 {
            let turn = pose(
                [0.0, 0.0, core::f32::consts::TAU * turn as f32 / 7.0],
                [0.0; 3],
            );
            let middle = Vec3::new(0.3, -0.2, 0.1);
            let about = Pose {
                rotation: turn.rotation,
                translation: middle - turn.rotation * middle,
            };
            let true_too = about.after(truth);
            let is_near = |pose: &&Pose| {
                let (degrees, distance) = error(**pose, true_too);
                degrees < 1.5 && distance < 0.03
            };
            assert_eq!(all().filter(is_near).count(), 1);
        }
        // The runner-up is none of these.
        assert!(found.lead > 1.0, "{}", found.lead);
    }

    /// A square face of a part may be turned by quarters where it lies; where another face could be it, perhaps not.
    #[test]
    fn what_a_symmetry_makes_of_other_poses_is_named_if_it_was_seen() {
        let open = |of_others| Undetermined {
            fold: Some(Fold {
                point: Vec3::ZERO,
                direction: Vec3::Z,
                order: 4,
                of_others,
            }),
            poses: [
                Some(pose([1.0, 0.0, 0.0], [0.0; 3])),
                None,
                None,
                None,
                None,
            ],
            ..Undetermined::NOTHING
        };
        let count = |of_others| open(of_others).copies(Pose::IDENTITY).count();
        assert_eq!((count(false), count(true)), (4, 7));
    }

    #[test]
    fn a_wheel_with_one_short_spoke_may_not_be_turned() {
        let (found, truth) = compared(7, |k| if k == 2 { 0.4 } else { 1.0 });
        assert_eq!(found.undetermined.fold, None);
        let copies = found.undetermined.copies(found.best.target_from_source);
        let poses = copies.chain([found.best.target_from_source]);
        let right = poses.filter(|pose| error(*pose, truth).0 < 1.5);
        assert_eq!(right.count(), 1);
    }
}
