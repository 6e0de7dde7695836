//! Which point of a surface is near a place, looked up in a grid: approximate, for searches that look at many poses.

use crate::kernels::{BATCH, Batch, Isa};
use crate::surface::Surface;
use glam::Vec3;

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
        let (cells, _) = self.places.as_chunks_mut::<BATCH>();
        for (start, places) in cells.iter_mut().enumerate() {
            let mut batch = Batch::EMPTY;
            let [xs, ys, zs] = &mut batch.at;
            for (lane, ((x, y), z)) in xs.iter_mut().zip(ys).zip(zs).enumerate() {
                [*x, *y, *z] = centre(start * BATCH + lane);
            }
            surface.nearest(isa, &mut batch);
            *places = batch.place.map(|place| place as u16);
        }
    }

    /// Place of a point that is near `p`: the nearest to the centre of its cell.
    pub(crate) fn near(&self, p: Vec3) -> usize {
        const FACTOR: f32 = CELLS as f32 / (2.0 * HALF);
        let axis = |x: f32| (((x + HALF) * FACTOR).max(0.0) as usize).min(CELLS - 1);
        let cell = (axis(p.z) * CELLS + axis(p.y)) * CELLS + axis(p.x);
        usize::from(self.places.get(cell).copied().unwrap_or_default())
    }
}

fn centre(cell: usize) -> [f32; 3] {
    [cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)]
        .map(|k| (k as f32 + 0.5) * (2.0 * HALF / CELLS as f32) - HALF)
}
