//! What is known besides both clouds: the view point, the background, and which way the target's surface faces.

use super::{Refiner, Work};
use glam::Vec3;

impl Refiner<'_> {
    /// States from where the source was seen, in the source's frame. What would stand in front of what was seen then counts
    /// against a pose; what is hidden does not.
    pub fn seen_from(&mut self, view_point: Vec3) {
        self.seen_before(view_point, &[]);
    }

    /// As [`Self::seen_from`], with what else was seen: `background [B, 3]` in the source's frame, such as the other pixels of
    /// a depth image. What would stand in front of it counts against a pose as well. Only an image of twice the source's width
    /// is looked at: points outside it are ignored, and so are points that are not finite.
    pub fn seen_before(&mut self, view_point: Vec3, background: &[[f32; 3]]) {
        let (centre, factor) = (self.source_centre, 1.0 / self.model.frame.scale);
        let inside = |point: Vec3| (point - centre) * factor;
        let around = background.iter().map(|&p| inside(Vec3::from_array(p)));
        let Work { source, seen, .. } = &mut *self.work;
        seen.fill(source, inside(view_point), around);
    }

    /// States which way the target's surface faces: `outward [M, 3]` at its points, in their order.
    /// What faces away from the sensor ([`Refiner::seen_from`]) was not seen, nor what is inside of the target
    /// ([`crate::pipeline::INSIDE`]), and the source is matched only with the rest, unless the sensor stands within
    /// the target's radius. A point without a valid direction is unknown, as is all of a target of more than
    /// [`crate::dims::SURFACE_POINTS`] points.
    pub fn faces(&mut self, outward: &[[f32; 3]]) {
        self.work.facing.fill(self.model, outward);
    }

    /// The cell of the image, by number, if a background point is the nearest one seen there. One such point for each cell
    /// tells as much as the whole background.
    pub fn nearest_in_cell(&self, of_background: Vec3) -> Option<usize> {
        let factor = 1.0 / self.model.frame.scale;
        let point = (of_background - self.source_centre) * factor;
        self.work.seen.nearest_in(point)
    }

    /// Whether it is known what was seen besides the source.
    pub(crate) fn knows_background(&self) -> bool {
        self.work.seen.shows_background()
    }

    /// Direction in which the sensor looks, in the source's frame.
    pub(crate) fn ahead(&self) -> Option<Vec3> {
        self.work.seen.ahead()
    }
}
