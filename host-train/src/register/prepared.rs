//! A cloud prepared for registration: near the origin, and within the policy's capacity.

use crate::dataset::Point;
use crate::dataset::cloud_file::{
    CloudError, CloudFile, MAX_COORDINATE, MESH_POINTS, Note, origin_of,
};
use crate::pose64::Position;
use crate::random::{Purpose, stream};
use crate::register::dense::{DENSE_POINTS, Planes};
use crate::register::surface::{Surface, is_seen};
use crate::register::thin::thin;
use crate::register::within_capacity;
use glam::Vec3;
use reagent_core::dims::MAX_POINTS;
use reagent_core::frame::check_cloud;
use reagent_core::{Error, Frame};
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// One of the two clouds. Copies share what a mesh tells.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared<'a> {
    /// The point that the coordinates below are relative to.
    pub origin: Position,
    /// Points for the last refinement, at most [`DENSE_POINTS`]; a mesh's are drawn from its surface.
    pub all: Cow<'a, [Point]>,
    /// The points that the policy sees, where it sees only a part.
    thinned: Option<Vec<Point>>,
    /// The faces from which the points were drawn.
    surface: Option<Arc<Surface>>,
    /// [`Prepared::outward`], once it is asked for.
    outward: Arc<OnceLock<Vec<Point>>>,
    /// What the sensor saw besides a source with a known view point; otherwise empty.
    pub background: Vec<Point>,
    /// What the reader noticed, and what was done to the points.
    pub notes: Vec<Note>,
}

impl<'a> Prepared<'a> {
    /// Prepares a checked file. The policy sees `count` points, or as many as its capacity suggests. The seed
    /// decides which points of a mesh's surface are drawn. Errors name `path`.
    ///
    /// # Errors
    /// A mesh without area, and clouds that the core refuses.
    pub fn of_file(
        file: &CloudFile,
        path: &Path,
        count: Option<usize>,
        seed: u64,
    ) -> Result<Prepared<'static>, CloudError> {
        let origin = file.origin();
        let notes = file.notes.clone();
        if file.faces.is_none() {
            let all = Cow::Owned(file.relative_to(origin));
            return Prepared::new(origin, all, path, count, (None, notes));
        }
        let rng = &mut stream(seed, Purpose::Surface, 0);
        let surface = file.clone().sampled(DENSE_POINTS, rng);
        let surface = surface.ok_or_else(|| CloudError::NoArea { path: path.into() })?;
        let all = surface.relative_to(origin);
        let mesh = file.mesh_relative_to(origin);
        let faces = Surface::new(mesh, surface.normals.unwrap_or_default());
        Prepared::new(origin, Cow::Owned(all), path, count, (Some(faces), notes))
    }

    /// Prepares points in memory, as those of a file with a plain cloud. Errors name `path`.
    ///
    /// # Errors
    /// No valid points, and clouds that the core refuses.
    pub fn of_positions(
        points: Vec<Position>,
        path: &Path,
        count: Option<usize>,
    ) -> Result<Prepared<'static>, CloudError> {
        let file = CloudFile {
            points,
            ..CloudFile::default()
        };
        Prepared::of_file(&file.checked(path)?, path, count, 0)
    }

    /// The same for f32 points, which are borrowed if all are valid and near the origin.
    ///
    /// # Errors
    /// As [`Prepared::of_positions`].
    pub fn of_points(
        points: &'a [Point],
        path: &Path,
        count: Option<usize>,
    ) -> Result<Prepared<'a>, CloudError> {
        let wide = || points.iter().map(|p| p.map(f64::from));
        let valid = |p: Position| p.iter().all(|x| x.abs() <= MAX_COORDINATE);
        let as_they_lie = !points.is_empty() && wide().all(valid) && origin_of(wide()) == [0.0; 3];
        if as_they_lie {
            let all = Cow::Borrowed(points);
            Prepared::new([0.0; 3], all, path, count, (None, Vec::new()))
        } else {
            Prepared::of_positions(wide().collect(), path, count)
        }
    }

    fn new(
        origin: Position,
        all: Cow<'a, [Point]>,
        path: &Path,
        count: Option<usize>,
        (surface, mut notes): (Option<Surface>, Vec<Note>),
    ) -> Result<Prepared<'a>, CloudError> {
        if all.len() > 1 && all.iter().all(|point| point == &all[0]) {
            return Err(CloudError::NoExtent { path: path.into() });
        }
        let count_read = all.len();
        let all = match count_read > DENSE_POINTS {
            true => Cow::Owned(thin(&all, DENSE_POINTS)),
            false => all,
        };
        let thinned = match count.or(surface.as_ref().map(|_| MESH_POINTS)) {
            Some(count) if count < all.len() => Some(thin(&all, count)),
            None if all.len() > MAX_POINTS => Some(within_capacity(&all)),
            _ => None,
        };
        if origin != [0.0; 3] {
            notes.push(Note::Shifted { origin });
        }
        if let Some(thinned) = thinned.as_ref().filter(|_| surface.is_none()) {
            notes.push(Note::Thinned {
                from: count_read,
                to: thinned.len(),
            });
        }
        let prepared = Prepared {
            origin,
            all,
            thinned,
            surface: surface.map(Arc::new),
            outward: Arc::default(),
            background: Vec::new(),
            notes,
        };
        check_cloud(prepared.points()).map_err(|source| CloudError::Refused {
            path: path.into(),
            source,
        })?;
        Ok(prepared)
    }

    /// Whether its points were drawn from the faces of a mesh.
    pub fn has_faces(&self) -> bool {
        self.surface.is_some()
    }

    /// Notes that the target of a view has no faces, if its points were not drawn from any.
    pub fn notice_missing_faces(&mut self) {
        if !self.has_faces() {
            self.notes.push(Note::NoFaces);
        }
    }

    /// Takes in what the sensor saw besides, in the cloud's units before scaling.
    pub fn see(&mut self, background: &[Point], scale: f64) {
        let near = |p: &Point| [0, 1, 2].map(|k| (f64::from(p[k]) * scale - self.origin[k]) as f32);
        self.background = background.iter().map(near).collect();
    }

    /// The points that the policy sees.
    pub fn points(&self) -> &[Point] {
        self.thinned.as_deref().unwrap_or(&self.all)
    }

    /// What a mesh tells of the points that the policy sees, in their order: outward surface normals,
    /// [`INSIDE`](reagent_core::pipeline::INSIDE) where nothing outside can see them, and NaN where both sides can be
    /// seen. Empty if nothing is told.
    pub fn outward(&self) -> &[Point] {
        self.outward.get_or_init(|| self.outward_at(self.points()))
    }

    /// The same at some of the points that the policy sees, in any order.
    pub fn outward_at(&self, points: &[Point]) -> Vec<Point> {
        let bits = |p: &Point| p.map(f32::to_bits);
        let outward = self.all.iter().map(bits).zip(self.all_outward());
        let outward: HashMap<_, _> = outward.collect();
        let told = points.iter().map(bits);
        told.filter_map(|p| outward.get(&p).copied().copied())
            .collect()
    }

    fn all_outward(&self) -> &[Point] {
        let surface = self.surface.as_ref();
        surface.map_or(&[], |surface| surface.outward(&self.all))
    }

    /// The points for the last refinement that a sensor at `eye` may see. It sees all if it stands within the radius, and so does
    /// none.
    ///
    /// # Errors
    /// A cloud without extent.
    pub fn all_seen_from(&self, eye: Option<Vec3>) -> Result<Planes<'_>, Error> {
        let normals = self.surface.as_ref().map_or(&[][..], |s| s.normals());
        Ok(match self.seen_from(eye)? {
            Some(seen) => {
                let (points, normals): (Vec<_>, _) =
                    seen.map(|k| (self.all[k], normals[k])).unzip();
                Planes {
                    points: Cow::Owned(points),
                    normals: Cow::Owned(normals),
                }
            }
            None => Planes {
                points: Cow::Borrowed(&*self.all),
                normals: Cow::Borrowed(normals),
            },
        })
    }

    /// Which of the points a sensor may see; `None` for all.
    fn seen_from(
        &self,
        eye: Option<Vec3>,
    ) -> Result<Option<impl Iterator<Item = usize> + '_>, Error> {
        let Frame { centre, scale } = Frame::of(self.points())?;
        let outside = eye.filter(|eye| eye.distance(centre) > scale);
        let outward = outside.map_or(&[][..], |_| self.all_outward());
        Ok(outside.filter(|_| !outward.is_empty()).map(|eye| {
            let all = self.all.iter().zip(outward).enumerate();
            all.filter(move |&(_, (&point, &outward))| is_seen(point, outward, eye))
                .map(|(k, _)| k)
        }))
    }

    /// Whether the policy sees only a part of the points.
    pub fn is_thinned(&self) -> bool {
        self.thinned.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::winding::tests::block;

    fn cloud(count: usize, shift: f32) -> Vec<Point> {
        let point = |i: usize| [shift + i as f32 * 1e-3, (i % 7) as f32, (i % 11) as f32];
        (0..count).map(point).collect()
    }

    fn name() -> &'static Path {
        Path::new("source")
    }

    #[test]
    fn points_in_memory_are_as_those_of_a_file() {
        for (points, borrowed) in [
            (cloud(300, 0.0), true),
            (cloud(300, 9e3), false),
            (cloud(5000, 0.0), true),
            (
                [cloud(300, 0.0), vec![[f32::NAN; 3], [2e30; 3]]].concat(),
                false,
            ),
        ] {
            let prepared = Prepared::of_points(&points, name(), None).expect("a cloud");
            assert_eq!(matches!(prepared.all, Cow::Borrowed(_)), borrowed);
            let file = CloudFile::of(&points).checked(name()).expect("a cloud");
            assert_eq!(
                Ok(prepared),
                Prepared::of_file(&file, name(), None, 1).map_err(|_| ())
            );
        }
    }

    #[test]
    fn a_solid_tells_which_way_its_surface_faces() {
        let middle = [1e5, 7.0, 0.0];
        let mesh = block(middle.into(), Vec3::splat(4.0));
        let vertices: Vec<Point> = mesh.vertices.iter().map(|v| v.to_array()).collect();
        let file = CloudFile {
            faces: Some(mesh.faces),
            ..CloudFile::of(&vertices)
        };
        for count in [None, Some(300)] {
            let prepared = Prepared::of_file(&file, name(), count, 1).expect("a mesh");
            let near = |k: usize| (f64::from(middle[k]) - prepared.origin[k]) as f32;
            let middle = Vec3::from([0, 1, 2].map(near));
            let outward = prepared.outward();
            assert_eq!(outward.len(), prepared.points().len());
            for (p, outward) in prepared.points().iter().zip(outward) {
                let height = (Vec3::from(*p) - middle).dot(Vec3::from(*outward));
                assert!((height - 2.0).abs() < 1e-3, "{height}");
            }
        }
        let cloud = Prepared::of_points(&vertices, name(), None).expect("a cloud");
        assert_eq!(cloud.outward(), [[0.0; 3]; 0]);
    }

    #[test]
    fn what_cannot_be_registered_is_refused_by_name() {
        let said = |points: &[Point]| {
            let refused = Prepared::of_points(points, name(), None).expect_err("refused");
            refused.to_string()
        };
        assert_eq!(said(&[]), "source: no points");
        for invalid in [f32::NAN, 1e20] {
            assert_eq!(
                said(&[[invalid; 3]; 4]),
                "source: no points but 4 invalid ones (NaN, infinite or beyond 1e12)"
            );
        }
        assert!(said(&[[1.0; 3]; 9]).starts_with("source: all points coincide"));
        assert!(said(&cloud(2, 0.0)).starts_with("source: the cloud has 2 points;"));
    }
}
