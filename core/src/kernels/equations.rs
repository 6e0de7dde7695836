//! Normal equations of matched points, pairs in lanes: what a small motion does to the distances between two surfaces.
//!
//! As in [`super::neighbours`]: no fused multiply-add, each lane sums its own pairs in order, so that every kernel gives the
//! same bits.

#![allow(unsafe_code)]

use super::Isa;
#[cfg(target_arch = "x86_64")]
use super::Kind;
use crate::pose::Pose;
use core::ops::{Add, Div, Mul, Sub};

/// Pairs in [`Pairs`].
pub const PAIRS: usize = 16;

type Row = [f32; PAIRS];

/// Points of one surface beside points of another, one row an axis.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Pairs {
    /// Points of the first.
    pub p: [Row; 3],
    /// Their normals.
    pub m: [Row; 3],
    /// Points of the second.
    pub q: [Row; 3],
    /// Their normals.
    pub n: [Row; 3],
}

impl Pairs {
    /// All in the origin.
    pub const ZERO: Pairs = Pairs {
        p: [[0.0; PAIRS]; 3],
        m: [[0.0; PAIRS]; 3],
        q: [[0.0; PAIRS]; 3],
        n: [[0.0; PAIRS]; 3],
    };
}

/// How much a pair counts in [`Isa::equations`].
#[derive(Clone, Copy, Debug)]
pub struct Weighing {
    /// Squared distance from which a pair counts nothing (Tukey's biweight).
    pub gate: f32,
    /// Weight of the distance between points beside that between planes.
    pub tangential: f32,
}

/// Normal equations of a small rigid motion `x -> x + ω × x + v` of the first surface, lane by lane: the lower triangle of the
/// matrix by rows (unknowns ω, then v), then the right side.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Sums(pub [Row; 27]);

impl Sums {
    /// Of no pairs.
    pub const ZERO: Sums = Sums([[0.0; PAIRS]; 27]);
}

/// Numbers side by side, one a pair.
#[derive(Clone, Copy)]
struct Lanes<const N: usize>([f32; N]);

impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn all(x: f32) -> Self {
        Lanes([x; N])
    }

    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (x, y) in out.iter_mut().zip(other.0) {
            *x = f(*x, y);
        }
        Lanes(out)
    }

    #[inline(always)]
    fn at_least(self, least: f32) -> Self {
        self.map2(self, |x, _| if x > least { x } else { least })
    }

    /// Where `self` is negative, `other` with the opposite sign.
    #[inline(always)]
    fn turns(self, other: Self) -> Self {
        self.map2(other, |s, x| if s < 0.0 { -x } else { x })
    }
}

impl<const N: usize> Add for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map2(other, |x, y| x + y)
    }
}

impl<const N: usize> Sub for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map2(other, |x, y| x - y)
    }
}

impl<const N: usize> Mul for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map2(other, |x, y| x * y)
    }
}

impl<const N: usize> Div for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.map2(other, |x, y| x / y)
    }
}

/// Sees the first surface of the pairs under a pose.
#[inline(always)]
fn see<const N: usize>(pairs: &mut Pairs, pose: &Pose) {
    let columns = pose.rotation.to_cols_array_2d();
    let [a, b, c] = columns.map(|column| column.map(Lanes::<N>::all));
    let shift = pose.translation.to_array();
    for (rows, shift) in [(&mut pairs.p, shift), (&mut pairs.m, [0.0; 3])] {
        for lane in (0..PAIRS).step_by(N) {
            let [x, y, z] = rows.each_ref().map(|row| load::<N>(row, lane));
            for (axis, row) in rows.iter_mut().enumerate() {
                let seen = (a[axis] * x + b[axis] * y + c[axis] * z) + Lanes::all(shift[axis]);
                row[lane..lane + N].copy_from_slice(&seen.0);
            }
        }
    }
}

#[inline(always)]
fn load<const N: usize>(row: &Row, lane: usize) -> Lanes<N> {
    let mut out = [0.0; N];
    out.copy_from_slice(&row[lane..lane + N]);
    Lanes(out)
}

/// Adds the first `count` pairs' rows of the symmetric point-to-plane distance (Rusinkiewicz 2019), along the sum of both
/// normals, and of the distance between the points.
#[inline(always)]
fn equations<const N: usize>(pairs: &Pairs, by: Weighing, count: usize, sums: &mut Sums) {
    let all = Lanes::<N>::all;
    let per_gate = all(1.0 / by.gate);
    for lane in (0..PAIRS).step_by(N) {
        let rows = |of: &[Row; 3]| of.each_ref().map(|row| load::<N>(row, lane));
        let ([px, py, pz], [mx, my, mz]) = (rows(&pairs.p), rows(&pairs.m));
        let ([qx, qy, qz], [nx, ny, nz]) = (rows(&pairs.q), rows(&pairs.n));
        let mut is_pair = [0.0; N];
        for (i, is_pair) in is_pair.iter_mut().enumerate() {
            *is_pair = if lane + i < count { 1.0 } else { 0.0 };
        }
        let (ax, ay, az) = (px - qx, py - qy, pz - qz);
        let share = (all(1.0) - (ax * ax + ay * ay + az * az) * per_gate).at_least(0.0);
        let weight = share * share * Lanes(is_pair);
        // Normals have no sign of their own: the first is turned to the side of the second.
        let same = mx * nx + my * ny + mz * nz;
        let (d, e, f) = (
            nx + same.turns(mx),
            ny + same.turns(my),
            nz + same.turns(mz),
        );
        let along = weight / (d * d + e * e + f * f).at_least(1e-6);
        let half = all(0.5);
        let (x, y, z) = (half * (px + qx), half * (py + qy), half * (pz + qz));
        let (a, b, c) = (y * f - z * e, z * d - x * f, x * e - y * d);
        let residual = d * ax + e * ay + f * az;
        let (wa, wb, wc) = (along * a, along * b, along * c);
        let (wd, we, wf) = (along * d, along * e, along * f);
        let t = weight * all(by.tangential);
        let (tx, ty, tz) = (t * x, t * y, t * z);
        let add = |sum: &mut Row, term: Lanes<N>| {
            for (sum, term) in sum[lane..lane + N].iter_mut().zip(term.0) {
                *sum += term;
            }
        };
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
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn see_avx2(pairs: &mut Pairs, pose: &Pose) {
    see::<8>(pairs, pose);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn see_avx512(pairs: &mut Pairs, pose: &Pose) {
    see::<16>(pairs, pose);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn equations_avx2(pairs: &Pairs, by: Weighing, count: usize, sums: &mut Sums) {
    equations::<8>(pairs, by, count, sums);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn equations_avx512(pairs: &Pairs, by: Weighing, count: usize, sums: &mut Sums) {
    equations::<16>(pairs, by, count, sums);
}

impl Isa {
    /// Points and normals of the first surface of the pairs, seen under a pose. The same bits on every kernel.
    pub fn see(self, pairs: &mut Pairs, pose: &Pose) {
        match self.0 {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe { see_avx2(pairs, pose) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe { see_avx512(pairs, pose) },
            _ => see::<4>(pairs, pose),
        }
    }

    /// Adds the equations of the first `count` pairs. The same bits on every kernel.
    pub fn equations(self, pairs: &Pairs, by: Weighing, count: usize, sums: &mut Sums) {
        match self.0 {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 | Kind::AvxVnni => unsafe { equations_avx2(pairs, by, count, sums) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx => unsafe {
                equations_avx512(pairs, by, count, sums);
            },
            _ => equations::<4>(pairs, by, count, sums),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::tests::Numbers;
    use glam::Vec3;

    fn pairs(seed: u32) -> Pairs {
        let mut numbers = Numbers(seed);
        let mut pairs = Pairs::ZERO;
        for rows in [&mut pairs.p, &mut pairs.q] {
            rows.as_flattened_mut()
                .iter_mut()
                .for_each(|x| *x = numbers.next());
        }
        for i in 0..PAIRS {
            for rows in [&mut pairs.m, &mut pairs.n] {
                let v = Vec3::new(numbers.next(), numbers.next(), numbers.next()).normalize();
                for (row, x) in rows.iter_mut().zip(v.to_array()) {
                    row[i] = x;
                }
            }
        }
        pairs
    }

    #[test]
    fn every_kernel_gives_the_same_bits() {
        let pose = crate::polish::tests::pose([0.3, -0.2, 0.9], [0.1, 0.2, -0.3]);
        let by = Weighing {
            gate: 2.0,
            tangential: 0.2,
        };
        let mut of_portable = Vec::new();
        for isa in Isa::all() {
            let mut sums = Sums::ZERO;
            for (seed, count) in [(1, 16), (2, 16), (3, 5), (4, 0)] {
                let mut pairs = pairs(seed);
                isa.see(&mut pairs, &pose);
                isa.equations(&pairs, by, count, &mut sums);
            }
            let bits: Vec<u32> = sums.0.as_flattened().iter().map(|x| x.to_bits()).collect();
            if of_portable.is_empty() {
                of_portable = bits;
            } else {
                assert_eq!(bits, of_portable, "{}", isa.name());
            }
        }
    }

    /// The sums are the gradient and the Gauss-Newton matrix of the weighted squares that the module speaks of.
    #[test]
    fn sums_are_those_of_the_definition() {
        let pairs = pairs(5);
        let by = Weighing {
            gate: 3.0,
            tangential: 0.2,
        };
        let mut sums = Sums::ZERO;
        Isa::PORTABLE.equations(&pairs, by, 9, &mut sums);
        let mut expected = [0.0f64; 27];
        let at = |rows: &[Row; 3], i: usize| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        for i in 0..9 {
            let (p, m, q, n) = (
                at(&pairs.p, i),
                at(&pairs.m, i),
                at(&pairs.q, i),
                at(&pairs.n, i),
            );
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
