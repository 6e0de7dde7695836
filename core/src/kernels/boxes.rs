//! Boxes around runs and blocks of points that are in spatial order.

use super::lanes::{LANES, Lanes, Places, Row, Vectors};
use crate::dims::SURFACE_POINTS;
use core::ops::Range;

/// Points in a run of neighbours.
pub const RUN: usize = 8;
/// Points in a block of runs.
pub const BLOCK: usize = 32;
/// Most blocks of a surface.
pub const BLOCKS: usize = SURFACE_POINTS / BLOCK;
/// Most runs of a surface.
pub const RUNS: usize = SURFACE_POINTS / RUN;

/// A bit for each place of a surface, a byte for each run of points; the first point of a run has the lowest bit.
pub type Bits = [u8; RUNS];
const _: () = assert!(RUN == u8::BITS as usize && LANES == u16::BITS as usize);

/// An axis-aligned box: its lowest and its highest corner.
pub type Corners = [[f32; 3]; 2];

/// The boxes of all blocks, one row for each axis, so that distances to all of them are computed in lanes.
#[derive(Clone, Debug)]
pub struct Boxes {
    /// Lowest coordinates.
    pub low: [[Row; BLOCKS / LANES]; 3],
    /// Highest coordinates.
    pub high: [[Row; BLOCKS / LANES]; 3],
}

impl Boxes {
    /// No blocks. All bits are zero.
    pub const ZERO: Boxes = Boxes {
        low: [[[0.0; LANES]; BLOCKS / LANES]; 3],
        high: [[[0.0; LANES]; BLOCKS / LANES]; 3],
    };

    /// Squared distances from a point to all boxes.
    pub fn gaps(&self, [x, y, z]: [f32; 3]) -> [f32; BLOCKS] {
        let mut gaps = [0.0; BLOCKS];
        for ((low, high), x) in self.low.iter().zip(&self.high).zip([x, y, z]) {
            let sides = low.as_flattened().iter().zip(high.as_flattened());
            for (gap, (low, high)) in gaps.iter_mut().zip(sides) {
                let off = (low - x).max(x - high).max(0.0);
                *gap += off * off;
            }
        }
        gaps
    }
}

/// A surface's points with their boxes.
#[derive(Clone, Copy, Debug)]
pub struct Boxed<'a> {
    /// The points in spatial order, and their number.
    pub points: (&'a Places, usize),
    /// Boxes of the runs.
    pub runs: &'a [Corners; RUNS],
    /// Boxes of the blocks.
    pub blocks: &'a Boxes,
    /// Places that are not to be found.
    pub hidden: Option<&'a Bits>,
}

impl Boxed<'_> {
    /// Number of blocks.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.points.1.div_ceil(BLOCK).min(BLOCKS)
    }

    /// Whether none of a block's points is to be found.
    #[inline(always)]
    pub(super) fn is_hidden(&self, block: usize) -> bool {
        let runs = block * (BLOCK / RUN)..(block + 1) * (BLOCK / RUN);
        let hidden = self.hidden.and_then(|hidden| hidden.get(runs));
        hidden.is_some_and(|runs| runs.iter().all(|&bits| bits == u8::MAX))
    }

    /// A bit for each point of a run that is not to be found.
    #[inline(always)]
    pub(super) fn hidden_in(&self, run: usize) -> u8 {
        let bits = self.hidden.and_then(|hidden| hidden.get(run));
        bits.copied().unwrap_or(0)
    }

    /// Places of the points in a block.
    #[inline(always)]
    pub(super) fn places(&self, block: usize) -> Range<usize> {
        block * BLOCK..self.points.1.min((block + 1) * BLOCK)
    }

    /// Squared distances from a box to the boxes of all blocks.
    #[inline(always)]
    pub(super) fn gaps<L: Lanes>(&self, &[low, high]: &Corners) -> [f32; BLOCKS] {
        let (low, high) = (Vectors::<L>::all(low), Vectors::all(high));
        let mut gaps = [[0.0; LANES]; BLOCKS / LANES];
        for (k, gaps) in gaps
            .iter_mut()
            .enumerate()
            .take(self.count().div_ceil(LANES))
        {
            let ([lx, ly, lz], [hx, hy, hz]) = (&self.blocks.low, &self.blocks.high);
            for lane in (0..LANES).step_by(L::COUNT) {
                let below = low - Vectors::of([&hx[k], &hy[k], &hz[k]], lane);
                let above = Vectors::of([&lx[k], &ly[k], &lz[k]], lane) - high;
                squared_gap(below, above).store(gaps, lane);
            }
        }
        let mut flat = [0.0; BLOCKS];
        flat.copy_from_slice(gaps.as_flattened());
        flat
    }

    /// A bit for each of the sixteen blocks from `first` on whose gap is below `limit`.
    #[inline(always)]
    pub(super) fn below<L: Lanes>(&self, gaps: &[f32; BLOCKS], first: usize, limit: f32) -> u32 {
        let row = &gaps.as_chunks::<LANES>().0[first / LANES];
        let mut bits = 0;
        for lane in (0..LANES).step_by(L::COUNT) {
            bits |= L::load(row, lane).below(L::all(limit)) << lane;
        }
        let count = self.count() - first;
        if count < LANES {
            bits & ((1 << count) - 1)
        } else {
            bits
        }
    }
}

/// Squared distance to a box, from the distance below it and above it along each axis (negative on the other side).
#[inline(always)]
pub(super) fn squared_gap<L: Lanes>(below: Vectors<L>, above: Vectors<L>) -> L {
    let gap = below.max(above).max(Vectors::all([0.0; 3]));
    gap.dot(gap)
}

/// The bounding box of points, given one row for each axis.
#[inline(always)]
pub(super) fn bounds<L: Lanes>([x, y, z]: &[Row; 3]) -> Corners {
    let low = [smallest::<L>(x), smallest::<L>(y), smallest::<L>(z)];
    [low, [largest::<L>(x), largest::<L>(y), largest::<L>(z)]]
}

/// The largest value in a row.
#[inline(always)]
pub(super) fn largest<L: Lanes>(row: &Row) -> f32 {
    let mut most = L::load(row, 0);
    for lane in (L::COUNT..LANES).step_by(L::COUNT) {
        most = most.max(L::load(row, lane));
    }
    most.largest()
}

#[inline(always)]
fn smallest<L: Lanes>(row: &Row) -> f32 {
    let mut least = L::load(row, 0);
    for lane in (L::COUNT..LANES).step_by(L::COUNT) {
        least = least.min(L::load(row, lane));
    }
    -(L::all(0.0) - least).largest()
}
