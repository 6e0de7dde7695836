//! Which way a target's surface faces, if a mesh tells. A sensor sees neither surfaces that face away from it nor those inside a
//! housing. So the far side of a wall is not taken for its near side.

use crate::freespace::DepthGrid;
use crate::kernels::{Bits, Isa, RUN, RUNS, Sides, has};
use crate::model::Model;
use crate::pose::Pose;
use crate::surface::Surface;
use glam::Vec3;

/// A surface faces away if the cosine between its outward normal and the direction to the sensor is below minus this. The
/// margin allows for estimated normals.
const AWAY: f32 = 0.1;

/// In place of the outward direction at a point that nothing outside can see, such as one inside a housing.
pub const INSIDE: [f32; 3] = [f32::INFINITY; 3];

/// For a target's points, by place, whether the estimated normal points outward or inward; both at a point that nothing outside
/// can see. And which of them a sensor cannot have seen under a pose.
#[derive(Clone, Debug)]
pub(crate) struct Facing {
    /// Whether it is known for any point.
    is_known: bool,
    outward: Bits,
    inward: Bits,
    /// Whether a sensor outside of the target was known when it was looked at last.
    tells: bool,
    /// Of the points as they were looked at last: those that face away, or that nothing outside can see.
    hidden: Bits,
}

impl Facing {
    /// Nothing is known. All bits are zero.
    pub(crate) const UNKNOWN: Facing = Facing {
        is_known: false,
        outward: [0; RUNS],
        inward: [0; RUNS],
        tells: false,
        hidden: [0; RUNS],
    };

    /// Takes in outward directions at a model's points, in the order of the cloud that the model was made of.
    pub(crate) fn fill(&mut self, model: &Model, outward: &[[f32; 3]]) {
        *self = Facing::UNKNOWN;
        for (point, &outward) in model.inside().zip(outward) {
            let here = model.surface.nearest(point.into(), f32::MIN_POSITIVE);
            // Points left out as outliers lie on no surface.
            let Some((place, _)) = here else { continue };
            let (_, normal) = model.surface.at(place);
            let along = normal.dot(Vec3::from_array(outward));
            let is_inside = outward == INSIDE;
            if is_inside || along > 0.0 {
                set(&mut self.outward, place);
            }
            if is_inside || along < 0.0 {
                set(&mut self.inward, place);
            }
            self.is_known |= is_inside || along.abs() > 0.0;
        }
    }

    /// Looks at the target under a pose from where the sensor is, if there is one. A sensor within the target's radius may stand
    /// inside, as in a room, and see the other sides; nothing is told then.
    pub(crate) fn look(&mut self, isa: Isa, seen: &DepthGrid, pose: Pose, target: &Surface) {
        let eye = seen.eye().filter(|_| self.is_known);
        let eye = eye.map(|eye| pose.apply(eye));
        let outside = eye.filter(|eye| eye.length_squared() > 1.0);
        self.tells = outside.is_some();
        if let Some(eye) = outside {
            let sides = Sides {
                outward: &self.outward,
                inward: &self.inward,
                away: AWAY,
            };
            isa.hidden(target.bare(), sides, eye.to_array(), &mut self.hidden);
        }
    }

    /// The places that the sensor cannot have seen as they were looked at last; `None` if nothing is told.
    pub(crate) fn hidden(&self) -> Option<&Bits> {
        self.tells.then_some(&self.hidden)
    }

    /// Whether the sensor cannot have seen a place.
    pub(crate) fn is_hidden(&self, place: usize) -> bool {
        self.hidden().is_some_and(|hidden| has(hidden, place))
    }
}

fn set(bits: &mut Bits, place: usize) {
    if let Some(byte) = bits.get_mut(place / RUN) {
        *byte |= 1 << (place % RUN);
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
            refiner.set_sensor(eye, &[]);
        }
        refiner.set_outward(outward);
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
