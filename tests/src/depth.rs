//! A synthetic depth image of a part: a camera's view of it half a metre ahead, in front of a wall.

use glam::{Affine3A, Vec2, Vec3};
use host_train::dataset::cloud_file::{CloudFile, write_cloud};
use host_train::dataset::depth::image::{Image, write_depth, write_mask};
use host_train::dataset::procedural;
use host_train::dataset::raster::Pinhole;
use reagent_core::Pose;
use reagent_core::pose::rotation_from_euler;
use std::path::Path;

/// Columns and rows of the image.
pub const SIZE: [usize; 2] = [160, 120];
/// The camera, as `--camera` takes it.
pub const CAMERA: &str = "200,200,79.5,59.5";

/// The part's true pose; lengths are millimetres.
pub fn camera_from_model() -> Pose {
    Pose {
        rotation: rotation_from_euler(Vec3::new(2.0, 0.4, -0.7)),
        translation: Vec3::new(20.0, -10.0, 500.0),
    }
}

/// A start about 14 degrees and 12 mm off, as `--init` takes it.
pub fn start() -> String {
    let off = Pose {
        rotation: rotation_from_euler(Vec3::new(0.15, -0.15, 0.1)),
        translation: Vec3::new(5.0, -5.0, 10.0),
    };
    let rows = off.after(camera_from_model().inverse()).to_rows();
    let numbers: Vec<String> = rows.iter().flatten().map(f32::to_string).collect();
    numbers.join(",")
}

/// Writes a part of 80 mm as a mesh, `part.ply`, and a camera's view of it in front of a wall: `depth.png` in tenths of
/// a millimetre, like the wall's distance, and `mask.png`.
pub fn write_view(at: &Path, wall: u16) {
    let mut mesh = procedural::shape(1, 1).mesh;
    for vertex in &mut mesh.vertices {
        *vertex *= 80.0;
    }
    let vertices = mesh.vertices.iter();
    let part = CloudFile {
        points: vertices.map(|v| v.to_array().map(f64::from)).collect(),
        faces: Some(mesh.faces.clone()),
        ..CloudFile::default()
    };
    write_cloud(&at.join("part.ply"), &part).expect("written");
    let camera = Pinhole {
        size: SIZE,
        focal: Vec2::splat(200.0),
        centre: Vec2::new(79.5, 59.5),
    };
    let Pose {
        rotation,
        translation,
    } = camera_from_model();
    let place = Affine3A::from_mat3_translation(rotation, translation);
    let seen = camera.inverse_depths(&mesh, &place);
    let tenths = |&inverse: &f32| match inverse > 0.0 {
        true => (10.0 / inverse).round() as u16,
        false => wall,
    };
    let depths = Image {
        size: SIZE,
        values: seen.iter().map(tenths).collect(),
    };
    write_depth(&at.join("depth.png"), &depths).expect("written");
    let mask: Vec<bool> = seen.iter().map(|&inverse| inverse > 0.0).collect();
    write_mask(&at.join("mask.png"), SIZE, &mask).expect("written");
}
