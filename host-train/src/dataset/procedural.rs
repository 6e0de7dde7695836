//! The built-in data set: seeded, parametric, CAD-like shapes, so that training, tests and the demo
//! need no download.
//!
//! A model depends only on `(seed, index)`. Its family is drawn first, then its proportions, then a few small parts
//! placed anywhere, which leave few shapes symmetric.

mod furniture;
mod machine;
mod objects;
mod sketch;

use super::mesh::{Mesh, normalise};
use super::{Model, Point};
use crate::random::{Purpose, stream};
use glam::{Affine3A, Quat, Vec3};
use rand::RngExt;
use rayon::prelude::*;
use sketch::Sketch;
use std::f32::consts::FRAC_PI_2;

/// Points of a generated cloud, as in ModelNet40.
pub const POINTS: usize = 2048;

/// Names of the families; a model's label is the index here.
pub const FAMILIES: [&str; 22] = [
    "table",
    "chair",
    "shelf",
    "bed",
    "lamp",
    "stairs",
    "house",
    "bracket",
    "flange",
    "gear",
    "pipe_elbow",
    "stepped_shaft",
    "extrusion",
    "robot_link",
    "wrench",
    "mug",
    "bottle",
    "slotted_box",
    "airplane",
    "car",
    "figure",
    "rock",
];

const DRAW: [fn(&mut Sketch); FAMILIES.len()] = [
    furniture::table,
    furniture::chair,
    furniture::shelf,
    furniture::bed,
    furniture::lamp,
    furniture::stairs,
    furniture::house,
    machine::bracket,
    machine::flange,
    machine::gear,
    machine::pipe_elbow,
    machine::stepped_shaft,
    machine::extrusion,
    machine::robot_link,
    machine::wrench,
    objects::mug,
    objects::bottle,
    objects::slotted_box,
    objects::airplane,
    objects::car,
    objects::figure,
    objects::rock,
];

/// A generated shape: its surface, and the cloud drawn from it, in one normalised frame.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Surface, normalised with the cloud.
    pub mesh: Mesh,
    /// 2048 points of the surface, mean at the origin and farthest point at 1; label = family.
    pub model: Model,
}

/// Shape number `index` of the data set `seed`.
pub fn shape(seed: u64, index: u64) -> Shape {
    let rng = &mut stream(seed, Purpose::Shape, index);
    let label = rng.random_range(0..FAMILIES.len());
    let mut sketch = Sketch {
        mesh: Mesh::default(),
        rng,
    };
    DRAW[label](&mut sketch);
    sketch.add_details();
    let Sketch { mut mesh, rng } = sketch;
    let upright = orientation(rng.random_range(0..8), rng.random_range(0..4));
    for vertex in &mut mesh.vertices {
        *vertex = upright.transform_point3(*vertex);
    }
    let mut points: Vec<Point> = mesh.sample(POINTS, rng);
    let (centre, radius) = normalise(&mut points).expect("every family has an extent");
    for vertex in &mut mesh.vertices {
        *vertex = (*vertex - centre) / radius;
    }
    Shape {
        mesh,
        model: Model {
            points,
            label: label as u32,
        },
    }
}

/// Cloud number `index` of the data set `seed`.
pub fn model(seed: u64, index: u64) -> Model {
    shape(seed, index).model
}

/// The first `count` clouds of the data set `seed`, independent of the number of threads.
pub fn models(seed: u64, count: usize) -> Vec<Model> {
    (0..count as u64)
        .into_par_iter()
        .map(|index| model(seed, index))
        .collect()
}

/// Mostly y up, as in ModelNet40, with a quarter turn about y; sometimes lying on a side.
fn orientation(side: u32, quarter_turns: u32) -> Affine3A {
    let lying = match side {
        0 => Quat::from_rotation_x(FRAC_PI_2),
        1 => Quat::from_rotation_z(FRAC_PI_2),
        _ => Quat::IDENTITY,
    };
    Affine3A::from_quat(lying * Quat::from_axis_angle(Vec3::Y, FRAC_PI_2 * quarter_turns as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;

    #[test]
    fn the_same_on_one_and_on_four_threads() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("pool");
            pool.install(|| models(3, 40))
        };
        let one = on(1);
        assert_eq!(one, on(4));
        assert_eq!(one[17], model(3, 17));
        assert_ne!(model(4, 17).points, one[17].points);
    }

    #[test]
    fn every_family_occurs_normalised_and_solid() {
        let mut seen = [0usize; FAMILIES.len()];
        for model in models(1, 600) {
            seen[model.label as usize] += 1;
            assert_eq!(model.points.len(), POINTS);
            let mean = reagent_core::pose::centroid(&model.points);
            let norms = model.points.iter().map(|p| Vec3::from_array(*p).length());
            let farthest = norms.fold(0.0f32, f32::max);
            assert!(
                mean.length() < 1e-5 && (farthest - 1.0).abs() < 1e-5,
                "{mean} {farthest}"
            );
            assert!(
                thickness(&model.points) > 0.03,
                "{} is flat",
                FAMILIES[model.label as usize]
            );
        }
        assert!(seen.iter().all(|&count| count >= 8), "{seen:?}");
    }

    #[test]
    fn shapes_of_one_family_differ() {
        let models = models(2, 300);
        for label in 0..FAMILIES.len() as u32 {
            let of: Vec<_> = models.iter().filter(|m| m.label == label).collect();
            let distance = chamfer(&of[0].points, &of[1].points, Mat3::IDENTITY);
            assert!(
                distance > 1e-3,
                "two of {} at {distance}",
                FAMILIES[label as usize]
            );
        }
    }

    /// A turn of a symmetric shape leaves the Chamfer distance at that of another sampling of its surface.
    #[test]
    fn most_shapes_have_no_rotational_symmetry() {
        let mut symmetric = 0;
        for index in 0..120 {
            let shape = shape(5, index);
            let again = shape
                .mesh
                .sample(POINTS, &mut stream(6, Purpose::Shape, index));
            let floor = chamfer(&shape.model.points, &again, Mat3::IDENTITY);
            let axes = [Vec3::X, Vec3::Y, Vec3::Z];
            let turns = axes
                .into_iter()
                .flat_map(|axis| [1.0f32, 2.0].map(|n| (axis, n * FRAC_PI_2)));
            let nearest = turns
                .map(|(axis, angle)| {
                    chamfer(
                        &shape.model.points,
                        &again,
                        Mat3::from_axis_angle(axis, angle),
                    )
                })
                .fold(f32::MAX, f32::min);
            symmetric += usize::from(nearest < 1.5 * floor);
        }
        assert!(symmetric < 24, "{symmetric} of 120 are symmetric");
    }

    /// Mean squared distance of 300 points of `a`, turned, to their nearest points of `b`.
    fn chamfer(a: &[Point], b: &[Point], turn: Mat3) -> f32 {
        let b: Vec<Vec3> = b.iter().copied().map(Vec3::from_array).collect();
        let nearest = |p: &Point| {
            let p = turn * Vec3::from_array(*p);
            b.iter()
                .map(|q| p.distance_squared(*q))
                .fold(f32::MAX, f32::min)
        };
        a.iter().take(300).map(nearest).sum::<f32>() / 300.0
    }

    /// Extent along the thinnest of the coordinate axes.
    fn thickness(points: &[Point]) -> f32 {
        let extent = |axis: usize| {
            let values = points.iter().map(|p| p[axis]);
            let (low, high) = values.fold((f32::MAX, f32::MIN), |(l, h), x| (l.min(x), h.max(x)));
            high - low
        };
        (0..3).map(extent).fold(f32::MAX, f32::min)
    }
}
