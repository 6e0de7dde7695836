//! Boxes around runs and blocks of a surface's points.

use super::Surface;
use crate::cells::bounds;
use crate::kernels::{BLOCK, Boxed, Corners, RUN};
use glam::Vec3;

impl Surface {
    /// The points with their boxes.
    pub(crate) fn boxed(&self) -> Boxed<'_> {
        Boxed {
            points: (&self.points, self.len),
            runs: &self.runs,
            blocks: &self.blocks,
            hidden: None,
        }
    }

    /// Computes the boxes.
    pub(super) fn enclose(&mut self) {
        let points = self.points.get(..self.len).unwrap_or(&[]);
        for (place, run) in self.runs.iter_mut().zip(points.chunks(RUN)) {
            *place = corners(run);
        }
        for (block, points) in points.chunks(BLOCK).enumerate() {
            let [low, high] = corners(points);
            for (rows, corner) in [(&mut self.blocks.low, low), (&mut self.blocks.high, high)] {
                for (rows, x) in rows.iter_mut().zip(corner) {
                    if let Some(place) = rows.as_flattened_mut().get_mut(block) {
                        *place = x;
                    }
                }
            }
        }
    }

    /// Negates x of the boxes.
    pub(super) fn mirror_boxes(&mut self) {
        let ([low, _, _], [high, _, _]) = (&mut self.blocks.low, &mut self.blocks.high);
        let rows = low.as_flattened_mut().iter_mut();
        for (low, high) in rows.zip(high.as_flattened_mut()) {
            (*low, *high) = (-*high, -*low);
        }
        for [[low, _, _], [high, _, _]] in &mut self.runs {
            (*low, *high) = (-*high, -*low);
        }
    }
}

fn corners(points: &[[f32; 3]]) -> Corners {
    bounds(points, |&p| Vec3::from_array(p)).map(|corner| corner.to_array())
}
