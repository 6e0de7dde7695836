//! Points of a depth image.

use crate::pointer::{aligned, value};
use crate::status::{ReagentStatus, status};
use core::slice::{from_raw_parts, from_raw_parts_mut};

/// A pinhole camera without distortion; all in pixels.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReagentCamera {
    /// Focal length across.
    pub fx: f32,
    /// Focal length down.
    pub fy: f32,
    /// Column of the optical axis, from 0 at the first pixel's centre.
    pub cx: f32,
    /// Row of the optical axis.
    pub cy: f32,
}

impl ReagentCamera {
    fn is_sound(&self) -> bool {
        let Self { fx, fy, cx, cy } = *self;
        fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite())
    }

    /// The point that a pixel shows.
    fn point(&self, [u, v]: [usize; 2], z: f32) -> [f32; 3] {
        [
            (u as f32 - self.cx) * z / self.fx,
            (v as f32 - self.cy) * z / self.fy,
            z,
        ]
    }
}

/// Turns a depth image into points in the camera's frame (x to the right, y down, z ahead) and in the depths' unit: a source, whose
/// view point is then 0, 0, 0; or with `inside` 0 what the camera saw besides, a task's background. If more than `capacity` pixels
/// have a depth, as many of them are taken, evenly. Depths that are NaN, infinite, 0 or negative are none. `count` receives the number of
/// points.
///
/// # Safety
/// `depth` points to `width` * `height` floats, row by row; `mask` is null, for the whole image, or points to as many bytes, not 0
/// where the image shows the object; `camera` points to a camera, `points` to room for 3 * `capacity` floats, `count` to a size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn reagent_points_of_depth(
    depth: *const f32,
    width: usize,
    height: usize,
    camera: *const ReagentCamera,
    mask: *const u8,
    inside: u32,
    points: *mut f32,
    capacity: usize,
    count: *mut usize,
) -> ReagentStatus {
    let pixels = width.checked_mul(height);
    let bytes = pixels.and_then(|pixels| pixels.checked_mul(size_of::<f32>()));
    let room = capacity.checked_mul(size_of::<[f32; 3]>());
    let fit = [bytes, room]
        .iter()
        .all(|bytes| bytes.is_some_and(|bytes| bytes <= isize::MAX as usize));
    let (Some(pixels), true) = (pixels, fit) else {
        return ReagentStatus::BadCamera;
    };
    if !(aligned(depth) && aligned(points) && aligned(count)) {
        return ReagentStatus::Pointer;
    }
    // SAFETY: the caller's promise; the pointer is aligned and not null, and its size fits the address space.
    let depth = unsafe { from_raw_parts(depth, pixels) };
    // SAFETY: the same; bytes need no alignment.
    let mask = (!mask.is_null()).then(|| unsafe { from_raw_parts(mask, pixels) });
    // SAFETY: the same.
    let points = unsafe { from_raw_parts_mut(points.cast::<[f32; 3]>(), capacity) };
    let mut fill = || {
        // SAFETY: the caller's promise.
        let camera = unsafe { value(camera) }?;
        if !camera.is_sound() || pixels == 0 {
            return Err(ReagentStatus::BadCamera);
        }
        let is_taken = |at: usize| {
            mask.is_none_or(|mask| mask.get(at).is_some_and(|&m| (m != 0) == (inside != 0)))
        };
        let seen = || {
            let all = depth.iter().enumerate();
            all.filter(|&(at, &z)| z > 0.0 && z.is_finite() && is_taken(at))
        };
        let all = seen().count();
        let of_all = capacity.min(all);
        let upto = |k: usize| (k as u64 * of_all as u64 / all.max(1) as u64) as usize;
        let chosen = seen().enumerate().filter(|&(k, _)| upto(k) < upto(k + 1));
        for (place, (_, (at, &z))) in points.iter_mut().zip(chosen) {
            let [u, v] =
                [at.checked_rem(width), at.checked_div(width)].map(Option::unwrap_or_default);
            *place = camera.point([u, v], z);
        }
        Ok(of_all)
    };
    status(fill().map(|found| {
        // SAFETY: the caller's promise; it was checked.
        unsafe { count.write(found) };
    }))
}
