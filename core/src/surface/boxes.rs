//! Boxes around blocks of points, and their distances.

use super::BLOCKS;
use crate::kernels::{BATCH, Batch, Corners};

/// The boxes of all blocks, one row an axis: distances to all of them are found in lanes.
#[derive(Clone, Debug)]
pub(super) struct Boxes {
    pub(super) low: [[f32; BLOCKS]; 3],
    pub(super) high: [[f32; BLOCKS]; 3],
}

impl Boxes {
    /// Of no blocks. All bits are zero.
    pub(super) const ZERO: Boxes = Boxes {
        low: [[0.0; BLOCKS]; 3],
        high: [[0.0; BLOCKS]; 3],
    };

    pub(super) fn set(&mut self, block: usize, [low, high]: Corners) {
        for (rows, corner) in [(&mut self.low, low), (&mut self.high, high)] {
            for (row, x) in rows.iter_mut().zip(corner) {
                if let Some(place) = row.get_mut(block) {
                    *place = x;
                }
            }
        }
    }

    /// Squared distance of the first `blocks` from a box.
    pub(super) fn gaps(&self, [low, high]: &Corners, blocks: usize) -> [f32; BLOCKS] {
        let mut gaps = [0.0f32; BLOCKS];
        let corners = low.iter().zip(high);
        for ((low, high), (&l, &h)) in self.low.iter().zip(&self.high).zip(corners) {
            let boxes = gaps.iter_mut().zip(low).zip(high).take(blocks);
            for ((gap, &low), &high) in boxes {
                let (below, above) = (l - high, low - h);
                let d = if below > above { below } else { above };
                let d = if d > 0.0 { d } else { 0.0 };
                *gap += d * d;
            }
        }
        gaps
    }
}

pub(super) fn bounds_of(batch: &Batch) -> Corners {
    let negated = batch.at.map(|row| row.map(|x| -x));
    let low = negated.each_ref().map(|row| -largest(row));
    [low, batch.at.each_ref().map(largest)]
}

/// The largest of some numbers, in lanes.
pub(super) fn largest(values: &[f32; BATCH]) -> f32 {
    let (chunks, _) = values.as_chunks::<4>();
    let mut lanes = [f32::NEG_INFINITY; 4];
    for chunk in chunks {
        for (most, &x) in lanes.iter_mut().zip(chunk) {
            *most = if x > *most { x } else { *most };
        }
    }
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    let [a, b, c, d] = lanes;
    larger(larger(a, b), larger(c, d))
}
