//! Normal equations of matched points, with pairs in lanes: how a small motion changes the distances between two surfaces.
//!
//! As in [`super::lanes`], each lane sums its own pairs in order, so every kernel gives the same bits.

#![allow(unsafe_code)]

use super::Isa;
use super::lanes::{LANES, Lanes, Row, Seen, Vectors};
use super::on_lanes::on_lanes;
use super::oriented::OrientedPoints;
use crate::pose::Pose;

/// Places of a matched pair: in the first surface, and in the second.
pub type Pair = [u16; 2];

/// The weight of a pair in the equations.
#[derive(Clone, Copy, Debug)]
pub struct Weighing {
    /// Squared distance from which on a pair has no weight (Tukey's biweight).
    pub gate: f32,
    /// Weight of the distance between the points, relative to that between the planes.
    pub tangential: f32,
}

/// Normal equations of a small rigid motion `x -> x + ω × x + v` of the first surface, summed lane by lane: the lower triangle
/// of the matrix by rows (unknowns ω, then v), then the right-hand side.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Sums(pub [Row; 27]);

impl Sums {
    /// Sums over no pairs.
    pub const ZERO: Sums = Sums([[0.0; LANES]; 27]);
}

/// Adds a pair's terms of the symmetric point-to-plane distance (Rusinkiewicz 2019), along the sum of both normals, and of the
/// point-to-point distance, for the lanes from `lane` on, below `count`.
#[inline(always)]
pub(super) fn add<L: Lanes>(
    lane: usize,
    [p, m]: [Vectors<L>; 2],
    [q, n]: [Vectors<L>; 2],
    by: Weighing,
    count: usize,
    sums: &mut Sums,
) {
    let all = L::all;
    let apart = p - q;
    let share = (all(1.0) - apart.dot(apart) * all(1.0 / by.gate)).max(all(0.0));
    let weight = share * share * L::load(is_pair(count), lane);
    // Normals have no sign: the first is flipped to the side of the second.
    let same = m.dot(n);
    let (d, e, f) = (
        n.x + m.x.with_sign_flipped_by(same),
        n.y + m.y.with_sign_flipped_by(same),
        n.z + m.z.with_sign_flipped_by(same),
    );
    let along = weight / (d * d + e * e + f * f).max(all(1e-6));
    let half = all(0.5);
    let (x, y, z) = (half * (p.x + q.x), half * (p.y + q.y), half * (p.z + q.z));
    let (ax, ay, az) = (apart.x, apart.y, apart.z);
    let (a, b, c) = (y * f - z * e, z * d - x * f, x * e - y * d);
    let residual = d * ax + e * ay + f * az;
    let (wa, wb, wc) = (along * a, along * b, along * c);
    let (wd, we, wf) = (along * d, along * e, along * f);
    let t = weight * all(by.tangential);
    let (tx, ty, tz) = (t * x, t * y, t * z);
    let add = |sum: &mut Row, term: L| (L::load(sum, lane) + term).store(sum, lane);
    let s = &mut sums.0;
    add(&mut s[0], wa * a + (ty * y + tz * z));
    add(&mut s[1], wb * a - tx * y);
    add(&mut s[2], wb * b + (tx * x + tz * z));
    add(&mut s[3], wc * a - tx * z);
    add(&mut s[4], wc * b - ty * z);
    add(&mut s[5], wc * c + (tx * x + ty * y));
    add(&mut s[6], wd * a);
    add(&mut s[7], wd * b + tz);
    add(&mut s[8], wd * c - ty);
    add(&mut s[9], wd * d + t);
    add(&mut s[10], we * a - tz);
    add(&mut s[11], we * b);
    add(&mut s[12], we * c + tx);
    add(&mut s[13], we * d);
    add(&mut s[14], we * e + t);
    add(&mut s[15], wf * a + ty);
    add(&mut s[16], wf * b - tx);
    add(&mut s[17], wf * c);
    add(&mut s[18], wf * d);
    add(&mut s[19], wf * e);
    add(&mut s[20], wf * f + t);
    let zero = all(0.0);
    add(&mut s[21], zero - (wa * residual + (ty * az - tz * ay)));
    add(&mut s[22], zero - (wb * residual + (tz * ax - tx * az)));
    add(&mut s[23], zero - (wc * residual + (tx * ay - ty * ax)));
    add(&mut s[24], zero - (wd * residual + t * ax));
    add(&mut s[25], zero - (we * residual + t * ay));
    add(&mut s[26], zero - (wf * residual + t * az));
}

/// See [`Isa::equations`].
#[inline(always)]
fn equations<L: Lanes>(
    pairs: &[Pair],
    [first, second]: [OrientedPoints<'_>; 2],
    pose: &Pose,
    by: Weighing,
    sums: &mut Sums,
) {
    let seen = Seen::<L>::under(pose);
    for pairs in pairs.chunks(LANES) {
        let [mut of_first, mut of_second] = [[0; LANES]; 2];
        for ((one, other), pair) in of_first.iter_mut().zip(&mut of_second).zip(pairs) {
            [*one, *other] = *pair;
        }
        for lane in (0..LANES).step_by(L::COUNT) {
            let [p, m] = first.gather(&of_first, lane);
            let first = [seen.point(p), seen.direction(m)];
            add(
                lane,
                first,
                second.gather(&of_second, lane),
                by,
                pairs.len(),
                sums,
            );
        }
    }
}

/// A row with 1 in the first `count` lanes, else 0.
#[inline(always)]
fn is_pair(count: usize) -> &'static Row {
    const ROWS: [Row; LANES + 1] = {
        let mut rows = [[0.0; LANES]; LANES + 1];
        let mut i = 0;
        while i < LANES * LANES {
            if i % LANES <= i / LANES {
                rows[i / LANES + 1][i % LANES] = 1.0;
            }
            i += 1;
        }
        rows
    };
    static OF_COUNT: [Row; LANES + 1] = ROWS;
    &OF_COUNT[count.min(LANES)]
}

impl Isa {
    /// Adds the equations of pairs of points of two surfaces, the first under a pose. The bits are the same on every kernel,
    /// whether all pairs come at once or in whole [`LANES`].
    pub fn equations(
        self,
        pairs: &[Pair],
        surfaces: [OrientedPoints<'_>; 2],
        pose: &Pose,
        by: Weighing,
        sums: &mut Sums,
    ) {
        on_lanes!(
            self,
            equations(pairs: &[Pair], surfaces: [OrientedPoints<'_>; 2], pose: &Pose, by: Weighing, sums: &mut Sums)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::oriented::tests::Cloud;
    use glam::Vec3;

    const PAIRS: [Pair; 37] = {
        let mut pairs = [[0; 2]; 37];
        let mut i = 0;
        while i < 37 {
            pairs[i] = [(i * 53 % 97) as u16, (i * 29 % 89) as u16];
            i += 1;
        }
        pairs
    };

    #[test]
    fn every_kernel_gives_the_same_bits() {
        let pose = crate::polish::tests::pose([0.3, -0.2, 0.9], [0.1, 0.2, -0.3]);
        let by = Weighing {
            gate: 2.0,
            tangential: 0.2,
        };
        let (first, second) = (Cloud::drawn(1), Cloud::drawn(2));
        let surfaces = [first.bare(), second.bare()];
        let bits = |isa: Isa, at_once: usize| -> Vec<u32> {
            let mut sums = Sums::ZERO;
            for pairs in PAIRS.chunks(at_once) {
                isa.equations(pairs, surfaces, &pose, by, &mut sums);
            }
            sums.0.as_flattened().iter().map(|x| x.to_bits()).collect()
        };
        let expected = bits(Isa::PORTABLE, PAIRS.len());
        for isa in Isa::all() {
            for at_once in [PAIRS.len(), LANES] {
                assert_eq!(bits(isa, at_once), expected, "{}", isa.name());
            }
        }
    }

    /// The sums are the gradient and the Gauss-Newton matrix of the module's weighted squares.
    #[test]
    fn sums_are_those_of_the_definition() {
        let (first, second) = (Cloud::drawn(5), Cloud::drawn(6));
        let by = Weighing {
            gate: 3.0,
            tangential: 0.2,
        };
        let mut sums = Sums::ZERO;
        let surfaces = [first.bare(), second.bare()];
        Isa::PORTABLE.equations(&PAIRS[..19], surfaces, &Pose::IDENTITY, by, &mut sums);
        let mut expected = [0.0f64; 27];
        for [i, j] in &PAIRS[..19] {
            let ((p, m), (q, n)) = (first.at(*i), second.at(*j));
            let (apart, middle) = (p - q, (p + q) * 0.5);
            let weight = (1.0 - apart.length_squared() / by.gate).max(0.0).powi(2);
            let sum = if m.dot(n) < 0.0 { n - m } else { n + m };
            let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (axis, weight * by.tangential));
            for (direction, weight) in [(sum.normalize(), weight)].into_iter().chain(axes) {
                let turning = middle.cross(direction).to_array();
                let row = [turning, direction.to_array()].concat();
                let residual = direction.dot(apart);
                let mut k = 0;
                for i in 0..6 {
                    for j in 0..=i {
                        expected[k] += f64::from(weight * row[i] * row[j]);
                        k += 1;
                    }
                    expected[21 + i] -= f64::from(weight * row[i] * residual);
                }
            }
        }
        for (row, expected) in sums.0.iter().zip(expected) {
            let sum: f64 = row.iter().copied().map(f64::from).sum();
            assert!((sum - expected).abs() < 1e-4, "{sum} {expected}");
        }
    }
}
