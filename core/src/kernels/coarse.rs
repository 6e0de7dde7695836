//! Steps and losses for searches over many poses: few points, matched with approximately nearest points of a surface, which a
//! grid looks up.
//!
//! As in [`super::lanes`], the bits are the same on every kernel.

#![allow(unsafe_code)]

use super::Isa;
use super::equations::add;
use super::lanes::{Four, LANES, Lanes, Seen, Vectors};
use super::losses::of_surface;
use super::on_lanes::on_lanes;
use super::oriented::{Oriented, OrientedPoints};
use super::{Sums, Weighing};
use crate::pose::Pose;

/// Cells along each axis of a grid around a surface.
pub const CELLS: usize = 24;
/// Half of the grid's side length; a normalised surface lies within 1.
pub const HALF: f32 = 1.2;
/// Number of cells.
pub const GRID: usize = CELLS * CELLS * CELLS;

/// A surface in a grid; cells are stored along x first.
#[derive(Clone, Copy, Debug)]
pub struct GridLookup<'a> {
    /// For each cell, the place of the point nearest to its centre.
    pub places: &'a [u16; GRID],
    /// The surface.
    pub surface: OrientedPoints<'a>,
}

impl GridLookup<'_> {
    /// Points of the surface near the given ones, and their normals.
    #[inline(always)]
    fn to<L: Lanes>(&self, p: Vectors<L>) -> [Vectors<L>; 2] {
        let cells = cells_of(p);
        let mut places = [0; LANES];
        for (place, &cell) in places.iter_mut().zip(&cells).take(L::COUNT) {
            // SAFETY: the cell is one of the grid's.
            *place = unsafe { *self.places.get_unchecked(cell as usize) };
        }
        self.surface.gather(&places, 0)
    }
}

/// The cell of the grid whose centre is nearest to a point, as the kernels look it up.
pub fn cell_of(p: [f32; 3]) -> usize {
    let [cell, ..] = cells_of(Vectors::<Four>::all(p));
    cell as usize
}

/// The same for each lane; the lanes' cells come first.
#[inline(always)]
fn cells_of<L: Lanes>(p: Vectors<L>) -> [u32; LANES] {
    let (x, y, z) = (cell(p.x), cell(p.y), cell(p.z));
    let plane = L::times_and(z, CELLS as u32, y);
    let mut cells = [0; LANES];
    L::store_counts(L::times_and(plane, CELLS as u32, x), &mut cells, 0);
    cells
}

/// The nearest cell along an axis, clamped to the grid.
#[inline(always)]
fn cell<L: Lanes>(x: L) -> L::Counts {
    const FACTOR: f32 = CELLS as f32 / (2.0 * HALF);
    // Above this, the last bit of an f32 stands for 1. Adding it is faster than a conversion, which checks the range.
    const UNIT: f32 = 8_388_608.0;
    let along = (x + L::all(HALF)) * L::all(FACTOR) - L::all(0.5);
    let within = along.max(L::all(0.0)).min(L::all(CELLS as f32 - 1.0));
    (within + L::all(UNIT)).bits_beyond(UNIT.to_bits())
}

/// See [`Isa::coarse_equations`].
#[inline(always)]
fn equations<L: Lanes>(
    sample: &[Oriented],
    count: usize,
    pose: &Pose,
    near: &GridLookup<'_>,
    by: Weighing,
    sums: &mut Sums,
) {
    let seen = Seen::<L>::under(pose);
    for (k, group) in sample.iter().enumerate() {
        let count = count.saturating_sub(k * LANES);
        for lane in (0..LANES).step_by(L::COUNT) {
            let p = seen.point(Vectors::load(&group.points, lane));
            let m = seen.direction(Vectors::load(&group.normals, lane));
            let [q, n] = near.to(p);
            add(lane, [p, m], [q, n], by, count, sums);
        }
    }
}

/// See [`Isa::coarse_loss`].
#[inline(always)]
fn loss<L: Lanes>(
    sample: &[Oriented],
    count: usize,
    pose: &Pose,
    near: &GridLookup<'_>,
    [radius, scale]: [f32; 2],
    most: f32,
) -> f32 {
    let seen = Seen::<L>::under(pose);
    let mut sum = 0.0;
    for (k, group) in sample.iter().enumerate() {
        let count = count.saturating_sub(k * LANES);
        for lane in (0..LANES).step_by(L::COUNT) {
            let p = seen.point(Vectors::load(&group.points, lane));
            let [q, n] = near.to(p);
            let losses = of_surface(p - q, n, radius, scale);
            let mut row = [0.0; LANES];
            losses.store(&mut row, 0);
            for loss in row.iter().take(L::COUNT.min(count.saturating_sub(lane))) {
                sum += loss;
            }
        }
        if sum >= most {
            return sum;
        }
    }
    sum
}

impl Isa {
    /// Adds the equations of the first `count` points of a sample under a pose, matched with near points of the grid. The same
    /// bits on every kernel.
    pub fn coarse_equations(
        self,
        sample: &[Oriented],
        count: usize,
        pose: &Pose,
        near: &GridLookup<'_>,
        by: Weighing,
        sums: &mut Sums,
    ) {
        on_lanes!(
            self,
            equations(
                sample: &[Oriented],
                count: usize,
                pose: &Pose,
                near: &GridLookup<'_>,
                by: Weighing,
                sums: &mut Sums,
            )
        );
    }

    /// Sum of the losses of these points, for a radius and a scale. Once the sum reaches `most`, it may stop there. The same
    /// bits on every kernel.
    pub fn coarse_loss(
        self,
        sample: &[Oriented],
        count: usize,
        pose: &Pose,
        near: &GridLookup<'_>,
        radius_and_scale: [f32; 2],
        most: f32,
    ) -> f32 {
        on_lanes!(
            self,
            loss(
                sample: &[Oriented],
                count: usize,
                pose: &Pose,
                near: &GridLookup<'_>,
                radius_and_scale: [f32; 2],
                most: f32,
            ) -> f32
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dims::SURFACE_POINTS;
    use crate::kernels::oriented::tests::Cloud;
    use crate::loss::of_surface;
    use crate::polish::tests::pose;
    use glam::Vec3;

    /// Places of points that need not be near.
    fn places() -> Box<[u16; GRID]> {
        let mut places = Box::new([0; GRID]);
        for (cell, place) in places.iter_mut().enumerate() {
            *place = (cell * 7919 % SURFACE_POINTS) as u16;
        }
        places
    }

    #[test]
    fn every_kernel_gives_the_same_bits() {
        let (source, target, places) = (Cloud::drawn(3), Cloud::drawn(4), places());
        let near = GridLookup {
            places: &places,
            surface: target.bare(),
        };
        let by = Weighing {
            gate: 2.5,
            tangential: 0.1,
        };
        // Inside the grid, across its border, and outside.
        for shift in [[0.1, 0.2, -0.3], [0.9, -0.8, 0.4], [9.0, -1e9, 3.0]] {
            let pose = pose([0.3, -0.2, 0.9], shift);
            for count in [0, 5, 16, 37, 96] {
                let sample = source.sample(count);
                let found = |isa: Isa| -> (Vec<u32>, u32) {
                    let mut sums = Sums::ZERO;
                    isa.coarse_equations(&sample, count, &pose, &near, by, &mut sums);
                    let sums = sums.0.as_flattened().iter();
                    let loss =
                        isa.coarse_loss(&sample, count, &pose, &near, [0.2, 0.3], f32::INFINITY);
                    (sums.map(|x| x.to_bits()).collect(), loss.to_bits())
                };
                let expected = found(Isa::PORTABLE);
                for isa in Isa::all() {
                    assert_eq!(found(isa), expected, "{}", isa.name());
                }
            }
        }
    }

    #[test]
    fn losses_are_those_of_the_points_of_the_cells() {
        let (source, target, places) = (Cloud::drawn(5), Cloud::drawn(6), places());
        let near = GridLookup {
            places: &places,
            surface: target.bare(),
        };
        let pose = pose([0.1, 0.4, -0.9], [0.2, 0.1, 0.0]);
        let sample = source.sample(96);
        let mut expected = 0.0;
        for place in 0..96 {
            let p = pose.apply(source.at(place).0);
            let along = |x: f32| {
                let k = (x + HALF) * (CELLS as f32 / (2.0 * HALF)) - 0.5;
                k.clamp(0.0, CELLS as f32 - 1.0).round_ties_even() as usize
            };
            let Vec3 { x, y, z } = p;
            let cell = (along(z) * CELLS + along(y)) * CELLS + along(x);
            assert_eq!(cell_of(p.to_array()), cell);
            let (q, n) = target.at(places[cell]);
            expected += of_surface(p - q, n, 0.2, 0.3);
        }
        for isa in Isa::all() {
            let loss = |most| isa.coarse_loss(&sample, 96, &pose, &near, [0.2, 0.3], most);
            assert_eq!(loss(f32::INFINITY), expected, "{}", isa.name());
            // A sum that reaches `most` ends early.
            let most = 0.5 * expected;
            assert!(loss(most) >= most && loss(most) < expected);
        }
    }
}
