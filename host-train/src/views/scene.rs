//! The surroundings of an object in a training view: planes behind and below it, other things beside and before it.

use crate::augment::random_rotation;
use crate::dataset::mesh::Mesh;
use crate::dataset::raster::Pinhole;
use crate::random::Rng;
use glam::{Affine3A, Mat3, Vec2, Vec3};
use rand::RngExt;
use std::f32::consts::TAU;

/// Share of the objects that rest on a plane.
const RESTING: f64 = 0.6;
/// Share of the scenes with a wall.
const WALLED: f64 = 0.6;
/// Share of the scenes with one other thing; half of them have two.
const CROWDED: f64 = 0.5;
/// Least visible share of an object that other things hide; where it would be less, they are removed.
const LEAST_SEEN: f32 = 0.3;

/// One exact depth image of an object and its surroundings.
pub(super) struct Scene {
    /// Depths in millimetres, row by row; 0 where there is nothing.
    pub(super) depths: Vec<f32>,
    /// Pixels in which the object is seen.
    pub(super) visible: Vec<bool>,
}

/// A thing in the surroundings.
enum Thing {
    /// Points with `normal · x = height`.
    Plane {
        normal: Vec3,
        height: f32,
    },
    Ball {
        centre: Vec3,
        radius: f32,
    },
    /// A box; `half` are its half edges.
    Box {
        box_from_camera: Mat3,
        centre: Vec3,
        half: Vec3,
    },
}

impl Scene {
    /// Renders an object of about this radius, millimetres, in random surroundings.
    pub(super) fn around(
        mesh: &Mesh,
        camera_from_mesh: &Affine3A,
        radius: f32,
        distance: f32,
        camera: &Pinhole,
        rng: &mut Rng,
    ) -> Scene {
        let own = camera.inverse_depths(mesh, camera_from_mesh);
        let mut behind = Vec::new();
        if rng.random_bool(RESTING) {
            let (out, aside) = rng
                .random_range(10f32.to_radians()..80f32.to_radians())
                .sin_cos();
            let up = (aside * Vec2::from_angle(rng.random_range(0.0..TAU))).extend(-out);
            let heights = mesh
                .vertices
                .iter()
                .map(|&v| up.dot(camera_from_mesh.transform_point3(v)));
            let height = heights.fold(f32::MAX, f32::min);
            behind.push(Thing::Plane { normal: up, height });
        }
        if rng.random_bool(WALLED) {
            let tilt = Vec2::from_angle(rng.random_range(0.0..TAU)) * rng.random_range(0.0..0.5f32);
            let gap = radius * rng.random_range(1.0..2.5f32) * rng.random_range(1.0..6.0f32);
            let normal = tilt.extend(-1.0).normalize();
            behind.push(Thing::Plane {
                normal,
                height: normal.z * (distance + gap),
            });
        }
        let mut others = Vec::new();
        while others.len() < 2 && rng.random_bool(CROWDED) {
            others.push(Thing::beside(radius, distance, rng));
        }
        let mut scene = Scene::render(&own, behind.iter().chain(&others), camera);
        let count = |pixels: &[bool]| pixels.iter().filter(|&&seen| seen).count() as f32;
        let silhouette = own.iter().filter(|&&inverse| inverse > 0.0).count() as f32;
        if count(&scene.visible) < LEAST_SEEN * silhouette {
            scene = Scene::render(&own, behind.iter(), camera);
        }
        scene
    }

    fn render<'t>(own: &[f32], things: impl Iterator<Item = &'t Thing>, camera: &Pinhole) -> Scene {
        let mut nearest = own.to_vec();
        let mut visible: Vec<bool> = own.iter().map(|&inverse| inverse > 0.0).collect();
        let width = camera.size[0];
        for thing in things {
            for (pixel, nearest) in nearest.iter_mut().enumerate() {
                let inverse = thing.inverse_depth(camera.ray(pixel % width, pixel / width));
                if inverse > *nearest {
                    *nearest = inverse;
                    visible[pixel] = false;
                }
            }
        }
        let depth = |inverse: f32| if inverse > 0.0 { 1.0 / inverse } else { 0.0 };
        Scene {
            depths: nearest.into_iter().map(depth).collect(),
            visible,
        }
    }
}

impl Thing {
    /// A ball or a box beside, before or behind an object.
    fn beside(radius: f32, distance: f32, rng: &mut Rng) -> Thing {
        let size = radius * rng.random_range(0.25..0.9f32);
        let aside = (radius + size) * rng.random_range(0.5..1.1f32);
        let nearer = radius * rng.random_range(-1.0..1.5f32);
        let around = Vec2::from_angle(rng.random_range(0.0..TAU));
        let centre = (around * aside).extend(distance - nearer);
        if rng.random_bool(0.5) {
            return Thing::Ball {
                centre,
                radius: size,
            };
        }
        let mut edge = || size * rng.random_range(0.3..1.0f32);
        let half = Vec3::new(edge(), edge(), edge());
        Thing::Box {
            box_from_camera: Mat3::from_quat(random_rotation(rng)),
            centre,
            half,
        }
    }

    /// Inverse of the depth at which a ray, given at depth 1, first meets the thing; 0 if it does not.
    fn inverse_depth(&self, ray: Vec3) -> f32 {
        let depth = match self {
            Thing::Plane { normal, height } => height / normal.dot(ray),
            Thing::Ball { centre, radius } => {
                let (a, b) = (ray.length_squared(), ray.dot(*centre));
                let root = b * b - a * (centre.length_squared() - radius * radius);
                (b - root.sqrt()) / a
            }
            Thing::Box {
                box_from_camera,
                centre,
                half,
            } => {
                let direction = (*box_from_camera * ray).recip();
                let origin = *box_from_camera * -*centre;
                let (a, b) = ((-*half - origin) * direction, (*half - origin) * direction);
                let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
                if enter <= leave { enter } else { 0.0 }
            }
        };
        // 0 for hits behind the camera, and for the NaN root of a ray that misses.
        if depth > 0.0 { 1.0 / depth } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_meet_things_where_they_are() {
        let ball = Thing::Ball {
            centre: Vec3::Z * 10.0,
            radius: 2.0,
        };
        let plane = Thing::Plane {
            normal: -Vec3::Z,
            height: -5.0,
        };
        let cube = Thing::Box {
            box_from_camera: Mat3::from_rotation_z(0.3),
            centre: Vec3::new(0.0, 0.0, 10.0),
            half: Vec3::splat(1.0),
        };
        let depth = |thing: &Thing, x: f32| 1.0 / thing.inverse_depth(Vec3::new(x, 0.0, 1.0));
        assert!((depth(&ball, 0.0) - 8.0).abs() < 1e-4);
        assert!((depth(&plane, 0.2) - 5.0).abs() < 1e-4);
        assert!((depth(&cube, 0.05) - 9.0).abs() < 1e-4);
        assert_eq!(ball.inverse_depth(Vec3::new(0.3, 0.0, 1.0)), 0.0);
        assert_eq!(cube.inverse_depth(Vec3::new(0.3, 0.0, 1.0)), 0.0);
        assert_eq!(plane.inverse_depth(Vec3::new(0.0, 0.0, -1.0)), 0.0);
    }
}
