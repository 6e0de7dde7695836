//! A grid in which to look up a surface's point near a place: approximate, for searches over many poses.

use crate::kernels::{BATCH, Batch, CELLS, GRID, GridLookup, HALF, Isa, cell_of};
use crate::surface::Surface;
use glam::Vec3;

/// For each cell, the surface's point nearest to its centre.
#[derive(Clone, Debug)]
pub(crate) struct Lookup {
    places: [u16; GRID],
}

impl Lookup {
    /// A lookup of no surface. All bits are zero.
    pub(crate) const EMPTY: Lookup = Lookup { places: [0; GRID] };

    /// Fills all cells.
    pub(crate) fn fill(&mut self, isa: Isa, surface: &Surface) {
        for first in (0..self.places.len()).step_by(BATCH) {
            let mut batch = Batch::EMPTY;
            let [xs, ys, zs] = &mut batch.at;
            for (lane, ((x, y), z)) in xs.iter_mut().zip(ys).zip(zs).enumerate() {
                [*x, *y, *z] = centre(first + lane);
            }
            // What is nearest to the cells one row before is not far from these.
            let before = first.checked_sub(CELLS);
            let before = before.and_then(|before| self.places.get(before..first));
            show(&mut batch, surface, before.unwrap_or(&[0]));
            isa.nearest(&mut batch, &surface.boxed());
            let places = self.places.iter_mut().skip(first);
            for (place, found) in places.zip(batch.place) {
                *place = found as u16;
            }
        }
    }

    /// Place of a point that is about nearest to `p`.
    pub(crate) fn near(&self, p: Vec3) -> usize {
        let place = self.places.get(cell_of(p.to_array()));
        place.copied().unwrap_or(0).into()
    }

    /// The grid, with the surface whose points it holds.
    pub(crate) fn of<'a>(&'a self, surface: &'a Surface) -> GridLookup<'a> {
        GridLookup {
            places: &self.places,
            surface: surface.bare(),
        }
    }
}

fn centre(cell: usize) -> [f32; 3] {
    [cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)]
        .map(|k| (k as f32 + 0.5) * (2.0 * HALF / CELLS as f32) - HALF)
}

/// Gives each lane of a batch a point to start from; lanes beyond the last point get the last one.
fn show(batch: &mut Batch, surface: &Surface, places: &[u16]) {
    let [xs, ys, zs] = batch.at;
    let lanes = xs
        .iter()
        .zip(ys)
        .zip(zs)
        .zip(&mut batch.nearest)
        .zip(&mut batch.place);
    let last = places.last().copied().unwrap_or(0);
    let places = places.iter().copied().chain(core::iter::repeat(last));
    for (((((x, y), z), nearest), place), shown) in lanes.zip(places) {
        let apart = Vec3::new(*x, y, z) - surface.at(shown.into()).0;
        (*nearest, *place) = (apart.length_squared(), shown.into());
    }
}
