//! Clouds as a robot holds them: coordinates in f32, or codes on a grid in half the memory.

use crate::dims::{MAX_POINTS, MIN_POINTS};
use crate::error::Error;
use crate::grid::Grid;
use core::ops::Range;

/// Largest coordinate accepted: larger ones mark what was not measured, in any unit, and their squares may overflow.
pub const LARGEST_COORDINATE: f32 = 1e12;

/// A borrowed cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cloud<'c> {
    /// Coordinates, 12 bytes a point.
    F32(&'c [[f32; 3]]),
    /// Codes of 16 bits on a grid, 6 bytes a point.
    Grid(Grid, &'c [[i16; 3]]),
}

impl<'c> Cloud<'c> {
    /// A cloud without points.
    pub const EMPTY: Cloud<'static> = Cloud::F32(&[]);

    /// Number of points.
    pub fn len(&self) -> usize {
        match self {
            Cloud::F32(points) => points.len(),
            Cloud::Grid(_, codes) => codes.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The points.
    pub fn points(self) -> impl Iterator<Item = [f32; 3]> + Clone {
        (0..self.len()).filter_map(move |i| self.point(i))
    }

    /// The point at an index.
    #[cfg_attr(target_os = "none", inline(never))] // there, code size matters more than the cost of calls
    pub fn point(&self, index: usize) -> Option<[f32; 3]> {
        match self {
            Cloud::F32(points) => points.get(index).copied(),
            Cloud::Grid(grid, codes) => codes.get(index).map(|&code| grid.decode(code)),
        }
    }

    /// The points of a range; no points if the range is out of bounds.
    pub fn part(self, range: Range<usize>) -> Cloud<'c> {
        match self {
            Cloud::F32(points) => Cloud::F32(points.get(range).unwrap_or(&[])),
            Cloud::Grid(grid, codes) => Cloud::Grid(grid, codes.get(range).unwrap_or(&[])),
        }
    }

    /// Refuses clouds that cannot be registered.
    ///
    /// # Errors
    /// [`Error::EmptyCloud`], [`Error::TooFewPoints`], [`Error::TooManyPoints`], [`Error::NotFinite`],
    /// [`Error::OutOfRange`], [`Error::NoExtent`].
    pub fn check(self) -> Result<(), Error> {
        match self.len() {
            0 => return Err(Error::EmptyCloud),
            n if n < MIN_POINTS => return Err(Error::TooFewPoints { points: n }),
            n if n > MAX_POINTS => {
                return Err(Error::TooManyPoints {
                    points: n,
                    capacity: MAX_POINTS,
                });
            }
            _ => {}
        }
        let finite = |p: [f32; 3]| p.iter().all(|x| x.is_finite());
        if let Some(index) = self.points().position(|p| !finite(p)) {
            return Err(Error::NotFinite { index });
        }
        let measured = |p: [f32; 3]| p.iter().all(|x| x.abs() <= LARGEST_COORDINATE);
        if let Some(index) = self.points().position(|p| !measured(p)) {
            return Err(Error::OutOfRange { index });
        }
        let mut points = self.points();
        let first = points.next();
        if points.all(|p| Some(p) == first) {
            return Err(Error::NoExtent);
        }
        Ok(())
    }
}

#[cfg(all(test, feature = "pretrained"))]
mod tests {
    use super::*;
    use crate::golden::{POINTS, clouds};
    use crate::kernels::Isa;
    use crate::net::Scratch;
    use crate::{Frame, Policy, Pose, Registrar, Registration};

    #[test]
    fn codes_are_registered_as_the_points_that_they_stand_for() {
        let policy = Policy {
            rescan: 2,
            ..Policy::pretrained().expect("a sound policy")
        };
        let all = clouds();
        let grids = all.each_ref().map(|cloud| Grid::of(cloud).expect("points"));
        let mut codes = [[[0; 3]; POINTS]; 2];
        let mut decoded = all;
        for (i, grid) in grids.iter().enumerate() {
            codes[i] = all[i].map(|point| grid.encode(point));
            decoded[i] = codes[i].map(|code| grid.decode(code));
        }
        let [source, target] = [0, 1].map(|i| Cloud::Grid(grids[i], &codes[i]));
        let frame = Frame::of_cloud(target).expect("extent");
        assert_eq!(Ok(frame), Frame::of(&decoded[1]));
        let mut scratch = Scratch::new();
        for isa in Isa::all() {
            let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
            let mut expected = registrar
                .start(&decoded[0], &decoded[1], frame, Pose::IDENTITY)
                .expect("two clouds");
            let mut found = Registration::new();
            registrar
                .begin(&mut found, source, target, frame, Pose::IDENTITY)
                .expect("two clouds");
            for points in [7, 64, usize::MAX] {
                let step = loop {
                    if let Some(step) = registrar.advance(&mut found, points).expect("started") {
                        break step;
                    }
                };
                assert_eq!(Ok(step), registrar.step(&mut expected), "{}", isa.name());
            }
            assert_eq!(found.target_from_source(), expected.target_from_source());
        }
    }

    #[test]
    fn a_grid_that_is_not_finite_is_refused() {
        let grid = Grid {
            origin: [0.0, f32::NAN, 0.0],
            step: 1.0,
        };
        let refused = Cloud::Grid(grid, &[[1; 3]; 4]).check();
        assert_eq!(refused, Err(Error::NotFinite { index: 0 }));
        assert_eq!(Cloud::EMPTY.check(), Err(Error::EmptyCloud));
    }
}
