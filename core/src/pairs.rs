//! Poses that lay two oriented points of the source on two of the target. They find the pose where clouds overlap only in part
//! and nothing else tells it.
//!
//! Two points with normals have a distance and three angles that no pose changes (Drost et al. 2010). Normals have no sign
//! here, so two poses lay one pair on another.

use crate::kernels::{Isa, LANES};
use crate::rotation::Rotation;
use crate::solve::Rigid;
use crate::surface::Surface;
use glam::{Mat3, Vec3};

/// Pairs of the source, each compared with every pair of the target.
const SOURCE_PAIRS: usize = 256;
/// Pairs of the target.
const TARGET_PAIRS: usize = 2048;
/// Distance between the points of a pair, in target radii.
const APART: core::ops::Range<f32> = 0.4..1.4;
/// Tolerances within which pairs are alike: of the distance, and of the three cosines.
const ALIKE: [f32; 4] = [0.05, 0.15, 0.15, 0.15];

/// Two points with normals: invariants, and a frame that moves with them.
#[derive(Clone, Copy)]
struct Pair {
    distance: f32,
    /// Magnitudes of the cosines: of each normal with the line between the points, and between the normals.
    cosines: [f32; 3],
    middle: Vec3,
    along: Vec3,
    normal: Vec3,
}

impl Pair {
    /// A pair of two points with normals. `None` if they are too near or too far apart, or if the first normal is too close to
    /// their line to fix a turn about it.
    fn of((p, m): (Vec3, Vec3), (q, n): (Vec3, Vec3)) -> Option<Pair> {
        let distance = (q - p).length_squared();
        if !(APART.start * APART.start..APART.end * APART.end).contains(&distance) {
            return None;
        }
        let distance = libm::sqrtf(distance);
        let along = (q - p) * (1.0 / distance);
        let across = m - along * along.dot(m);
        let length = across.length_squared();
        if length < 0.1 {
            return None;
        }
        Some(Pair {
            distance,
            cosines: [m.dot(along), n.dot(along), m.dot(n)].map(f32::abs),
            middle: (p + q) * 0.5,
            along,
            normal: across * (1.0 / libm::sqrtf(length)),
        })
    }

    /// The invariants by which pairs are compared.
    fn features(&self) -> [f32; 4] {
        let [a, b, c] = self.cosines;
        [self.distance, a, b, c]
    }

    /// The two poses that lay this pair on another.
    fn onto(&self, other: &Pair) -> [Rigid; 2] {
        let frame = |pair: &Pair, sign: f32| {
            let normal = pair.normal * sign;
            Mat3::from_cols(pair.along, normal, pair.along.cross(normal))
        };
        let from = frame(self, 1.0).transpose();
        [1.0, -1.0].map(|sign| {
            let rotation = frame(other, sign) * from;
            Rigid {
                rotation: Rotation::of(&rotation),
                shift: other.middle - rotation * self.middle,
            }
        })
    }
}

/// Passes to `tell` each pose that lays a pair of the source on a similar pair of the target.
pub(crate) fn matching_pairs(
    isa: Isa,
    source: &Surface,
    target: &Surface,
    mut tell: impl FnMut(Rigid),
) {
    let mut pairs = [[None; LANES]; SOURCE_PAIRS / LANES];
    // Infinite features match no pair.
    let mut rows = [[[f32::INFINITY; LANES]; 4]; SOURCE_PAIRS / LANES];
    let mut drawn_of_source = drawn(source, 1);
    for (pairs, rows) in pairs.iter_mut().zip(&mut rows) {
        let [a, b, c, d] = rows;
        let lanes = a.iter_mut().zip(b).zip(c).zip(d);
        for (place, (((a, b), c), d)) in pairs.iter_mut().zip(lanes) {
            *place = drawn_of_source.next();
            if let Some(pair) = place {
                [*a, *b, *c, *d] = pair.features();
            }
        }
    }
    let mut alike = [0u32; SOURCE_PAIRS / LANES];
    for onto in drawn(target, 2).take(TARGET_PAIRS) {
        isa.alike(&rows, &onto.features(), &ALIKE, &mut alike);
        for (&alike, pairs) in alike.iter().zip(&pairs) {
            let lanes = pairs.iter().enumerate();
            let pairs = lanes.filter(|(lane, _)| alike >> lane & 1 == 1);
            let poses = pairs.flat_map(|(_, pair)| pair.iter().flat_map(|pair| pair.onto(&onto)));
            poses.for_each(&mut tell);
        }
    }
}

/// Pairs of points drawn at random, the same on every call.
fn drawn(surface: &Surface, seed: u32) -> impl Iterator<Item = Pair> {
    const TRIED: usize = 4 * TARGET_PAIRS;
    let count = surface.points().len() as u64;
    let mut state = seed;
    let mut place = move || {
        // A linear congruential generator (Numerical Recipes); the high bits are used.
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((u64::from(state) * count) >> 32) as usize
    };
    (0..TRIED).filter_map(move |_| Pair::of(surface.at(place()), surface.at(place())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outliers::Bulk;
    use crate::polish::tests::{Numbers, error, pose};
    use crate::surface::keys::Keys;

    fn surface(points: &[[f32; 3]]) -> Box<Surface> {
        let mut surface = Box::new(Surface::EMPTY);
        let mut keys = Keys::ZERO;
        surface.fill(Isa::PORTABLE, points, Bulk::ALL, Vec3::ZERO, 1.0, &mut keys);
        surface
    }

    #[test]
    fn a_pair_is_laid_on_the_same_pair_elsewhere_whatever_the_normals_signs() {
        let truth = pose([2.0, -0.7, 1.1], [0.2, -0.1, 0.3]);
        let mut numbers = Numbers(1);
        let mut laid = 0;
        for k in 0..200 {
            let mut point = || Vec3::new(numbers.next(), numbers.next(), numbers.next());
            let (p, m, q, n) = (point(), point().normalize(), point(), point().normalize());
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let there = |p, m: Vec3| (truth.apply(p), truth.rotation * m * sign);
            let Some(here) = Pair::of((p, m), (q, n)) else {
                assert!(Pair::of(there(p, m), there(q, n)).is_none());
                continue;
            };
            let there = Pair::of(there(p, m), there(q, n)).expect("the same pair");
            let features = here.features().into_iter().zip(there.features());
            assert!(
                features
                    .zip(ALIKE)
                    .all(|((a, b), most)| (a - b).abs() < most)
            );
            let poses = here.onto(&there).map(|at| error(at.pose(), truth));
            assert!(
                poses
                    .iter()
                    .any(|(angle, distance)| *angle < 0.1 && *distance < 1e-3),
                "{poses:?}"
            );
            laid += 1;
        }
        assert!(laid > 50, "{laid}");
    }

    #[test]
    fn surfaces_without_pairs_have_no_poses() {
        let one = surface(&[[0.0; 3]; 4]);
        for source in [&one, &Surface::EMPTY] {
            matching_pairs(Isa::best(), source, &one, |at| panic!("{at:?}"));
        }
    }
}
