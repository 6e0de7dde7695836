//! A mesh being drawn, with the random stream its proportions come from.

use crate::dataset::mesh::Mesh;
use crate::dataset::solids::at;
use crate::random::Rng;
use glam::{Affine3A, Quat, Vec3};
use rand::RngExt;
use std::f32::consts::TAU;

/// A shape under construction. Families draw at about unit size, y up.
pub(super) struct Sketch<'r> {
    pub(super) mesh: Mesh,
    pub(super) rng: &'r mut Rng,
}

impl Sketch<'_> {
    /// Uniform in `[low, high)`.
    pub(super) fn uniform(&mut self, low: f32, high: f32) -> f32 {
        self.rng.random_range(low..high)
    }

    /// A whole number from `low` to `high`, both included.
    pub(super) fn whole(&mut self, low: usize, high: usize) -> usize {
        self.rng.random_range(low..=high)
    }

    /// True with the given probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.rng.random_bool(probability)
    }

    /// 1 or -1.
    pub(super) fn sign(&mut self) -> f32 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// A box between two opposite corners.
    pub(super) fn block(&mut self, low: [f32; 3], high: [f32; 3]) {
        let (low, high) = (Vec3::from_array(low), Vec3::from_array(high));
        self.mesh
            .add_box(Affine3A::from_translation((low + high) / 2.0), high - low);
    }

    /// One to four small parts, each centred on a random point of the surface.
    pub(super) fn add_details(&mut self) {
        let count = self.whole(1, 4);
        let anchors = self.mesh.sample(count, self.rng);
        let (low, high) = self
            .mesh
            .vertices
            .iter()
            .fold((Vec3::MAX, Vec3::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        let extent = (high - low).max_element();
        for [x, y, z] in anchors {
            let turn = Quat::from_rotation_y(self.uniform(0.0, TAU))
                * Quat::from_rotation_x(self.uniform(-0.6, 0.6));
            let place = at(x, y, z) * Affine3A::from_quat(turn);
            let size = extent * self.uniform(0.05, 0.13);
            match self.whole(0, 2) {
                0 => {
                    let edges = Vec3::new(1.0, self.uniform(0.6, 2.0), self.uniform(0.6, 2.0));
                    self.mesh.add_box(place, size * edges);
                }
                1 => {
                    let height = size * self.uniform(1.0, 3.0);
                    self.mesh.add_cylinder(place, size * 0.5, height);
                }
                _ => self.mesh.add_sphere(place, size * 0.7),
            }
        }
    }
}
