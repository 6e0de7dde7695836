//! Objects placed on a plane, and what a noise-free camera sees of them.

use super::objects::Object;
use crate::augment::random_rotation;
use crate::dataset::raster::Pinhole;
use crate::random::Rng;
use glam::{Affine3A, Mat3, Vec2, Vec3};
use rand::RngExt;
use reagent_core::Pose;
use std::f32::consts::TAU;

/// LINEMOD's camera at 640 by 480: focal lengths and principal point, pixels.
const LINEMOD_FOCAL: Vec2 = Vec2::new(572.4114, 573.57043);
const LINEMOD_CENTRE: Vec2 = Vec2::new(325.2611, 242.049);

/// LINEMOD's camera for another image size, with the same horizontal field of view.
pub fn linemod_camera(size: [usize; 2]) -> Pinhole {
    let scale = size[0] as f32 / 640.0;
    let half = Vec2::splat(0.5);
    let row_shift = (size[1] as f32 - 480.0 * scale) / 2.0;
    Pinhole {
        size,
        focal: LINEMOD_FOCAL * scale,
        centre: (LINEMOD_CENTRE + half) * scale - half + Vec2::Y * row_shift,
    }
}

/// Objects at rest on the plane z = 0, millimetres.
#[derive(Clone, Debug)]
pub struct Scene<'o> {
    placed: Vec<(&'o Object, Pose)>,
}

impl<'o> Scene<'o> {
    /// Places `count` objects, drawn with replacement, near the origin. Each is turned at random, touches the plane,
    /// and stands clear of the others: circles around their vertices, seen from above, do not overlap.
    pub fn arrange(objects: &'o [Object], count: usize, rng: &mut Rng) -> Scene<'o> {
        let mut placed: Vec<(&Object, Pose)> = Vec::new();
        let mut circles: Vec<(Vec2, f32)> = Vec::new();
        if objects.is_empty() {
            return Scene { placed };
        }
        for _ in 0..count {
            let object = &objects[rng.random_range(0..objects.len())];
            let rotation = Mat3::from_quat(random_rotation(rng));
            let turned = object.mesh.vertices.iter().map(|v| rotation * *v);
            let (mut lowest, mut radius) = (f32::MAX, 0.0f32);
            for v in turned {
                lowest = lowest.min(v.z);
                radius = radius.max(v.truncate().length());
            }
            // The disc grows slowly with each attempt, so that a free place is found near the others.
            let mut reach = 0.0;
            let centre = loop {
                let around = Vec2::from_angle(rng.random_range(0.0..TAU));
                let centre = around * (reach * rng.random::<f32>().sqrt());
                let apart = |&(c, r): &(Vec2, f32)| centre.distance(c) >= radius + r;
                if circles.iter().all(apart) {
                    break centre;
                }
                reach += 0.02 * radius + 0.2;
            };
            circles.push((centre, radius));
            let translation = centre.extend(-lowest);
            placed.push((
                object,
                Pose {
                    rotation,
                    translation,
                },
            ));
        }
        Scene { placed }
    }

    /// A random view, camera_from_world: 600 to 1000 mm from a point near the middle, 10 to 55 degrees above the plane,
    /// rolled by up to 15 degrees. The camera looks along z, with y down.
    pub fn view(&self, rng: &mut Rng) -> Pose {
        let azimuth = rng.random_range(0.0..TAU);
        let (sine, cosine) = rng
            .random_range(10f32.to_radians()..55f32.to_radians())
            .sin_cos();
        let out = (cosine * Vec2::from_angle(azimuth)).extend(sine);
        let target = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-30.0..30.0)));
        let eye = target + out * rng.random_range(600.0..1000.0);
        let forward = -out;
        let right = forward.cross(Vec3::Z).normalize();
        let world = Mat3::from_cols(right, forward.cross(right), forward);
        let roll = rng.random_range(-15f32.to_radians()..15f32.to_radians());
        let rotation = Mat3::from_rotation_z(roll) * world.transpose();
        Pose {
            rotation,
            translation: -(rotation * eye),
        }
    }

    /// The objects and their poses in the camera's frame.
    pub fn poses(&self, camera_from_world: &Pose) -> impl Iterator<Item = (&'o Object, Pose)> {
        self.placed
            .iter()
            .map(|&(object, world_from_model)| (object, camera_from_world.after(world_from_model)))
    }

    /// Renders the exact depth of each pixel, and which object it shows.
    pub fn render(&self, camera: &Pinhole, camera_from_world: &Pose) -> Rendered {
        let up = camera_from_world.rotation * Vec3::Z;
        let height = -up.dot(camera_from_world.translation);
        let pixels = camera.size[0] * camera.size[1];
        // The plane: up · (ray / inverse) + height = 0 in the camera's frame.
        let plane = |pixel: usize| {
            let ray = camera.ray(pixel % camera.size[0], pixel / camera.size[0]);
            (up.dot(ray) / -height.abs().max(1e-6)).max(0.0)
        };
        let mut nearest: Vec<f32> = (0..pixels).map(plane).collect();
        let mut owner = vec![None; pixels];
        let mut silhouettes = Vec::new();
        for (index, (object, pose)) in self.poses(camera_from_world).enumerate() {
            let place = Affine3A::from_mat3_translation(pose.rotation, pose.translation);
            let own = camera.inverse_depths(&object.mesh, &place);
            for (pixel, &inverse) in own.iter().enumerate() {
                if inverse > nearest[pixel] {
                    nearest[pixel] = inverse;
                    owner[pixel] = Some(index);
                }
            }
            silhouettes.push(own.into_iter().map(|inverse| inverse > 0.0).collect());
        }
        Rendered {
            size: camera.size,
            inverse_depths: nearest,
            owner,
            silhouettes,
        }
    }
}

/// An image without noise.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Inverse depths, 1/mm; 0 where nothing is seen.
    pub inverse_depths: Vec<f32>,
    owner: Vec<Option<usize>>,
    silhouettes: Vec<Vec<bool>>,
}

impl Rendered {
    /// Pixels that object number `index` would cover alone.
    pub fn silhouette(&self, index: usize) -> Vec<bool> {
        self.silhouettes[index].clone()
    }

    /// Pixels in which object number `index` is seen.
    pub fn visible(&self, index: usize) -> Vec<bool> {
        self.owner.iter().map(|&o| o == Some(index)).collect()
    }
}
