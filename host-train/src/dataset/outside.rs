//! What of a mesh can be seen from outside. A depth camera sees neither the inner side of a housing nor what is in it.

use super::Point;
use super::mesh::Mesh;
use super::raster::Pinhole;
use crate::random::Rng;
use crate::threads::on_all_threads;
use glam::{Affine3A, Mat3, Vec2, Vec3};

/// Directions from which a mesh is looked at; a hole that is five times as deep as wide may be missed by all.
const DIRECTIONS: usize = 100;
/// Pixels of an image across the mesh's bounding sphere, and beside it.
const ACROSS: f32 = 156.0;
const BESIDE: f32 = 2.0;
/// Distance of the camera from the mesh's centre, in its radii.
const DISTANCE: f32 = 8.0;
/// A surface that is seen at a smaller cosine is not judged: in a pixel, its depth differs too much.
const LEAST_COSINE: f32 = 0.35;
/// Differences of depth, in pixels, that say nothing: at a cosine of 1, and for each unit of the slope.
const TOLERANCE: [f32; 2] = [0.3, 1.2];

/// Depth images of a mesh from all around.
#[derive(Clone, Debug)]
pub struct Outside {
    camera: Pinhole,
    views: Vec<DepthView>,
}

#[derive(Clone, Debug)]
struct DepthView {
    eye: Vec3,
    camera_from_mesh: Affine3A,
    inverse_depths: Vec<f32>,
}

impl Outside {
    /// Looks at a mesh; `None` if it has no extent.
    pub fn of(mesh: &Mesh) -> Option<Outside> {
        let used = mesh.faces.iter().filter_map(|&face| mesh.corners(face));
        let corners = || used.clone().flatten();
        let [low, high] = [Vec3::min, Vec3::max].map(|f| corners().reduce(f));
        let centre = (low? + high?) / 2.0;
        let radius = corners().map(|v| v.distance(centre)).fold(0.0, f32::max);
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let pixels = ACROSS + 2.0 * BESIDE;
        let camera = Pinhole {
            size: [pixels as usize; 2],
            focal: Vec2::splat(0.5 * ACROSS * (DISTANCE * DISTANCE - 1.0).sqrt()),
            centre: Vec2::splat(0.5 * (pixels - 1.0)),
        };
        let views = on_all_threads(DIRECTIONS, |k| {
            let ahead = direction(k);
            let (right, down) = ahead.any_orthonormal_pair();
            let turn = Mat3::from_cols(right, down, ahead).transpose() * (1.0 / radius);
            let place = DISTANCE * Vec3::Z - turn * centre;
            let camera_from_mesh = Affine3A::from_mat3_translation(turn, place);
            DepthView {
                eye: centre - DISTANCE * radius * ahead,
                camera_from_mesh,
                inverse_depths: camera.inverse_depths(mesh, &camera_from_mesh),
            }
        });
        Some(Outside { views, camera })
    }

    /// Which sides of a piece of surface can be seen from outside: the one that its unit normal points to, and the other.
    pub fn sees(&self, point: Vec3, normal: Vec3) -> [bool; 2] {
        let pixel_size = DISTANCE / self.camera.focal.x;
        let [flat, steep] = TOLERANCE.map(|pixels| pixels * pixel_size);
        let mut sides = [false; 2];
        for view in &self.views {
            let towards = view.eye - point;
            let along = towards.dot(normal);
            let side = &mut sides[usize::from(along < 0.0)];
            if *side {
                continue;
            }
            let cosine = along / towards.length();
            if cosine.is_nan() || cosine.abs() < LEAST_COSINE {
                continue;
            }
            let at = view.camera_from_mesh.transform_point3(point);
            // Nothing may hide it at any of the four pixels around it: the centre of one may lie beyond an edge.
            let pixel = self.camera.project(at);
            let first = pixel.y as usize * self.camera.size[0] + pixel.x as usize;
            let around = [0, 1].map(|row| first + row * self.camera.size[0]);
            let pixels = around.map(|at| view.inverse_depths.get(at..at + 2).unwrap_or_default());
            let nearest = pixels
                .iter()
                .copied()
                .flatten()
                .fold(0.0f32, |a, b| a.max(*b));
            let slope = (1.0 - cosine * cosine).sqrt() / cosine.abs();
            *side = (at.z - (flat + steep * slope)) * nearest <= 1.0;
        }
        sides
    }
}

/// Smallest share of a mesh that must be seen from outside for the rest to be left out.
const LEAST_SEEN: f32 = 0.1;

impl Mesh {
    /// As [`Mesh::sample`], but only of what can be seen from outside, if that is a tenth or more.
    pub fn sample_outside(&self, count: usize, rng: &mut Rng) -> Vec<Point> {
        let outside = Outside::of(self);
        let is_seen = |&(point, normal): &(Point, Point)| {
            let sees = |outside: &Outside| outside.sees(point.into(), normal.into());
            outside.as_ref().is_some_and(|o| sees(o) != [false; 2])
        };
        let mut points: Vec<Point> = Vec::with_capacity(count);
        loop {
            let drawn = self.sample_with_normals(count, rng);
            let seen = drawn.iter().filter(|drawn| is_seen(drawn));
            let before = points.len();
            points.extend(seen.map(|(point, _)| point).take(count - before));
            if points.len() == count {
                return points;
            }
            if ((points.len() - before) as f32) < LEAST_SEEN * count as f32 {
                return drawn.into_iter().map(|(point, _)| point).collect();
            }
        }
    }
}

/// Direction number `k` of [`DIRECTIONS`] that are spread evenly, on a spiral by the golden angle.
fn direction(k: usize) -> Vec3 {
    const GOLDEN_ANGLE: f32 = 2.399_963;
    let z = 1.0 - (2 * k + 1) as f32 / DIRECTIONS as f32;
    let (sin, cos) = (k as f32 * GOLDEN_ANGLE).sin_cos();
    let across = (1.0 - z * z).sqrt();
    Vec3::new(across * cos, across * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::winding::tests::block;
    use crate::random::{Purpose, stream};

    fn joined(meshes: impl IntoIterator<Item = Mesh>) -> Mesh {
        let mut all = Mesh::default();
        for mesh in meshes {
            let first = all.vertices.len() as u32;
            all.vertices.extend(mesh.vertices);
            let faces = mesh.faces.into_iter();
            all.faces.extend(faces.map(|face| face.map(|i| first + i)));
        }
        all
    }

    /// What is seen of points drawn from a mesh.
    fn seen(mesh: &Mesh, outside: &Outside) -> Vec<(Vec3, Vec3, [bool; 2])> {
        let drawn = mesh.sample_with_normals(500, &mut stream(1, Purpose::Surface, 0));
        let drawn = drawn.into_iter();
        let drawn = drawn.map(|(point, normal)| (Vec3::from(point), Vec3::from(normal)));
        drawn
            .map(|(point, normal)| (point, normal, outside.sees(point, normal)))
            .collect()
    }

    #[test]
    fn what_is_in_a_housing_is_not_seen() {
        let size = Vec3::new(3.0, 2.0, 1.0);
        let housing = block(Vec3::ZERO, size);
        for content in [
            block(Vec3::ZERO, Vec3::new(2.7, 1.7, 0.7)),
            block(Vec3::new(0.5, 0.2, 0.0), Vec3::splat(0.3)),
        ] {
            let all = joined([housing.clone(), content.clone()]);
            let outside = Outside::of(&all).expect("an extent");
            for (point, normal, sides) in seen(&content, &outside) {
                assert_eq!(sides, [false, false], "{point} {normal}");
            }
            for (point, normal, sides) in seen(&housing, &outside) {
                // At an edge, the image is too coarse to tell the inner side from the outer side beyond.
                let from_sides = (0.5 * size - point.abs()).to_array();
                let is_at_edge = from_sides.iter().filter(|&&x| x < 0.1).count() > 1;
                assert!(sides[0] && (is_at_edge || !sides[1]), "{point} {normal}");
            }
        }
    }

    #[test]
    fn sides_are_told_however_faces_are_wound_and_wherever_the_mesh_lies() {
        let middle = Vec3::new(1e3, -2e3, 5e2);
        let mut mesh = block(middle, Vec3::new(3.0, 2.0, 1.0));
        for face in mesh.faces.iter_mut().step_by(2) {
            face.swap(0, 1);
        }
        // One face is missing, another is bad, and a vertex far away is not used.
        mesh.faces.pop();
        mesh.faces.push([0, 1, 99]);
        mesh.vertices.push(Vec3::splat(1e9));
        let outside = Outside::of(&mesh).expect("an extent");
        let sides = seen(&mesh, &outside);
        for (point, normal, sides) in &sides {
            let out = usize::from(normal.dot(*point - middle) < 0.0);
            assert!(sides[out], "{point} {normal}");
        }
        // Through the hole, the inner side is seen in part.
        let both = sides.iter().filter(|(.., sides)| sides[0] && sides[1]);
        let both = both.count();
        assert!((1..450).contains(&both), "{both}");
    }

    #[test]
    fn both_sides_of_a_sheet_are_seen_and_nothing_of_no_surface() {
        let sheet = Mesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            faces: vec![[0, 1, 2]],
        };
        let outside = Outside::of(&sheet).expect("an extent");
        for (.., sides) in seen(&sheet, &outside) {
            assert_eq!(sides, [true, true]);
        }
        let point = Mesh {
            vertices: vec![Vec3::ONE; 3],
            faces: vec![[0, 1, 2]],
        };
        assert!(Outside::of(&point).is_none() && Outside::of(&Mesh::default()).is_none());
    }
}
