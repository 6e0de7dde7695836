//! Hypotheses: other poses that might be the right one, and the best of them.

use crate::rotation::Rotation;
use crate::solve::Rigid;
use glam::{Mat3, Vec3};

/// Gates of a hypothesis' first steps, in normalised units: wide, then narrow.
pub(crate) const SCREEN: [f32; 6] = [0.5, 0.4, 0.3, 0.2, 0.15, 0.12];
/// Number of these steps after which a hypothesis far behind is dropped. `EARLY_POINTS` points judge that, and it may exceed
/// the loss of the worst one kept by `EARLY_SLACK`.
pub(crate) const EARLY: usize = 2;
pub(crate) const EARLY_POINTS: usize = 96;
pub(crate) const EARLY_SLACK: f32 = 0.1;
/// Gates of a hypothesis' further steps.
pub(crate) const SIFT: [f32; 6] = [0.2, 0.15, 0.12, 0.1, 0.08, 0.08];
/// Points of the source in the steps of each stage, and points by which its results are compared.
pub(crate) const SCREEN_POINTS: [usize; 2] = [96, 128];
pub(crate) const SIFT_POINTS: [usize; 2] = [256, 512];
/// Scale of the loss by which results are compared, in neighbourhood radii.
pub(crate) const SCREEN_SCALE: f32 = 0.3;
pub(crate) const SIFT_SCALE: f32 = 0.15;
/// Cosine of half of 8 degrees: two rotations closer than that are one hypothesis.
pub(crate) const SAME: f32 = 0.997_564;
/// Distance below which two poses of the same rotation are one hypothesis, in target radii.
const SAME_PLACE: f32 = 0.15;

/// The same for one result of refinement: 1 degree, and a distance in target radii.
const EQUAL: f32 = 0.999_962;
const EQUAL_PLACE: f32 = 0.01;

/// Whether two poses are one hypothesis.
pub(crate) fn is_same(a: Rigid, b: Rigid) -> bool {
    a.rotation.likeness(b.rotation) > SAME
        && (a.centre() - b.centre()).length_squared() < SAME_PLACE * SAME_PLACE
}

/// Whether two poses are one result of refinement.
pub(crate) fn is_equal(a: Rigid, b: Rigid) -> bool {
    a.rotation.likeness(b.rotation) > EQUAL
        && (a.centre() - b.centre()).length_squared() < EQUAL_PLACE * EQUAL_PLACE
}

/// The best hypotheses so far, the best first.
#[derive(Clone)]
pub(crate) struct Best<const N: usize>([Option<(f32, Rigid)>; N]);

impl<const N: usize> Best<N> {
    pub(crate) const NONE: Best<N> = Best([None; N]);

    /// Takes a hypothesis, unless it is worse than all those held, or than one that is the same.
    pub(crate) fn offer(&mut self, score: f32, at: Rigid) {
        let is_behind_all =
            |worst: &Option<(f32, Rigid)>| worst.is_some_and(|(worst, _)| score >= worst);
        if self.0.last().is_some_and(is_behind_all) {
            return;
        }
        let same = |held: &Option<(f32, Rigid)>| held.is_some_and(|(_, other)| is_same(at, other));
        let mut carried = Some((score, at));
        if let Some(twin) = self.0.iter_mut().find(|held| same(held)) {
            if twin.is_some_and(|(held, _)| held <= score) {
                return;
            }
            *twin = None;
        }
        for held in &mut self.0 {
            let before = match (&carried, &*held) {
                (Some((a, _)), Some((b, _))) => a < b,
                (Some(_), None) => true,
                (None, _) => return,
            };
            if before {
                core::mem::swap(held, &mut carried);
            }
        }
    }

    /// Score from which on a hypothesis is refused.
    pub(crate) fn most(&self) -> f32 {
        let worst = self.0.last().copied().flatten();
        worst.map_or(f32::INFINITY, |(worst, _)| worst)
    }

    /// Score of the best hypothesis.
    pub(crate) fn least(&self) -> Option<f32> {
        self.0.first().copied().flatten().map(|(score, _)| score)
    }

    /// The hypotheses held, with their scores.
    pub(crate) fn held(&self) -> impl Iterator<Item = (f32, Rigid)> {
        self.0.iter().flatten().copied()
    }
}

/// A pose and its neighbours: shifted along the axes, and turned by 34 and 63 degrees about the target's centre, about the axes
/// of an icosahedron.
pub(crate) fn around(seed: Rigid) -> impl Iterator<Item = Rigid> {
    const STEP: f32 = 0.2;
    const ANGLES: [f32; 2] = [0.6, 1.1];
    let turned = ANGLES
        .into_iter()
        .flat_map(move |angle| turned(seed, angle));
    core::iter::once(seed)
        .chain(moved(seed, STEP))
        .chain(turned)
}

/// Close neighbours of a pose: turned by 14 degrees about the target's centre, or shifted, in all directions.
pub(crate) fn nudged(seed: Rigid) -> impl Iterator<Item = Rigid> {
    const ANGLE: f32 = 0.25;
    const STEP: f32 = 0.15;
    turned(seed, ANGLE).chain(moved(seed, STEP))
}

/// A pose turned about the target's centre, in both senses about the axes of an icosahedron.
fn turned(seed: Rigid, angle: f32) -> impl Iterator<Item = Rigid> {
    let (sine, cosine) = libm::sincosf(0.5 * angle);
    icosahedron().map(move |axis| seed.turned(Rotation::new(axis * sine, cosine)))
}

/// A pose shifted along the axes, in both senses.
fn moved(seed: Rigid, step: f32) -> impl Iterator<Item = Rigid> {
    AXES.into_iter().map(move |axis| Rigid {
        shift: seed.shift + axis * step,
        ..seed
    })
}

/// Poses that a symmetry of the target would confuse with this one: turned about axes through the target's centre, and about
/// parallel axes through the source's.
pub(crate) fn symmetry_candidates(seed: Rigid, axes: Mat3) -> impl Iterator<Item = Rigid> {
    turns(axes).flat_map(move |by| {
        let rotation = by.after(seed.rotation);
        [seed.turned(by), Rigid { rotation, ..seed }]
    })
}

/// A pose under the 24 rotations of a cube about the target's centre, in the frame of `axes` and in that of x, y, z.
pub(crate) fn cube_rotations(seed: Rigid, axes: Mat3) -> impl Iterator<Item = Rigid> {
    [axes, Mat3::IDENTITY].into_iter().flat_map(move |frame| {
        alignments()
            .map(move |signed| seed.turned(Rotation::of(&(frame * signed * frame.transpose()))))
    })
}

/// Poses with the source's principal axes on the target's, in each of the 24 ways.
pub(crate) fn aligned(source: Mat3, target: Mat3, shift: Vec3) -> impl Iterator<Item = Rigid> {
    alignments().map(move |signed| Rigid {
        rotation: Rotation::of(&(target * signed * source.transpose())),
        shift,
    })
}

/// Poses of the source's mirror image (x negated) that mirror a pose in planes through the target's or the source's centre.
pub(crate) fn mirrored(seed: Rigid, axes: Mat3) -> impl Iterator<Item = Rigid> {
    // A reflection is a half turn and an inversion, and two reflections are a rotation.
    let half_turn = |normal| Rotation::new(normal, 0.0);
    let normals = [axes.x_axis, axes.y_axis, axes.z_axis];
    normals.into_iter().flat_map(move |normal| {
        let rotation = half_turn(normal)
            .after(seed.rotation)
            .after(half_turn(Vec3::X));
        let reflected = seed.shift - normal * (2.0 * normal.dot(seed.shift));
        [reflected, seed.shift].map(|shift| Rigid { rotation, shift })
    })
}

/// Poses whose rotations leave none farther than about 35 degrees away: with both clouds' centres together, and with the start
/// turned about the target's centre.
pub(crate) fn anywhere(from: Rigid) -> impl Iterator<Item = Rigid> {
    let between = Rotation::new(Vec3::new(0.2, 0.25, 0.15), 1.0);
    icosahedral().flat_map(move |by| {
        [by, between.after(by)].into_iter().flat_map(move |by| {
            let turned = from.turned(by);
            let centred = Rigid {
                shift: Vec3::ZERO,
                ..turned
            };
            [centred, turned]
        })
    })
}

const AXES: [Vec3; 6] = [
    Vec3::X,
    Vec3::Y,
    Vec3::Z,
    Vec3::NEG_X,
    Vec3::NEG_Y,
    Vec3::NEG_Z,
];

/// Half of the golden ratio, and of its inverse.
const LONG: f32 = 0.809_017;
const SHORT: f32 = 0.309_017;

/// The 12 corners of an icosahedron, as directions.
fn icosahedron() -> impl Iterator<Item = Vec3> {
    let signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
    signs.into_iter().flat_map(|(a, b)| {
        let (u, v) = (0.525_731 * a, 0.850_651 * b);
        [
            Vec3::new(0.0, u, v),
            Vec3::new(u, v, 0.0),
            Vec3::new(v, 0.0, u),
        ]
    })
}

/// The 60 rotations that map an icosahedron onto itself.
fn icosahedral() -> impl Iterator<Item = Rotation> {
    // Quaternions up to sign: 4 units, 8 halves, and 48 even permutations of (LONG, 1/2, SHORT, 0).
    let axes = [
        ([0.0, 0.0, 0.0], 1.0),
        ([1.0, 0.0, 0.0], 0.0),
        ([0.0, 1.0, 0.0], 0.0),
        ([0.0, 0.0, 1.0], 0.0),
    ];
    let signs =
        || (0..8u8).map(|bits| [0, 1, 2].map(|k| if bits >> k & 1 == 1 { -1.0 } else { 1.0 }));
    let halves = signs().map(|[x, y, z]| ([0.5 * x, 0.5 * y, 0.5 * z], 0.5));
    let golden = signs()
        .filter(|s: &[f32; 3]| s[2] > 0.0)
        .flat_map(|[a, b, _]| (0..4).flat_map(move |zero| places(zero, a, b)));
    axes.into_iter()
        .chain(halves)
        .chain(golden)
        .map(|(vector, scalar)| Rotation::new(Vec3::from_array(vector), scalar))
}

/// Even permutations of (w, x, y, z) = (LONG, 1/2, SHORT, 0) with the zero at place `zero`; the other signs are `+`, `a`, `b`.
fn places(zero: usize, a: f32, b: f32) -> impl Iterator<Item = ([f32; 3], f32)> {
    let (l, h, s) = (LONG, 0.5, SHORT);
    // Rows of w, x, y, z.
    let rows = match zero {
        3 => [
            [l, h * a, s * b, 0.0],
            [h, s * a, l * b, 0.0],
            [s, l * a, h * b, 0.0],
        ],
        2 => [
            [l, s * a, 0.0, h * b],
            [h, l * a, 0.0, s * b],
            [s, h * a, 0.0, l * b],
        ],
        1 => [
            [l, 0.0, h * a, s * b],
            [h, 0.0, s * a, l * b],
            [s, 0.0, l * a, h * b],
        ],
        _ => [
            [0.0, l, s * a, h * b],
            [0.0, h, l * a, s * b],
            [0.0, s, h * a, l * b],
        ],
    };
    rows.into_iter().map(|[w, x, y, z]| ([x, y, z], w))
}

/// Rotations by 45, 90 and 180 degrees about the given axes and about x, y, z.
fn turns(axes: Mat3) -> impl Iterator<Item = Rotation> {
    // Sine and cosine of half of each angle.
    const HALVES: [(f32, f32); 5] = [
        (1.0, 0.0),
        (
            core::f32::consts::FRAC_1_SQRT_2,
            core::f32::consts::FRAC_1_SQRT_2,
        ),
        (
            -core::f32::consts::FRAC_1_SQRT_2,
            core::f32::consts::FRAC_1_SQRT_2,
        ),
        (0.382_683_43, 0.923_879_5),
        (-0.382_683_43, 0.923_879_5),
    ];
    let about = [
        axes.x_axis,
        axes.y_axis,
        axes.z_axis,
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
    ];
    HALVES
        .into_iter()
        .flat_map(move |(sine, cosine)| about.map(|axis| Rotation::new(axis * sine, cosine)))
}

/// The 24 rotations that map axes to axes (of a cube).
fn alignments() -> impl Iterator<Item = Mat3> {
    AXES.into_iter().flat_map(move |first| {
        AXES.into_iter()
            .filter(move |second| first.dot(*second) == 0.0)
            .map(move |second| Mat3::from_cols(first, second, first.cross(second)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn about_x(x: f32) -> Rigid {
        Rigid {
            rotation: Rotation::new(Vec3::X * (0.5 * x).sin(), (0.5 * x).cos()),
            shift: Vec3::ZERO,
        }
    }

    #[test]
    fn there_are_24_alignments_30_turns_and_60_rotations_of_an_icosahedron() {
        let alignments: Vec<Mat3> = alignments().collect();
        assert_eq!(alignments.len(), 24);
        assert!(alignments.iter().all(|m| m.determinant() == 1.0));
        assert_eq!(turns(Mat3::IDENTITY).count(), 30);
        let corners: Vec<Vec3> = icosahedron().collect();
        assert_eq!(corners.len(), 12);
        let rotations: Vec<Rotation> = icosahedral().collect();
        assert_eq!(rotations.len(), 60);
        for (i, a) in rotations.iter().enumerate() {
            // They form a group: all differ, by 72 degrees at least.
            for b in &rotations[..i] {
                assert!(a.likeness(*b) < 0.81, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn rotations_anywhere_leave_none_far_away() {
        let all: Vec<Rigid> = anywhere(about_x(0.0)).collect();
        let mut numbers = crate::polish::tests::Numbers(3);
        for _ in 0..500 {
            let q = [(); 4].map(|()| numbers.next());
            let any = Rotation::new(Vec3::new(q[0], q[1], q[2]), q[3]);
            let near = all
                .iter()
                .map(|at| at.rotation.likeness(any))
                .fold(0.0, f32::max);
            let degrees = 2.0 * near.min(1.0).acos().to_degrees();
            assert!(degrees < 45.0, "{degrees}");
        }
    }

    #[test]
    fn the_best_are_kept_in_order_and_one_of_a_kind() {
        let mut best = Best::<2>::NONE;
        for (score, angle) in [
            (0.5, 0.0),
            (0.4, 1.0),
            (0.3, 0.05),
            (0.6, 2.0),
            (0.45, 1.02),
        ] {
            best.offer(score, about_x(angle));
        }
        let scores: Vec<f32> = best.held().map(|held| held.0).collect();
        assert_eq!(scores, [0.3, 0.4]);
    }
}
