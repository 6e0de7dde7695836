//! Triangle meshes, and points sampled evenly from their surface.

use super::Point;
use crate::random::Rng;
use glam::Vec3;
use rand::RngExt;
use reagent_core::pose::centroid;

/// A triangle mesh. If its faces enclose a volume, [`Mesh::winding`] tells which way they are wound.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub vertices: Vec<Vec3>,
    /// Vertex indices of each triangle. Faces that name missing vertices are ignored.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of a face; `None` if a vertex does not exist.
    pub fn corners(&self, face: [u32; 3]) -> Option<[Vec3; 3]> {
        let [a, b, c] = face.map(|index| self.vertices.get(index as usize).copied());
        Some([a?, b?, c?])
    }

    /// Sum of the areas of the faces.
    pub fn area(&self) -> f64 {
        self.faces.iter().map(|&face| self.face_area(face)).sum()
    }

    /// `count` independent random points, uniform over the surface. Empty if the mesh has no area.
    pub fn sample(&self, count: usize, rng: &mut Rng) -> Vec<Point> {
        let drawn = self.sample_with_normals(count, rng).into_iter();
        drawn.map(|(point, _)| point).collect()
    }

    /// As [`Mesh::sample`], each point with the unit normal of its face, as the face is wound.
    pub fn sample_with_normals(&self, count: usize, rng: &mut Rng) -> Vec<(Point, Point)> {
        let mut total = 0.0f64;
        let areas = self.faces.iter().map(|&face| {
            total += self.face_area(face);
            total
        });
        let cumulative: Vec<f64> = areas.collect();
        if !(total > 0.0 && total.is_finite()) {
            return Vec::new();
        }
        let draw = |_| {
            let at: f64 = rng.random::<f64>() * total;
            let face = cumulative
                .partition_point(|&sum| sum <= at)
                .min(self.faces.len() - 1);
            let [a, b, c] = self.corners(self.faces[face]).unwrap_or_default();
            let (u, v): (f32, f32) = (rng.random(), rng.random());
            // A point of the unit square folded onto the triangle below its diagonal.
            let (u, v) = if u + v > 1.0 {
                (1.0 - u, 1.0 - v)
            } else {
                (u, v)
            };
            let (b, c) = (b - a, c - a);
            let normal = b.cross(c).normalize_or_zero();
            ((a + b * u + c * v).to_array(), normal.to_array())
        };
        (0..count).map(draw).collect()
    }

    fn face_area(&self, face: [u32; 3]) -> f64 {
        let Some([a, b, c]) = self.corners(face) else {
            return 0.0;
        };
        let area = 0.5 * f64::from((b - a).cross(c - a).length());
        if area.is_finite() { area } else { 0.0 }
    }
}

/// Moves the mean of `points` to the origin and scales the farthest one to distance 1. Returns the former mean and
/// greatest distance, or `None`, with the points unchanged, if all coincide.
pub fn normalise(points: &mut [Point]) -> Option<(Vec3, f32)> {
    let centre = centroid(points);
    let distance = |p: &Point| (Vec3::from_array(*p) - centre).length();
    let radius = points.iter().map(distance).fold(0.0f32, f32::max);
    if !(radius > 0.0 && radius.is_finite()) {
        return None;
    }
    for point in points {
        *point = ((Vec3::from_array(*point) - centre) / radius).to_array();
    }
    Some((centre, radius))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    /// Two triangles of areas 1 and 3 in different planes.
    fn two() -> Mesh {
        let vertices = [
            [0., 0., 0.],
            [2., 0., 0.],
            [0., 1., 0.],
            [0., 0., 5.],
            [2., 0., 5.],
            [0., 3., 5.],
        ];
        Mesh {
            vertices: vertices.map(Vec3::from_array).to_vec(),
            faces: vec![[0, 1, 2], [3, 4, 5]],
        }
    }

    #[test]
    fn points_are_spread_by_area_and_lie_on_the_faces() {
        let points = two().sample(40_000, &mut stream(1, Purpose::Shape, 0));
        let upper = points.iter().filter(|p| p[2] == 5.0).count();
        assert!((upper as f64 / 40_000.0 - 0.75).abs() < 0.01, "{upper}");
        assert!(points.iter().all(|&[x, y, z]| {
            let height = if z == 5.0 { 3.0 } else { 1.0 };
            (z == 0.0 || z == 5.0) && x >= 0.0 && y >= 0.0 && x / 2.0 + y / height <= 1.0 + 1e-5
        }));
        // The mean of even samples of a triangle is its centroid.
        let mean = centroid(
            &points
                .iter()
                .copied()
                .filter(|p| p[2] == 0.0)
                .collect::<Vec<_>>(),
        );
        assert!(
            (mean - Vec3::new(2.0 / 3.0, 1.0 / 3.0, 0.0)).length() < 0.02,
            "{mean}"
        );
    }

    #[test]
    fn bad_faces_are_ignored_and_no_area_gives_no_points() {
        let mut mesh = two();
        mesh.faces.push([0, 1, 99]);
        assert!((mesh.area() - 4.0).abs() < 1e-6);
        assert_eq!(mesh.sample(10, &mut stream(1, Purpose::Shape, 0)).len(), 10);
        mesh.faces = vec![[0, 0, 1], [7, 8, 9]];
        assert!(
            mesh.sample(10, &mut stream(1, Purpose::Shape, 0))
                .is_empty()
        );
        assert!(
            Mesh::default()
                .sample(10, &mut stream(1, Purpose::Shape, 0))
                .is_empty()
        );
    }

    #[test]
    fn normalising_centres_and_scales() {
        let mut points = vec![
            [1.0, 2.0, 3.0],
            [5.0, 2.0, 3.0],
            [3.0, 2.0, 6.0],
            [3.0, 2.0, 0.0],
        ];
        let (centre, radius) = normalise(&mut points).expect("has extent");
        assert_eq!((centre, radius), (Vec3::new(3.0, 2.0, 3.0), 3.0));
        assert_eq!(points[2], [0.0, 0.0, 1.0]);
        assert_eq!(normalise(&mut [[1.0, 1.0, 1.0]; 4]), None);
        assert_eq!(normalise(&mut []), None);
    }
}
