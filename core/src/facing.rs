//! Which way a target's surface faces, if a mesh tells. Surfaces that face away from the sensor were not seen, so the far side
//! of a wall is not taken for its near side. Nor were those inside a housing.

use crate::dims::SURFACE_POINTS;
use crate::freespace::DepthGrid;
use crate::model::Model;
use crate::pose::Pose;
use crate::surface::Surface;
use glam::Vec3;

/// A surface faces away if the cosine between its outward normal and the direction to the sensor is below minus this. The
/// margin allows for estimated normals.
const AWAY: f32 = 0.1;

/// In place of the outward direction at a point that nothing outside can see, such as one inside a housing.
pub const INSIDE: [f32; 3] = [f32::INFINITY; 3];

/// A bit for each place of a surface.
#[derive(Clone, Debug)]
struct Bits([u64; SURFACE_POINTS / Bits::WORD]);

impl Bits {
    const WORD: usize = u64::BITS as usize;
    const NONE: Bits = Bits([0; SURFACE_POINTS / Bits::WORD]);

    fn set(&mut self, place: usize) {
        if let Some(word) = self.0.get_mut(place / Bits::WORD) {
            *word |= 1 << (place % Bits::WORD);
        }
    }

    fn has(&self, place: usize) -> bool {
        let word = self.0.get(place / Bits::WORD);
        word.is_some_and(|word| word >> (place % Bits::WORD) & 1 == 1)
    }
}

/// For a target's points, by place, whether the estimated normal points outward or inward; both at a point that nothing outside
/// can see.
#[derive(Clone, Debug)]
pub(crate) struct Facing {
    /// Whether it is known for any point.
    is_known: bool,
    outward: Bits,
    inward: Bits,
}

impl Facing {
    /// Nothing is known. All bits are zero.
    pub(crate) const UNKNOWN: Facing = Facing {
        is_known: false,
        outward: Bits::NONE,
        inward: Bits::NONE,
    };

    /// Takes in outward directions at a model's points, in the order of the cloud that the model was made of.
    pub(crate) fn fill(&mut self, model: &Model, outward: &[[f32; 3]]) {
        *self = Facing::UNKNOWN;
        for (point, &outward) in model.inside().zip(outward) {
            let here = model
                .surface
                .nearest_where(point.into(), f32::MIN_POSITIVE, &|_| true);
            // Points left out as outliers lie on no surface.
            let Some((place, _)) = here else { continue };
            let (_, normal) = model.surface.at(place);
            let along = normal.dot(Vec3::from_array(outward));
            let is_inside = outward == INSIDE;
            if is_inside || along > 0.0 {
                self.outward.set(place);
            }
            if is_inside || along < 0.0 {
                self.inward.set(place);
            }
            self.is_known |= is_inside || along.abs() > 0.0;
        }
    }

    /// The target under a pose, as it faces the sensor, if there is one. A sensor within the target's radius may stand inside,
    /// as in a room, and see the other sides; nothing is told then.
    pub(crate) fn seen_from<'f>(
        &'f self,
        seen: &DepthGrid,
        pose: Pose,
        target: &'f Surface,
    ) -> VisibleTarget<'f> {
        let eye = seen.eye().filter(|_| self.is_known);
        let eye = eye.map(|eye| pose.apply(eye));
        let outside = eye.filter(|eye| eye.length_squared() > 1.0);
        VisibleTarget {
            seen: outside.map(|eye| (self, eye)),
            target,
        }
    }
}

/// A target as it faces a sensor.
pub(crate) struct VisibleTarget<'f> {
    seen: Option<(&'f Facing, Vec3)>,
    target: &'f Surface,
}

impl VisibleTarget<'_> {
    /// Whether anything is known about it.
    pub(crate) fn tells(&self) -> bool {
        self.seen.is_some()
    }

    /// Whether the surface at a place faces away from the sensor, or nothing outside can see it; false if unknown.
    pub(crate) fn is_away(&self, place: usize) -> bool {
        let Some((facing, eye)) = self.seen else {
            return false;
        };
        let (point, normal) = self.target.at(place);
        let outward = match (facing.outward.has(place), facing.inward.has(place)) {
            (true, true) => return true,
            (true, false) => normal,
            (false, true) => -normal,
            (false, false) => return false,
        };
        let towards = eye - point;
        let along = outward.dot(towards);
        along < 0.0 && along * along > AWAY * AWAY * towards.length_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::INSIDE;
    use crate::polish::tests::Numbers;
    use crate::polish::{Refined, Refiner, Workspace};
    use crate::pose::Pose;
    use glam::Vec3;

    const HALF: f32 = 0.03;
    const ABOVE: Option<Vec3> = Some(Vec3::new(0.0, 0.0, 4.0));

    /// Points of a plate's upper or lower side.
    fn side(n: usize, numbers: &mut Numbers, z: f32) -> impl Iterator<Item = [f32; 3]> {
        (0..n).map(move |_| {
            let [x, y, _] = numbers.point();
            [0.8 * x, 0.5 * y, z]
        })
    }

    /// The upper side as a sensor above sees it, registered from a start nearer the lower one.
    fn refined(outward: &[[f32; 3]], seen_from: Option<Vec3>) -> Refined {
        plate(HALF, outward, seen_from)
    }

    /// The same with a plate of this half-thickness.
    fn plate(half: f32, outward: &[[f32; 3]], seen_from: Option<Vec3>) -> Refined {
        let numbers = &mut Numbers(5);
        let target: Vec<_> = side(600, numbers, half).collect();
        let target: Vec<_> = target
            .into_iter()
            .chain(side(600, numbers, -half))
            .collect();
        let source: Vec<_> = side(500, numbers, half).collect();
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("two clouds");
        if let Some(eye) = seen_from {
            refiner.seen_from(eye);
        }
        refiner.faces(outward);
        let start = Pose {
            translation: Vec3::new(0.0, 0.0, -1.6 * half),
            ..Pose::IDENTITY
        };
        refiner.polish(start).expect("a pose")
    }

    fn outward(sign: f32) -> Vec<[f32; 3]> {
        (0..1200)
            .map(|i| [0.0, 0.0, if i < 600 { sign } else { -sign }])
            .collect()
    }

    #[test]
    fn the_side_that_faces_the_sensor_is_the_one_that_was_seen() {
        let height = |found: Refined| found.target_from_source.translation.z;
        let right = height(refined(&outward(1.0), ABOVE));
        assert!(right.abs() < 0.1 * HALF, "{right}");
        let lower = -2.0 * HALF;
        for wrong in [
            refined(&[], ABOVE),
            refined(&outward(-1.0), ABOVE),
            refined(&outward(1.0), None),
            // As if from inside a room.
            refined(&outward(1.0), Some(Vec3::new(0.0, 0.0, 0.5))),
        ] {
            assert!((height(wrong) - lower).abs() < 0.1 * HALF, "{wrong:?}");
        }
    }

    /// Half of the points nearest to a thin wall's are of its far side; the seen points still get partners on the near side.
    #[test]
    fn of_a_wall_thinner_than_its_points_are_apart_none_is_missed() {
        for half in [0.001, 0.01] {
            let found = plate(half, &outward(1.0), ABOVE);
            assert!(found.near > 0.95 && found.within > 0.99, "{found:?}");
            assert!(found.target_from_source.translation.z.abs() < 0.004);
        }
    }

    /// The lower side, nearer to the start, is said to lie inside.
    #[test]
    fn what_nothing_outside_can_see_was_not_seen() {
        let inside: Vec<_> = (0..1200)
            .map(|i| if i < 600 { [f32::NAN; 3] } else { INSIDE })
            .collect();
        let height = |found: Refined| found.target_from_source.translation.z;
        let right = height(refined(&inside, ABOVE));
        assert!(right.abs() < 0.1 * HALF, "{right}");
        // From within a room, everything may be seen.
        for unknown in [None, Some(Vec3::new(0.0, 0.0, 0.5))] {
            let lower = height(refined(&inside, unknown));
            assert!((lower + 2.0 * HALF).abs() < 0.1 * HALF, "{lower}");
        }
    }

    #[test]
    fn what_is_no_direction_tells_nothing() {
        let told = refined(&[], ABOVE);
        for unknown in [[0.0; 3], [f32::NAN; 3]] {
            assert_eq!(refined(&[unknown; 1200], ABOVE), told);
        }
        // Directions for points that do not exist tell nothing either.
        let late = [vec![[0.0; 3]; 1200], outward(1.0)].concat();
        assert_eq!(refined(&late, ABOVE), told);
    }
}
