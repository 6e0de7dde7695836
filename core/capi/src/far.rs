//! Coordinates far from the origin, such as those of a national grid: floats near an origin, and poses in doubles.

use crate::pointer::{aligned, check_pointer, value};
use crate::register::ReagentPose;
use crate::status::{ReagentStatus, status};
use reagent_core::Pose;
use reagent_core::cloud::LARGEST_COORDINATE;

/// Points of which the median is taken, at most.
const LOOKED_AT: usize = 63;

type Rows = [[f64; 4]; 3];
type Position = [f64; 3];

/// Subtracts an origin from a cloud of doubles, so that floats keep its digits. The origin is the median of some points; `near`
/// receives `points` times x, y and z relative to it, at most 4096 points. Each cloud has its own origin; reagent_far_pose
/// converts poses between such clouds back.
///
/// # Safety
/// `xyz` points to 3 * `points` doubles, `origin` to room for three, `near` to room for 3 * `points` floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_take_origin_off(
    xyz: *const f64,
    points: usize,
    origin: *mut f64,
    near: *mut f32,
) -> ReagentStatus {
    status((|| {
        check_pointer(xyz, points)?;
        check_pointer(near, points)?;
        if points == 0 {
            return Err(ReagentStatus::EmptyCloud);
        }
        if !aligned(origin) {
            return Err(ReagentStatus::Pointer);
        }
        // SAFETY: the caller's promise, and checked above; arrays of doubles are aligned as doubles are.
        let at = |i: usize| unsafe { xyz.cast::<Position>().add(i).read() };
        (0..points).try_for_each(|i| check_position(at(i)))?;
        let count = points.min(LOOKED_AT);
        let middle = [0, 1, 2].map(|axis: usize| {
            let mut some = [f64::INFINITY; LOOKED_AT];
            for (k, place) in some.iter_mut().take(count).enumerate() {
                *place = at(k * points / count).get(axis).copied().unwrap_or(0.0);
            }
            some.sort_unstable_by(f64::total_cmp); // unset places come last
            some.get(count / 2).copied().unwrap_or(0.0)
        });
        for i in 0..points {
            let [x, y, z] = at(i);
            let [a, b, c] = middle;
            let relative = [(x - a) as f32, (y - b) as f32, (z - c) as f32];
            // SAFETY: the caller's promise, and checked above.
            unsafe { near.cast::<[f32; 3]>().add(i).write(relative) };
        }
        // SAFETY: the caller's promise, and checked above.
        unsafe { origin.cast::<Position>().write(middle) };
        Ok(())
    })())
}

/// Converts a pose between clouds whose origins were subtracted to one between the original doubles, as rows of [R | t].
///
/// # Safety
/// `near` points to a pose, each origin to three doubles, `rows` to room for twelve.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_far_pose(
    near: *const ReagentPose,
    source_origin: *const f64,
    target_origin: *const f64,
    rows: *mut f64,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let near = unsafe { value(near) }?.rows;
        Pose::from_rows(near).checked()?;
        let near = near.map(|row| row.map(f64::from));
        // SAFETY: the caller's promise.
        let found = far(near, unsafe { origins(source_origin, target_origin) }?);
        if !aligned(rows) {
            return Err(ReagentStatus::Pointer);
        }
        // SAFETY: the caller's promise, and checked above.
        unsafe { rows.cast::<Rows>().write(found) };
        Ok(())
    })())
}

/// The inverse of reagent_far_pose: gives a start for ReagentTask from a pose between the original doubles.
///
/// # Safety
/// `rows` points to twelve doubles, each origin to three, `near` to room for a pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_near_pose(
    rows: *const f64,
    source_origin: *const f64,
    target_origin: *const f64,
    near: *mut ReagentPose,
) -> ReagentStatus {
    status((|| {
        // SAFETY: the caller's promise.
        let rows = unsafe { value(rows.cast::<Rows>()) }?;
        // SAFETY: the caller's promise.
        let [source, target] = unsafe { origins(source_origin, target_origin) }?;
        let found = moved(rows, [source.map(|x| -x), target.map(|x| -x)]);
        if !aligned(near) {
            return Err(ReagentStatus::Pointer);
        }
        let rows = found.map(|row| row.map(|x| x as f32));
        Pose::from_rows(rows).checked()?;
        // SAFETY: the caller's promise, and checked above.
        unsafe { near.write(ReagentPose { rows }) };
        Ok(())
    })())
}

/// # Safety
/// Both are null, not aligned, or point to three doubles.
unsafe fn origins(source: *const f64, target: *const f64) -> Result<[Position; 2], ReagentStatus> {
    // SAFETY: the caller's promise.
    let origins = unsafe { [value(source.cast())?, value(target.cast())?] };
    origins.into_iter().try_for_each(check_position)?;
    Ok(origins)
}

/// Refuses positions that no sensor measures.
fn check_position(position: Position) -> Result<(), ReagentStatus> {
    let is_measured = |x: &f64| x.abs() <= f64::from(LARGEST_COORDINATE);
    match position.iter().all(is_measured) {
        true => Ok(()),
        false => Err(ReagentStatus::NotFinite),
    }
}

fn far(rows: Rows, origins: [Position; 2]) -> Rows {
    moved(orthonormal(rows), origins)
}

/// `R (x - source) + t + target` as rows of `[R | t]`.
fn moved(rows: Rows, [source, target]: [Position; 2]) -> Rows {
    let mut moved = rows;
    for (row, to) in moved.iter_mut().zip(target) {
        let [a, b, c, t] = *row;
        let [x, y, z] = source;
        *row = [a, b, c, t + to - (a * x + b * y + c * z)];
    }
    moved
}

/// An f32 rotation is orthonormal to seven digits; one step of Newton's method towards the nearest one, `R (3 - RᵀR) / 2`,
/// gives all digits.
fn orthonormal([a, b, c]: Rows) -> Rows {
    let rows = [a, b, c];
    let column = |j: usize| rows.map(|row| row.get(j).copied().unwrap_or(0.0));
    let dot = |u: Position, v: Position| -> f64 { u.iter().zip(v).map(|(x, y)| x * y).sum() };
    rows.map(|[x, y, z, t]| {
        let step = |k: usize, own: f64| {
            let by = [0, 1, 2].map(|j| dot(column(j), column(k)));
            1.5 * own - 0.5 * dot([x, y, z], by)
        };
        [step(0, x), step(1, y), step(2, z), t]
    })
}
