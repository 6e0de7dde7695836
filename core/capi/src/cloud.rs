//! Clouds in the caller's memory, of floats or of 16-bit codes.

use crate::ReagentStatus;
use crate::pointer::{aligned, check_pointer, floats, value};
use crate::status::status;
use core::slice::{from_raw_parts, from_raw_parts_mut};
use reagent_core::cloud::Cloud;
use reagent_core::grid::Grid;
use reagent_core::order;

/// Where the codes of a cloud lie in space: code c on an axis stands for the coordinate origin + c * step. A cloud of codes
/// takes half the memory of a cloud of floats.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReagentGrid {
    /// Point of the codes (0, 0, 0).
    pub origin: [f32; 3],
    /// Distance between neighbouring codes, the same along every axis.
    pub step: f32,
}

impl From<ReagentGrid> for Grid {
    fn from(ReagentGrid { origin, step }: ReagentGrid) -> Self {
        Grid { origin, step }
    }
}

impl From<Grid> for ReagentGrid {
    fn from(Grid { origin, step }: Grid) -> Self {
        ReagentGrid { origin, step }
    }
}

/// A cloud in the caller's memory.
#[derive(Clone, Copy)]
pub(crate) enum CloudPointer {
    F32(*const f32, usize),
    Grid(Grid, *const i16, usize),
}

impl CloudPointer {
    /// A cloud of floats.
    pub(crate) fn floats(xyz: *const f32, points: usize) -> Result<CloudPointer, ReagentStatus> {
        check_pointer(xyz, points)?;
        Ok(CloudPointer::F32(xyz, points))
    }

    /// A cloud of codes.
    ///
    /// # Safety
    /// `grid` is null, not aligned, or points to a grid.
    pub(crate) unsafe fn codes(
        grid: *const ReagentGrid,
        codes: *const i16,
        points: usize,
    ) -> Result<CloudPointer, ReagentStatus> {
        // SAFETY: the caller's promise.
        let grid = unsafe { value(grid) }?;
        check_pointer(codes, points)?;
        Ok(CloudPointer::Grid(grid.into(), codes, points))
    }

    /// The points of the cloud.
    ///
    /// # Safety
    /// The pointer of a cloud that is not empty must point to as many points, which live as long as the cloud.
    pub(crate) unsafe fn cloud<'c>(self) -> Cloud<'c> {
        // SAFETY: the caller's promise; three numbers are aligned as one is, and the count was checked to be no
        // more than the most points of a cloud.
        unsafe {
            match self {
                CloudPointer::F32(_, 0) | CloudPointer::Grid(_, _, 0) => Cloud::EMPTY,
                CloudPointer::F32(xyz, points) => Cloud::F32(from_raw_parts(xyz.cast(), points)),
                CloudPointer::Grid(grid, codes, points) => {
                    Cloud::Grid(grid, from_raw_parts(codes.cast(), points))
                }
            }
        }
    }
}

/// Reorders a cloud in place so that neighbours follow each other: on a microcontroller, registering ordered clouds takes half
/// the instructions. Order the model once, and a cloud on a grid before it is encoded. At most 4096 points. NaN stays in the
/// cloud, which is refused later.
///
/// # Safety
/// `xyz` points to 3 * `points` floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_put_in_order(xyz: *mut f32, points: usize) -> ReagentStatus {
    let put_in_order = || {
        check_pointer(xyz, points)?;
        if points > 0 {
            // SAFETY: the caller's promise; three floats are aligned as one is.
            order::put_in_order(unsafe { from_raw_parts_mut(xyz.cast(), points) });
        }
        Ok(())
    };
    status(put_in_order())
}

/// Finds the finest grid whose codes cover the cloud. Each coordinate comes back within about half its step, which is 1/65534
/// of the longest side of the cloud's box.
///
/// # Safety
/// `xyz` points to 3 * `points` floats, `grid` to room for a grid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_grid_of(
    xyz: *const f32,
    points: usize,
    grid: *mut ReagentGrid,
) -> ReagentStatus {
    status((|| {
        if !aligned(grid) {
            return Err(ReagentStatus::Pointer);
        }
        // SAFETY: the caller's promise.
        let found = Grid::of(unsafe { floats(xyz, points) }?)?;
        // SAFETY: the caller's promise, and checked above.
        unsafe { grid.write(found.into()) };
        Ok(())
    })())
}

/// Puts a cloud on a grid: writes the nearest codes of each point, `points` times three; points beyond the grid get its edge.
/// The grid's step must be positive.
///
/// # Safety
/// `grid` points to a grid, `xyz` to 3 * `points` floats, and `codes` to room for as many codes, elsewhere.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_encode(
    grid: *const ReagentGrid,
    xyz: *const f32,
    points: usize,
    codes: *mut i16,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let grid = Grid::from(unsafe { value(grid) }?);
        check_pointer(codes, points)?;
        // SAFETY: the caller's promise.
        let cloud = unsafe { floats(xyz, points) }?;
        let of_grid = [&grid.origin[..], &[grid.step]];
        let mut numbers = of_grid.into_iter().chain([cloud.as_flattened()]).flatten();
        if !numbers.all(|x| x.is_finite()) {
            return Err(ReagentStatus::NotFinite);
        }
        if grid.step <= 0.0 {
            return Err(ReagentStatus::BadGrid);
        }
        for (index, &point) in cloud.iter().enumerate() {
            // SAFETY: the caller's promise, and checked above.
            unsafe {
                codes
                    .cast::<[i16; 3]>()
                    .add(index)
                    .write(grid.encode(point))
            };
        }
        Ok(())
    })())
}
