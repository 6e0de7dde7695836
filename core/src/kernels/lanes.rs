//! Numbers side by side, one to a lane: the vectors on which the kernels of refinement are written.
//!
//! An algorithm is written once, on [`Lanes`], and compiled for each instruction set ([`super::on_lanes`]). It uses no fused
//! multiply-add, and sums over lanes in the order of the lanes, so every kernel gives the same bits.

use crate::dims::SURFACE_POINTS;
use crate::pose::Pose;
use core::ops::{Add, Div, Mul, Sub};

/// Lanes of a [`Row`].
pub const LANES: usize = 16;

/// One number for each lane.
pub type Row = [f32; LANES];

/// Vectors by place, and one more at the end: loads read four numbers at a time.
pub type Places = [[f32; 3]; SURFACE_POINTS + 1];

/// Some of a row's lanes, as many as a register holds. Unless stated
/// otherwise, a function does to each lane what its name says.
///
/// A type for an instruction set may be named only after that was detected, in a function with its `target_feature`, into which
/// all operations on it are inlined.
pub(super) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Number of lanes.
    const COUNT: usize;
    /// An integer from 0 to 2³² - 1 for each lane.
    type Counts: Copy;

    fn all(x: f32) -> Self;
    /// Loads lanes of a row from `first` on.
    fn load(row: &Row, first: usize) -> Self;
    fn store(self, row: &mut Row, first: usize);
    fn load_counts(row: &[u32; LANES], first: usize) -> Self::Counts;
    fn store_counts(counts: Self::Counts, row: &mut [u32; LANES], first: usize);

    /// The larger; `other` if either is NaN.
    fn max(self, other: Self) -> Self;
    /// The smaller; `other` if either is NaN.
    fn min(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// `-self` where `by` is negative, `self` elsewhere.
    fn with_sign_flipped_by(self, by: Self) -> Self;
    /// The largest lane.
    fn largest(self) -> f32;
    /// A bit for each lane that is less than `other`'s; the first lane has the lowest bit.
    fn below(self, other: Self) -> u32;
    /// `self` and `counts`, or `other` and `count` where `other` is less.
    fn keep_less(self, counts: Self::Counts, other: Self, count: u32) -> (Self, Self::Counts);
    /// The bits of each float as an integer, minus `some`.
    fn bits_beyond(self, some: u32) -> Self::Counts;
    /// `counts * by + other`.
    fn times_and(counts: Self::Counts, by: u32, other: Self::Counts) -> Self::Counts;

    /// The vectors at places up to [`SURFACE_POINTS`], one for each lane.
    fn gather(from: &Places, places: &[u16; LANES], first: usize) -> Vectors<Self>;
}

/// Vectors in lanes.
#[derive(Clone, Copy)]
pub(super) struct Vectors<L> {
    pub(super) x: L,
    pub(super) y: L,
    pub(super) z: L,
}

impl<L: Lanes> Vectors<L> {
    #[inline(always)]
    pub(super) fn all([x, y, z]: [f32; 3]) -> Self {
        let (x, y, z) = (L::all(x), L::all(y), L::all(z));
        Vectors { x, y, z }
    }

    /// Loads lanes from `first` on of three rows, one for each axis.
    #[inline(always)]
    pub(super) fn load([x, y, z]: &[Row; 3], first: usize) -> Self {
        Self::of([x, y, z], first)
    }

    /// The same for rows that are not adjacent.
    #[inline(always)]
    pub(super) fn of([x, y, z]: [&Row; 3], first: usize) -> Self {
        let (x, y, z) = (L::load(x, first), L::load(y, first), L::load(z, first));
        Vectors { x, y, z }
    }

    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        let (x, y, z) = (
            self.x.max(other.x),
            self.y.max(other.y),
            self.z.max(other.z),
        );
        Vectors { x, y, z }
    }

    #[inline(always)]
    pub(super) fn dot(self, other: Self) -> L {
        self.x * other.x + self.y * other.y + self.z * other.z
    }
}

impl<L: Lanes> Add for Vectors<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let (x, y, z) = (self.x + other.x, self.y + other.y, self.z + other.z);
        Vectors { x, y, z }
    }
}

impl<L: Lanes> Sub for Vectors<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let (x, y, z) = (self.x - other.x, self.y - other.y, self.z - other.z);
        Vectors { x, y, z }
    }
}

/// A pose, applied to vectors in lanes.
#[derive(Clone, Copy)]
pub(super) struct Seen<L> {
    columns: [Vectors<L>; 3],
    shift: Vectors<L>,
}

impl<L: Lanes> Seen<L> {
    #[inline(always)]
    pub(super) fn under(pose: &Pose) -> Self {
        let rotation = &pose.rotation;
        Seen {
            columns: [
                Vectors::all(rotation.x_axis.to_array()),
                Vectors::all(rotation.y_axis.to_array()),
                Vectors::all(rotation.z_axis.to_array()),
            ],
            shift: Vectors::all(pose.translation.to_array()),
        }
    }

    /// Applies the pose to points, as [`Pose::apply`].
    #[inline(always)]
    pub(super) fn point(&self, of: Vectors<L>) -> Vectors<L> {
        self.direction(of) + self.shift
    }

    #[inline(always)]
    pub(super) fn direction(&self, Vectors { x, y, z }: Vectors<L>) -> Vectors<L> {
        let [a, b, c] = self.columns;
        Vectors {
            x: a.x * x + b.x * y + c.x * z,
            y: a.y * x + b.y * y + c.y * z,
            z: a.z * x + b.z * y + c.z * z,
        }
    }
}

/// Four lanes in plain Rust: the compiler puts them into registers if there are any.
#[derive(Clone, Copy)]
pub(super) struct Four([f32; 4]);

impl Four {
    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let ([a, b, c, d], [e, g, h, i]) = (self.0, other.0);
        Four([f(a, e), f(b, g), f(c, h), f(d, i)])
    }
}

impl Add for Four {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map2(other, |x, y| x + y)
    }
}

impl Sub for Four {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map2(other, |x, y| x - y)
    }
}

impl Mul for Four {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map2(other, |x, y| x * y)
    }
}

impl Div for Four {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.map2(other, |x, y| x / y)
    }
}

impl Lanes for Four {
    const COUNT: usize = 4;
    type Counts = [u32; 4];

    #[inline(always)]
    fn all(x: f32) -> Self {
        Four([x; 4])
    }

    #[inline(always)]
    fn load(row: &Row, first: usize) -> Self {
        Four([row[first], row[first + 1], row[first + 2], row[first + 3]])
    }

    #[inline(always)]
    fn store(self, row: &mut Row, first: usize) {
        row[first..first + 4].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn load_counts(row: &[u32; LANES], first: usize) -> [u32; 4] {
        [row[first], row[first + 1], row[first + 2], row[first + 3]]
    }

    #[inline(always)]
    fn store_counts(counts: [u32; 4], row: &mut [u32; LANES], first: usize) {
        row[first..first + 4].copy_from_slice(&counts);
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.map2(other, |x, y| if x > y { x } else { y })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.map2(other, |x, y| if x < y { x } else { y })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map2(self, |x, _| libm::sqrtf(x))
    }

    #[inline(always)]
    fn with_sign_flipped_by(self, by: Self) -> Self {
        self.map2(by, |x, by| if by < 0.0 { -x } else { x })
    }

    #[inline(always)]
    fn largest(self) -> f32 {
        let larger = |x: f32, y: f32| if x > y { x } else { y };
        let [a, b, c, d] = self.0;
        larger(larger(a, c), larger(b, d))
    }

    #[inline(always)]
    fn below(self, other: Self) -> u32 {
        let mut bits = 0;
        for i in 0..4 {
            bits |= u32::from(self.0[i] < other.0[i]) << i;
        }
        bits
    }

    #[inline(always)]
    fn keep_less(self, mut counts: [u32; 4], other: Self, count: u32) -> (Self, [u32; 4]) {
        // Integers first: a comparison that also selected the float would keep it in memory.
        for ((kept, x), y) in counts.iter_mut().zip(self.0).zip(other.0) {
            *kept = if y < x { count } else { *kept };
        }
        (other.min(self), counts)
    }

    #[inline(always)]
    fn bits_beyond(self, some: u32) -> [u32; 4] {
        let mut bits = [0; 4];
        for (bits, x) in bits.iter_mut().zip(self.0) {
            *bits = x.to_bits().wrapping_sub(some);
        }
        bits
    }

    #[inline(always)]
    fn times_and(mut counts: [u32; 4], by: u32, other: [u32; 4]) -> [u32; 4] {
        for i in 0..4 {
            counts[i] = counts[i].wrapping_mul(by).wrapping_add(other[i]);
        }
        counts
    }

    #[inline(always)]
    fn gather(from: &Places, places: &[u16; LANES], first: usize) -> Vectors<Self> {
        let [mut x, mut y, mut z] = [[0.0; 4]; 3];
        for i in 0..4 {
            let place = usize::from(places[first + i]) % SURFACE_POINTS;
            [x[i], y[i], z[i]] = from[place];
        }
        let (x, y, z) = (Four(x), Four(y), Four(z));
        Vectors { x, y, z }
    }
}
