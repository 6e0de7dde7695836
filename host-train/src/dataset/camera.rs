//! A simulated depth camera: what a robot would see of a shape.

use super::Point;
use super::mesh::Mesh;
use super::raster::Pinhole;
use crate::random::Rng;
use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_distr::StandardNormal;
use std::collections::HashSet;
use std::f32::consts::TAU;

/// A pinhole depth camera that looks at the origin from all sides. Lengths are in the shape's units, in which
/// it lies inside the unit sphere.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Columns and rows of the image.
    pub pixels: [usize; 2],
    /// Vertical field of view, degrees.
    pub field_of_view_deg: f32,
    /// Distance of the camera from the origin; more than 1.
    pub distance: f32,
    /// Standard deviation of the Gaussian noise on each depth, along the ray.
    pub depth_noise: f32,
    /// Edge of the voxels that keep one point each, so that near and frontal surfaces do not outweigh the rest.
    pub voxel: f32,
}

impl Default for Camera {
    /// A 160 by 120 image that the unit sphere just fills, with noise of half a percent of its radius.
    fn default() -> Camera {
        Camera {
            pixels: [160, 120],
            field_of_view_deg: 43.0,
            distance: 2.8,
            depth_noise: 0.005,
            voxel: 0.025,
        }
    }
}

impl Camera {
    /// What `views` cameras spread over a sphere, turned at random, see of the mesh together: up to `count`
    /// noisy points of visible surfaces in the mesh's frame, in random order. Hidden surfaces give no
    /// points; a mesh outside of all images gives none at all.
    pub fn observe(&self, mesh: &Mesh, views: usize, count: usize, rng: &mut Rng) -> Vec<Point> {
        let turn = random_rotation(rng);
        let pinhole = self.pinhole();
        let mut points = Vec::new();
        for view in 0..views {
            let camera_from_world = looking_from(turn * sphere_direction(view, views));
            let place = Affine3A::from_mat3_translation(camera_from_world, self.distance * Vec3::Z);
            let depths = pinhole.inverse_depths(mesh, &place);
            for (pixel, &inverse_depth) in depths.iter().enumerate() {
                if inverse_depth > 0.0 {
                    let noise: f32 = rng.sample(StandardNormal);
                    let depth = 1.0 / inverse_depth + self.depth_noise * noise;
                    let in_camera =
                        pinhole.ray(pixel % self.pixels[0], pixel / self.pixels[0]) * depth;
                    let from_centre = in_camera - self.distance * Vec3::Z;
                    points.push(camera_from_world.transpose() * from_centre);
                }
            }
        }
        points.shuffle(rng);
        let mut taken = HashSet::new();
        points.retain(|point| {
            taken.insert((*point / self.voxel).to_array().map(|x| x.floor() as i32))
        });
        points.truncate(count);
        points.into_iter().map(Into::into).collect()
    }

    fn pinhole(&self) -> Pinhole {
        let half = Vec2::from_angle(self.field_of_view_deg.to_radians() / 2.0);
        let size = self.pixels.map(|n| n as f32);
        Pinhole {
            size: self.pixels,
            focal: Vec2::splat(size[1] / 2.0 * half.x / half.y),
            centre: (Vec2::from_array(size) - 1.0) / 2.0,
        }
    }
}

/// Direction number `i` of `n`, evenly spread over the sphere (a Fibonacci lattice).
fn sphere_direction(i: usize, n: usize) -> Vec3 {
    const GOLDEN_TURN: f32 = 0.381_966;
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / n as f32;
    let around = Vec2::from_angle(TAU * (GOLDEN_TURN * i as f32).fract());
    let xz = around * (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(xz.x, y, xz.y)
}

/// Uniform over all rotations.
pub(crate) fn random_rotation(rng: &mut Rng) -> Quat {
    let [x, y, z, w]: [f32; 4] = std::array::from_fn(|_| rng.sample(StandardNormal));
    Quat::from_xyzw(x, y, z, w).normalize()
}

/// Rotation into a camera that stands in `direction` and looks at the origin along its z axis.
fn looking_from(direction: Vec3) -> Mat3 {
    let forward = -direction;
    let right = forward.any_orthonormal_vector();
    Mat3::from_cols(right, forward.cross(right), forward).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::dataset::solids::at;
    use crate::random::{Purpose, stream};

    fn sphere_in_sphere() -> Mesh {
        let mut mesh = Mesh::default();
        mesh.add_sphere(at(0.0, 0.0, 0.0), 0.4);
        mesh.add_sphere(Affine3A::IDENTITY, 0.8);
        mesh
    }

    fn exact() -> Camera {
        Camera {
            depth_noise: 0.0,
            ..Camera::default()
        }
    }

    #[test]
    fn hidden_surfaces_give_no_points() {
        let points = exact().observe(
            &sphere_in_sphere(),
            6,
            5000,
            &mut stream(1, Purpose::Pairs, 0),
        );
        assert!(points.len() > 2000, "{}", points.len());
        let norms = points.iter().map(|p| Vec3::from_array(*p).length());
        let (low, high) = norms.fold((f32::MAX, 0.0f32), |(l, h), n| (l.min(n), h.max(n)));
        // The sphere is made of flat faces.
        assert!(low > 0.77 && high < 0.801, "{low} to {high}");
    }

    #[test]
    fn one_view_sees_one_side_and_several_see_all() {
        let spread = |views| {
            let points = exact().observe(
                &sphere_in_sphere(),
                views,
                4000,
                &mut stream(2, Purpose::Pairs, 0),
            );
            reagent_core::pose::centroid(&points).length()
        };
        assert!(spread(1) > 0.4, "{}", spread(1));
        assert!(spread(6) < 0.05, "{}", spread(6));
    }

    #[test]
    fn points_lie_on_the_shape_and_noise_moves_them() {
        let shape = procedural::shape(7, 3);
        let dense: Vec<Vec3> = shape
            .mesh
            .sample(60_000, &mut stream(3, Purpose::Shape, 0))
            .into_iter()
            .map(Vec3::from)
            .collect();
        let distance = |camera: Camera| {
            let points = camera.observe(&shape.mesh, 4, 200, &mut stream(4, Purpose::Pairs, 0));
            assert_eq!(points.len(), 200);
            let nearest = |p: &Point| {
                dense
                    .iter()
                    .map(|q| q.distance(Vec3::from_array(*p)))
                    .fold(f32::MAX, f32::min)
            };
            points.iter().map(nearest).sum::<f32>() / 200.0
        };
        let (clean, noisy) = (
            distance(exact()),
            distance(Camera {
                depth_noise: 0.05,
                ..Camera::default()
            }),
        );
        assert!(clean < 0.015 && noisy > 2.0 * clean, "{clean} and {noisy}");
    }

    #[test]
    fn the_same_seed_sees_the_same_and_nothing_gives_nothing() {
        let mesh = procedural::shape(7, 4).mesh;
        let see =
            |index| Camera::default().observe(&mesh, 3, 500, &mut stream(5, Purpose::Pairs, index));
        assert_eq!(see(0), see(0));
        assert_ne!(see(0), see(1));
        assert!(
            exact()
                .observe(&Mesh::default(), 3, 500, &mut stream(5, Purpose::Pairs, 0))
                .is_empty()
        );
        assert!(
            exact()
                .observe(&mesh, 0, 500, &mut stream(5, Purpose::Pairs, 0))
                .is_empty()
        );
    }
}
