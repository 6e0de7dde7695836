//! Depth views of a mesh, as `host-train register` registers them.

use super::{CLOUD, Cdr, looking_for, next};
use clap::Parser;
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};
use host_train::cli::Cli;
use host_train::dataset::cloud_file::{CloudFile, write_cloud};
use host_train::dataset::mesh::Mesh;
use host_train::dataset::procedural;
use host_train::dataset::raster::Pinhole;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::path::Path;

/// What a camera sees of a mesh: the points of its pixels, in its frame.
fn seen(mesh: &Mesh, camera_from_mesh: &Affine3A) -> Vec<[f32; 3]> {
    let camera = Pinhole {
        size: [96, 72],
        focal: Vec2::splat(130.0),
        centre: Vec2::new(47.5, 35.5),
    };
    let image = camera.inverse_depths(mesh, camera_from_mesh);
    let pixels = image.into_iter().enumerate();
    let pixels = pixels.filter(|&(_, inverse_depth)| inverse_depth > 0.0);
    let point = |(at, inverse_depth): (usize, f32)| {
        let ray: Vec3 = camera.ray(at % camera.size[0], at / camera.size[0]);
        (ray / inverse_depth).to_array()
    };
    pixels.map(point).collect()
}

/// The pose that `host-train register` gives a view of the part: rows of [R | t], from the view to the part.
fn registered(folder: &Path, points: &[[f32; 3]]) -> [[f64; 4]; 3] {
    let at = |name: &str| folder.join(name);
    write_cloud(&at("view.npy"), &CloudFile::of(points)).expect("writable");
    let [view, part, pose] = ["view.npy", "part.ply", "pose.json"].map(at);
    let options = [
        "--view", "origin", "--init", "none", "--seed", "7", "--json",
    ];
    let names = [view.as_os_str(), part.as_os_str()].into_iter();
    let words = ["host-train", "register"].map(std::ffi::OsStr::new);
    let words = words.into_iter().chain(names);
    let words = words.chain(options.map(std::ffi::OsStr::new));
    let cli = Cli::try_parse_from(words.chain([pose.as_os_str()]));
    cli.expect("a command").run().expect("a pose");
    let said = std::fs::read(pose).expect("readable");
    let said: serde_json::Value = serde_json::from_slice(&said).expect("JSON");
    serde_json::from_value(said["target_from_source"].clone()).expect("a pose")
}

#[tokio::test(flavor = "multi_thread")]
async fn depth_views_get_the_pose_that_register_gives_them() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let mesh = procedural::shape(3, 5).mesh;
    let vertices: Vec<_> = mesh.vertices.iter().map(|v| v.to_array()).collect();
    let part = CloudFile {
        faces: Some(mesh.faces.clone()),
        ..CloudFile::of(&vertices)
    };
    write_cloud(&folder.path().join("part.ply"), &part).expect("writable");
    let options = ["--view", "--init", "none", "--seed", "7"];
    let (session, _node, [poses, diagnostics]) =
        looking_for("part.ply", folder.path(), &options).await;
    let mut given = 0;
    for turn in 0..4 {
        let rotation = Mat3A::from_rotation_x(0.7) * Mat3A::from_rotation_y(0.4 + turn as f32);
        let camera_from_mesh =
            Affine3A::from_mat3_translation(rotation.into(), Vec3A::new(0.1, -0.05, 3.0).into());
        let points = seen(&mesh, &camera_from_mesh);
        assert!(points.len() > 500, "{}", points.len());
        let cloud = Cdr::cloud(&points);
        session.put(CLOUD, cloud).await.expect("an open session");
        let said = next(&diagnostics).await;
        if !String::from_utf8_lossy(&said).contains("converged") {
            continue;
        }
        given += 1;
        let pose = next(&poses).await;
        // The last seven numbers.
        let numbers: &[u8; 56] = pose.last_chunk().expect("a pose");
        let (numbers, _) = numbers.as_chunks::<8>();
        let numbers = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes));
        let [px, py, pz, x, y, z, w] = numbers.collect::<Vec<_>>()[..] else {
            unreachable!("56 bytes");
        };
        let turn = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        let rows = registered(folder.path(), &points);
        let rotation = Matrix3::from_fn(|i, j| rows[i][j]);
        let moved = Vector3::from(rows.map(|row| row[3]));
        let turned = turn.to_rotation_matrix().matrix().transpose() - rotation;
        assert!(turned.amax() < 1e-12, "{turned}");
        let moved = Vector3::new(px, py, pz) + rotation.transpose() * moved;
        assert!(moved.amax() < 1e-12, "{moved}");
    }
    assert!(given > 1, "{given} poses");
}
