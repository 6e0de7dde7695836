//! Poses that lay two points of the source, with their normals, on two of the target: what is left where the clouds overlap
//! in part and nothing else tells how one lies on the other.
//!
//! Two points with normals have a distance and three angles, whatever the pose (Drost et al. 2010). Normals have no sign, and
//! so two poses lay one pair on another.

use crate::kernels::{Isa, LANES};
use crate::rotation::Rotation;
use crate::solve::Rigid;
use crate::surface::Surface;
use glam::{Mat3, Vec3};

/// Pairs of the source that are held against pairs of the target.
const SOURCE_PAIRS: usize = 256;
/// Pairs of the target that are tried.
const TARGET_PAIRS: usize = 2048;
/// Distances between the points of a pair, target radii.
const APART: core::ops::Range<f32> = 0.4..1.4;
/// Differences up to which pairs are alike: of the distance, and of the cosines.
const ALIKE: [f32; 4] = [0.05, 0.15, 0.15, 0.15];

/// Two points with normals: what no pose changes, and a frame that any does.
#[derive(Clone, Copy)]
struct Pair {
    distance: f32,
    /// Sizes of the cosines between both normals and the line between the points, and between the normals.
    cosines: [f32; 3],
    middle: Vec3,
    along: Vec3,
    normal: Vec3,
}

impl Pair {
    /// Two points, each with its normal, unless they are too near or too far apart, or the first normal tells no turn about
    /// the line.
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

    /// By what pairs are like each other.
    fn features(&self) -> [f32; 4] {
        let [a, b, c] = self.cosines;
        [self.distance, a, b, c]
    }

    /// The poses that lay this pair on another.
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

/// Tells the poses that lay pairs of the source on pairs of the target that are like them.
pub(crate) fn matching_pairs(
    isa: Isa,
    source: &Surface,
    target: &Surface,
    mut tell: impl FnMut(Rigid),
) {
    let mut pairs = [[None; LANES]; SOURCE_PAIRS / LANES];
    // No pair is like what is infinite.
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

/// Pairs of points drawn at random, the same ones every time.
fn drawn(surface: &Surface, seed: u32) -> impl Iterator<Item = Pair> {
    const TRIED: usize = 4 * TARGET_PAIRS;
    let count = surface.points().len() as u64;
    let mut state = seed;
    let mut place = move || {
        // A linear congruential generator (Numerical Recipes), of which the high bits are used.
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
