//! A target prepared once for many registrations: its surface with normals, a lookup of near points, its frame and size.

use crate::dims::SURFACE_POINTS;
use crate::error::Error;
use crate::frame::{Frame, check_cloud};
use crate::kernels::Isa;
use crate::nearest::Lookup;
use crate::surface::Surface;
use crate::surface::keys::Keys;
use core::fmt;
use glam::Vec3;

/// A prepared target ([`crate::polish::Workspace::prepare`]).
#[derive(Clone)]
pub struct Model {
    /// The cloud as given, to recognise it; empty if it has more points than fit.
    cloud: [[f32; 3]; SURFACE_POINTS],
    points: usize,
    pub(crate) surface: Surface,
    pub(crate) lookup: Lookup,
    /// Frame of everything in the model: the target's own.
    pub(crate) frame: Frame,
    /// [`Surface::extent`].
    pub(crate) extent: f32,
}

impl Model {
    /// A model of no target. All bits are zero, so that a static one takes no room in a program's file.
    pub const fn new() -> Model {
        Model {
            cloud: [[0.0; 3]; SURFACE_POINTS],
            points: 0,
            surface: Surface::EMPTY,
            lookup: Lookup::EMPTY,
            frame: Frame {
                centre: Vec3::ZERO,
                scale: 0.0,
            },
            extent: 0.0,
        }
    }

    /// Whether the model was made of exactly this target, to the bit; never if that has more than [`SURFACE_POINTS`] points.
    pub fn is_of(&self, target: &[[f32; 3]]) -> bool {
        let bits = bytemuck::cast_slice::<[f32; 3], u32>;
        let cloud = self.cloud.get(..self.points).unwrap_or(&[]);
        self.points > 0 && self.points == target.len() && bits(cloud) == bits(target)
    }

    /// The points as given, in the model's frame.
    pub(crate) fn inside(&self) -> impl ExactSizeIterator<Item = [f32; 3]> {
        let Frame { centre, scale } = self.frame;
        let cloud = self.cloud.get(..self.points).unwrap_or(&[]);
        let inside = move |&p: &[f32; 3]| (Vec3::from_array(p) - centre) * (1.0 / scale);
        cloud.iter().map(move |p| inside(p).to_array())
    }

    /// Prepares a target, unless it is prepared already.
    ///
    /// # Errors
    /// As [`check_cloud`] and [`Frame::of`]; the model then has no target.
    pub(crate) fn prepare(
        &mut self,
        isa: Isa,
        target: &[[f32; 3]],
        keys: &mut Keys,
    ) -> Result<(), Error> {
        if self.is_of(target) {
            return Ok(());
        }
        self.points = 0;
        check_cloud(target)?;
        let bulk = keys.bulk(target);
        self.frame = Frame::of_points(bulk.kept(target))?;
        let Frame { centre, scale } = self.frame;
        self.surface
            .fill(isa, target, bulk, centre, 1.0 / scale, keys);
        self.lookup.fill(isa, &self.surface);
        self.extent = self.surface.extent(keys);
        if let Some(cloud) = self.cloud.get_mut(..target.len()) {
            cloud.copy_from_slice(target);
            self.points = target.len();
        }
        Ok(())
    }
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let points = self.surface.points().len();
        f.debug_struct("Model").field("points", &points).finish()
    }
}

impl Default for Model {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::Workspace;
    use crate::polish::tests::part;

    #[test]
    fn a_model_is_of_the_target_it_was_made_of_and_of_no_other() {
        let (mut model, mut workspace) = (Box::new(Model::new()), Box::new(Workspace::new()));
        let target = part(500, 1);
        assert!(!model.is_of(&target) && !model.is_of(&[]));
        workspace.prepare(&target, &mut model).expect("a cloud");
        assert!(model.is_of(&target));
        let mut other = target.clone();
        other[499][2] += 1e-6;
        assert!(!model.is_of(&other) && !model.is_of(&target[..499]) && !model.is_of(&[]));
    }

    #[test]
    fn a_model_of_what_is_refused_is_of_nothing() {
        let (mut model, mut workspace) = (Box::new(Model::new()), Box::new(Workspace::new()));
        let target = part(500, 1);
        workspace.prepare(&target, &mut model).expect("a cloud");
        let one_place = [[1.0; 3]; 500];
        assert!(workspace.prepare(&one_place, &mut model).is_err());
        assert!(!model.is_of(&target) && !model.is_of(&one_place));
        let many = part(SURFACE_POINTS + 1, 2);
        workspace.prepare(&many, &mut model).expect("a cloud");
        assert!(!model.is_of(&many));
    }
}
