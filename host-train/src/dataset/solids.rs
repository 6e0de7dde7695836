//! Solids as triangle meshes: boxes, bodies of revolution and extrusions, with exact flat faces and
//! finely divided round ones.

use super::mesh::Mesh;
use super::triangulate::triangulate;
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Segments of a full circle.
pub const SEGMENTS: usize = 28;

/// Places a solid's origin at `(x, y, z)`; its axis is y.
pub fn at(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

/// Places a solid's origin at `(x, y, z)` with its axis along x.
pub fn along_x(x: f32, y: f32, z: f32) -> Affine3A {
    at(x, y, z) * Affine3A::from_rotation_z(-FRAC_PI_2)
}

/// Places a solid's origin at `(x, y, z)` with its axis along z.
pub fn along_z(x: f32, y: f32, z: f32) -> Affine3A {
    at(x, y, z) * Affine3A::from_rotation_x(FRAC_PI_2)
}

/// Places a centred solid of unit length along y between two points.
pub fn between(from: Vec3, to: Vec3) -> Affine3A {
    let axis = to - from;
    let turn = Quat::from_rotation_arc(Vec3::Y, axis.normalize_or(Vec3::Y));
    Affine3A::from_scale_rotation_translation(
        Vec3::new(1.0, axis.length(), 1.0),
        turn,
        (from + to) / 2.0,
    )
}

/// Points of a circle, counter-clockwise.
pub fn circle(centre: Vec2, radius: f32, segments: usize) -> Vec<Vec2> {
    let point = |i| centre + radius * Vec2::from_angle(TAU * i as f32 / segments as f32);
    (0..segments).map(point).collect()
}

/// Corners of a rectangle about the origin, counter-clockwise.
pub fn rectangle(width: f32, height: f32) -> Vec<Vec2> {
    let (x, y) = (width / 2.0, height / 2.0);
    vec![
        Vec2::new(-x, -y),
        Vec2::new(x, -y),
        Vec2::new(x, y),
        Vec2::new(-x, y),
    ]
}

impl Mesh {
    /// A box of full edge lengths `size` about the origin.
    pub fn add_box(&mut self, place: Affine3A, size: Vec3) {
        let first = self.vertices.len() as u32;
        for corner in 0..8 {
            let side = |bit: u32| if corner >> bit & 1 == 1 { 0.5 } else { -0.5 };
            let local = Vec3::new(side(0), side(1), side(2)) * size;
            self.vertices.push(place.transform_point3(local));
        }
        for [a, b, c, d] in [
            [0, 1, 3, 2],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 3, 7, 5],
        ] {
            self.faces.push([first + a, first + b, first + c]);
            self.faces.push([first + a, first + c, first + d]);
        }
    }

    /// Revolves a profile of `(radius, height)` about y by `turn_rad` (a full circle is closed). A profile that
    /// starts and ends on the axis, or returns to its start, gives a closed surface.
    pub fn add_revolved(&mut self, place: Affine3A, profile: &[Vec2], turn_rad: f32) {
        let steps = ((turn_rad / TAU * SEGMENTS as f32).ceil() as usize).max(1);
        let (first, ring) = (self.vertices.len() as u32, profile.len() as u32);
        for step in 0..=steps {
            let direction = Vec2::from_angle(turn_rad * step as f32 / steps as f32);
            for point in profile {
                let (x, z) = (point.x * direction.x, point.x * direction.y);
                self.vertices
                    .push(place.transform_point3(Vec3::new(x, point.y, z)));
            }
        }
        for step in 0..steps as u32 {
            for i in 1..ring {
                let [a, b] = [first + step * ring + i - 1, first + step * ring + i];
                self.faces.push([a, b, a + ring]);
                self.faces.push([b, b + ring, a + ring]);
            }
        }
    }

    /// A cylinder or frustum about y, centred, with its caps.
    pub fn add_cone(&mut self, place: Affine3A, radius_low: f32, radius_high: f32, height: f32) {
        let y = height / 2.0;
        let profile = [(0.0, -y), (radius_low, -y), (radius_high, y), (0.0, y)].map(Vec2::from);
        self.add_revolved(place, &profile, TAU);
    }

    /// A cylinder about y, centred, with its caps.
    pub fn add_cylinder(&mut self, place: Affine3A, radius: f32, height: f32) {
        self.add_cone(place, radius, radius, height);
    }

    /// A hollow cylinder about y, centred, open through.
    pub fn add_tube(&mut self, place: Affine3A, outer: f32, inner: f32, height: f32) {
        let y = height / 2.0;
        let profile = [
            (inner, -y),
            (outer, -y),
            (outer, y),
            (inner, y),
            (inner, -y),
        ]
        .map(Vec2::from);
        self.add_revolved(place, &profile, TAU);
    }

    /// A sphere, or an ellipsoid if `place` scales it.
    pub fn add_sphere(&mut self, place: Affine3A, radius: f32) {
        let steps = SEGMENTS / 2;
        let point = |i| radius * Vec2::from_angle(PI * i as f32 / steps as f32 - FRAC_PI_2);
        let profile: Vec<Vec2> = (0..=steps).map(point).collect();
        self.add_revolved(place, &profile, TAU);
    }

    /// An arc of a torus about y that starts on the x axis, without end caps.
    pub fn add_torus(&mut self, place: Affine3A, ring: f32, tube: f32, turn_rad: f32) {
        let segments = SEGMENTS / 2;
        let point =
            |i| Vec2::new(ring, 0.0) + tube * Vec2::from_angle(TAU * i as f32 / segments as f32);
        let profile: Vec<Vec2> = (0..=segments).map(point).collect();
        self.add_revolved(place, &profile, turn_rad);
    }

    /// A simple polygon with holes in the local x-z plane, extruded along y, centred, with both caps.
    pub fn add_extruded(
        &mut self,
        place: Affine3A,
        outline: &[Vec2],
        holes: &[Vec<Vec2>],
        height: f32,
    ) {
        let lift = |point: Vec2, side: f32| {
            place.transform_point3(Vec3::new(point.x, side * height / 2.0, point.y))
        };
        let (corners, triangles) = triangulate(outline, holes);
        for side in [-1.0, 1.0] {
            let first = self.vertices.len() as u32;
            self.vertices.extend(corners.iter().map(|&p| lift(p, side)));
            self.faces
                .extend(triangles.iter().map(|t| t.map(|i| first + i)));
        }
        for ring in std::iter::once(outline).chain(holes.iter().map(Vec::as_slice)) {
            for (i, &p) in ring.iter().enumerate() {
                let q = ring[(i + 1) % ring.len()];
                let first = self.vertices.len() as u32;
                self.vertices
                    .extend([lift(p, -1.0), lift(q, -1.0), lift(q, 1.0), lift(p, 1.0)]);
                self.faces.push([first, first + 1, first + 2]);
                self.faces.push([first, first + 2, first + 3]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(build: impl Fn(&mut Mesh)) -> f64 {
        let mut mesh = Mesh::default();
        build(&mut mesh);
        mesh.area()
    }

    /// Areas against closed forms; a polygonal circle is slightly short.
    #[test]
    fn areas_are_those_of_the_solids() {
        let close = |found: f64, exact: f32, relative: f64| {
            assert!(
                (found / f64::from(exact) - 1.0).abs() < relative,
                "{found} against {exact}"
            );
        };
        let place = at(1.0, 2.0, 3.0) * Affine3A::from_rotation_x(0.7);
        close(
            area(|m| m.add_box(place, Vec3::new(1.0, 2.0, 3.0))),
            22.0,
            1e-5,
        );
        close(area(|m| m.add_cylinder(place, 0.5, 2.0)), PI * 2.5, 0.01);
        close(
            area(|m| m.add_tube(along_x(0.0, 0.0, 0.0), 1.0, 0.5, 2.0)),
            7.5 * PI,
            0.01,
        );
        close(area(|m| m.add_sphere(place, 1.0)), 4.0 * PI, 0.015);
        close(
            area(|m| m.add_torus(along_z(0.0, 0.0, 0.0), 2.0, 0.5, PI)),
            2.0 * PI * PI,
            0.03,
        );
        let square = rectangle(2.0, 2.0);
        let hole = rectangle(1.0, 1.0);
        close(
            area(|m| m.add_extruded(place, &square, std::slice::from_ref(&hole), 0.5)),
            12.0,
            1e-5,
        );
    }

    #[test]
    fn between_spans_its_ends() {
        let (from, to) = (Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.0, 2.0, 2.0));
        let place = between(from, to);
        assert!((place.transform_point3(Vec3::Y * -0.5) - from).length() < 1e-5);
        assert!((place.transform_point3(Vec3::Y * 0.5) - to).length() < 1e-5);
    }
}
