//! Free space: nothing stands between the sensor and what it saw, be that the object or the background.

use crate::surface::Surface;
use glam::{Mat3, Vec3};

/// Cells along each axis of the image.
const CELLS: usize = 48;

/// Nearest depths, seen from one point in the cells of a pinhole image, of a cloud and of its background if that is known.
#[derive(Clone, Debug)]
pub(crate) struct DepthGrid {
    known: bool,
    /// Whether something was seen besides the object.
    shows_background: bool,
    eye: Vec3,
    /// Rotation into the camera's frame; its rows are right, down, forward.
    camera: Mat3,
    low: [f32; 2],
    cells_per_unit: f32,
    /// A point in front of a cell's depth by less than this is noise or sampling.
    margin: f32,
    depth: [[f32; CELLS]; CELLS],
}

impl DepthGrid {
    /// Nothing seen. All bits are zero.
    pub(crate) const EMPTY: DepthGrid = DepthGrid {
        known: false,
        shows_background: false,
        eye: Vec3::ZERO,
        camera: Mat3::ZERO,
        low: [0.0; 2],
        cells_per_unit: 0.0,
        margin: 0.0,
        depth: [[0.0; CELLS]; CELLS],
    };

    /// Whether a view point was given.
    pub(crate) fn is_known(&self) -> bool {
        self.known
    }

    /// Whether the image shows what else was seen, besides the object.
    pub(crate) fn shows_background(&self) -> bool {
        self.shows_background
    }

    /// Where the sensor stood.
    pub(crate) fn eye(&self) -> Option<Vec3> {
        self.known.then_some(self.eye)
    }

    /// Direction in which the sensor looks.
    pub(crate) fn ahead(&self) -> Option<Vec3> {
        self.known.then_some(self.camera.transpose().z_axis)
    }

    /// Takes in a surface seen from `eye`, and the part of what else was seen that lies around it in the image, all in the
    /// surface's frame. A view point within the cloud is ignored.
    pub(crate) fn fill(
        &mut self,
        surface: &Surface,
        eye: Vec3,
        around: impl ExactSizeIterator<Item = Vec3>,
    ) {
        *self = DepthGrid::EMPTY;
        let ahead = (crate::pose::centroid(surface.points()) - eye).normalize_or_zero();
        if ahead == Vec3::ZERO {
            return;
        }
        let (right, down) = ahead.any_orthonormal_pair();
        self.eye = eye;
        self.camera = Mat3::from_cols(right, down, ahead).transpose();
        self.margin = MARGIN * surface.radius;
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for &point in surface.points() {
            let Some((at, _)) = self.project(Vec3::from_array(point)) else {
                return;
            };
            for ((low, high), x) in low.iter_mut().zip(&mut high).zip(at) {
                *low = low.min(x);
                *high = high.max(x);
            }
        }
        let [x, y] = [0, 1].map(|a: usize| {
            high.get(a).copied().unwrap_or(0.0) - low.get(a).copied().unwrap_or(0.0)
        });
        // A cell holds a point or two, so that gaps between points are no background.
        let cells = (libm::sqrtf(surface.points().len() as f32) * 0.7).clamp(4.0, CELLS as f32);
        self.shows_background = around.len() > 0;
        let (wide, cells) = if self.shows_background {
            (WIDER, CELLS as f32)
        } else {
            (1.0, cells)
        };
        let size = x.max(y).max(1e-6);
        self.low = low.map(|low| low - 0.5 * (wide - 1.0) * size);
        self.cells_per_unit = (cells - 0.001) / (wide * size);
        for &point in surface.points() {
            self.take(Vec3::from_array(point));
        }
        for point in around {
            self.take(point);
        }
        self.known = true;
    }

    /// Takes in one point that was seen.
    fn take(&mut self, point: Vec3) {
        if let Some((at, depth)) = self.project(point)
            && let Some((x, y)) = self.cell(at)
            && let Some(held) = self.depth.get_mut(y).and_then(|row| row.get_mut(x))
        {
            // A cell keeps its nearest depth, so that an edge does not count against a pose.
            *held = if *held > 0.0 { held.min(depth) } else { depth };
        }
    }

    /// Negates x.
    pub(crate) fn mirror(&mut self) {
        self.eye.x = -self.eye.x;
        self.camera.x_axis = -self.camera.x_axis;
    }

    /// Whether a point would have hidden something that was seen.
    pub(crate) fn hides(&self, point: Vec3) -> bool {
        let Some((at, depth)) = self.project(point) else {
            return false;
        };
        let seen = self.cell(at).and_then(|cell| self.seen_in(cell));
        seen.is_some_and(|seen| depth < seen - self.margin)
    }

    /// Whether something was seen behind a point by more than `margin`, there and in the cells around: sensors see little at edges,
    /// and masks end beside them.
    pub(crate) fn is_seen_through(&self, point: Vec3, margin: f32) -> bool {
        let Some((at, depth)) = self.project(point) else {
            return false;
        };
        let Some((x, y)) = self.cell(at) else {
            return false;
        };
        let around = |of: usize| of.saturating_sub(1)..of + 2;
        let mut cells = around(y).flat_map(|y| around(x).map(move |x| (x, y)));
        let is_behind = |cell| self.seen_in(cell).is_none_or(|seen| depth < seen - margin);
        self.seen_in((x, y)).is_some() && cells.all(is_behind)
    }

    /// The nearest depth seen in a cell; `None` if nothing was.
    fn seen_in(&self, (x, y): (usize, usize)) -> Option<f32> {
        let seen = *self.depth.get(y)?.get(x)?;
        (seen > 0.0).then_some(seen)
    }

    /// The cell of a point, by number, if the point is the nearest one seen there.
    pub(crate) fn nearest_in(&self, point: Vec3) -> Option<usize> {
        let (at, depth) = self.project(point)?;
        let (x, y) = self.cell(at)?;
        let held = self.seen_in((x, y))?;
        (depth == held).then_some(y * CELLS + x)
    }

    fn project(&self, point: Vec3) -> Option<([f32; 2], f32)> {
        let [x, y, z] = (self.camera * (point - self.eye)).to_array();
        (z > 1e-3).then(|| ([x / z, y / z], z))
    }

    fn cell(&self, at: [f32; 2]) -> Option<(usize, usize)> {
        let [x, y] = [0, 1].map(|a: usize| {
            let (at, low) = (at.get(a).copied(), self.low.get(a).copied());
            (at.unwrap_or(-1.0) - low.unwrap_or(0.0)) * self.cells_per_unit
        });
        (x >= 0.0 && y >= 0.0 && x < CELLS as f32 && y < CELLS as f32)
            .then_some((x as usize, y as usize))
    }
}

/// Width of the image in widths of the object, if the background is known.
const WIDER: f32 = 2.0;
/// See [`DepthGrid::margin`], in neighbourhood radii.
const MARGIN: f32 = 0.6;
