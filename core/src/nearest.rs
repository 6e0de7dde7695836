//! Which point of a surface is near a place, looked up in a grid: approximate, for searches that look at many poses.

use crate::kernels::{BATCH, Batch, Isa, PAIRS};
use crate::surface::Surface;

/// Cells along an axis.
const CELLS: usize = 24;
/// Half of the grid's side: a normalised target is within 1.
const HALF: f32 = 1.2;

/// The point of a surface that is nearest to each cell's centre.
#[derive(Clone, Debug)]
pub(crate) struct Lookup {
    places: [u16; CELLS * CELLS * CELLS],
}

impl Lookup {
    /// Of no surface. All bits are zero.
    pub(crate) const EMPTY: Lookup = Lookup {
        places: [0; CELLS * CELLS * CELLS],
    };

    /// Looks all cells up, once.
    pub(crate) fn fill(&mut self, isa: Isa, surface: &Surface) {
        for first in (0..self.places.len()).step_by(BATCH) {
            let mut batch = Batch::EMPTY;
            let [xs, ys, zs] = &mut batch.at;
            for (lane, ((x, y), z)) in xs.iter_mut().zip(ys).zip(zs).enumerate() {
                [*x, *y, *z] = centre(first + lane);
            }
            // What is nearest to the cells before these, one row up, is not far.
            let before = first.checked_sub(CELLS);
            let before = before.and_then(|before| self.places.get(before..first));
            surface.show_known(&mut batch, before.unwrap_or(&[0]).iter().copied());
            surface.nearest(isa, &mut batch);
            let places = self.places.iter_mut().skip(first);
            for (place, found) in places.zip(batch.place) {
                *place = found as u16;
            }
        }
    }

    /// Places of points that are near such points, rows of coordinates: the nearest to the centres of their cells.
    pub(crate) fn near(&self, at: &[[f32; PAIRS]; 3]) -> [u16; PAIRS] {
        const FACTOR: f32 = CELLS as f32 / (2.0 * HALF);
        let mut cells = [0u32; PAIRS];
        for row in at.iter().rev() {
            for (cell, x) in cells.iter_mut().zip(row) {
                let along = ((x + HALF) * FACTOR - 0.5).clamp(0.0, CELLS as f32 - 1.0);
                *cell = *cell * CELLS as u32 + nearest_integer(along);
            }
        }
        cells.map(|cell| self.places.get(cell as usize).copied().unwrap_or_default())
    }
}

/// Of a number from 0 to 2²², rounded half to even. Faster than a conversion, which looks for what is out of range.
fn nearest_integer(x: f32) -> u32 {
    const UNIT: f32 = 8_388_608.0; // from here on the last bit of an f32 stands for 1
    (x + UNIT).to_bits() - UNIT.to_bits()
}

fn centre(cell: usize) -> [f32; 3] {
    [cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)]
        .map(|k| (k as f32 + 0.5) * (2.0 * HALF / CELLS as f32) - HALF)
}
