//! What is known besides both clouds: the view point, the background, and which way the target's surface faces.

use super::{Refiner, Work};
use crate::solve::Rigid;
use glam::Vec3;

/// A point of the target counts as seen through if something was seen behind it by more than this, in target radii.
const BEHIND: f32 = 0.1;

impl Refiner<'_> {
    /// States from where the source was seen, in the source's frame, and what else was seen there: `background [B, 3]`, such as
    /// the other pixels of a depth image, or nothing. What would stand in front of what was seen then counts against a pose; what
    /// is hidden does not. Only an image of twice the source's width is looked at: points outside it are ignored, and so are
    /// points that are not finite.
    pub fn set_sensor(&mut self, view_point: Vec3, background: &[[f32; 3]]) {
        let (centre, factor) = (self.source_centre, 1.0 / self.model.frame.scale);
        let inside = |point: Vec3| (point - centre) * factor;
        let around = background.iter().map(|&p| inside(Vec3::from_array(p)));
        let Work { source, seen, .. } = &mut *self.work;
        seen.fill(source, inside(view_point), around);
    }

    /// States which way the target's surface faces: `outward [M, 3]` at its points, in their order.
    /// What faces away from the sensor ([`Refiner::set_sensor`]) was not seen, nor what is inside of the target
    /// ([`crate::pipeline::INSIDE`]), and the source is matched only with the rest, unless the sensor stands within
    /// the target's radius. A point without a valid direction is unknown, as is all of a target of more than
    /// [`crate::dims::SURFACE_POINTS`] points.
    pub fn set_outward(&mut self, outward: &[[f32; 3]]) {
        self.work.facing.fill(self.model, outward);
    }

    /// The cell of the image, by number, if a background point is the nearest one seen there. One such point for each cell
    /// tells as much as the whole background.
    pub fn nearest_in_cell(&self, of_background: Vec3) -> Option<usize> {
        let factor = 1.0 / self.model.frame.scale;
        let point = (of_background - self.source_centre) * factor;
        self.work.seen.nearest_in(point)
    }

    /// See [`super::Refined::seen_through`]; judged by every n-th point of the target.
    #[inline(never)]
    pub(crate) fn seen_through(&mut self, at: Rigid, every: usize) -> f32 {
        let (isa, target, there) = (self.isa, &self.model.surface, at.pose());
        let Work { seen, facing, .. } = &mut *self.work;
        if !seen.shows_background() {
            return 0.0;
        }
        facing.look(isa, seen, there, target);
        let back = there.inverse();
        let [mut through, mut facing_it] = [0u32; 2];
        let places = (0..target.points().len()).step_by(every.max(1));
        for place in places.filter(|&place| !facing.is_hidden(place)) {
            let point = back.apply(target.at(place).0);
            facing_it += 1;
            through += u32::from(seen.is_seen_through(point, BEHIND));
        }
        (f64::from(through) / f64::from(facing_it.max(1))) as f32
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

#[cfg(test)]
mod tests {
    use crate::evidence::SEEN_THROUGH;
    use crate::polish::tests::Numbers;
    use crate::polish::{Refiner, Workspace};
    use crate::pose::Pose;
    use glam::Vec3;

    /// How much of a plate is seen through that fits the visible part of it, if that is so wide.
    fn seen_through(width: f32, with_table: bool) -> f32 {
        let numbers = &mut Numbers(3);
        let mut plate = |width: f32, count: usize| -> Vec<_> {
            let points = (0..count).map(|_| numbers.point());
            points
                .map(|[x, y, _]| [0.5 * width * x, 0.5 * y, 0.3])
                .collect()
        };
        let (target, source) = (plate(1.6, 900), plate(width, 700));
        let grid = (0..80 * 80).map(|i| [i % 80, i / 80].map(|k| (k as f32 - 39.5) * 0.04));
        let is_table = |&[x, y]: &[f32; 2]| x.abs() > 0.5 * width || y.abs() > 0.5;
        let table: Vec<_> = grid.filter(is_table).map(|[x, y]| [x, y, -0.3]).collect();
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("two clouds");
        let eye = Vec3::new(0.0, 0.0, 6.0);
        refiner.set_sensor(eye, if with_table { &table } else { &[] });
        let found = refiner.polish(Pose::IDENTITY).expect("a pose");
        found.seen_through
    }

    #[test]
    fn a_part_that_is_smaller_than_the_target_is_noticed_where_its_surroundings_were_seen() {
        let whole = seen_through(1.6, true);
        assert!(whole < 0.3 * SEEN_THROUGH, "{whole}");
        let part = seen_through(1.2, true);
        assert!((0.1..0.35).contains(&part), "{part}");
        assert_eq!(seen_through(1.2, false), 0.0);
    }
}
