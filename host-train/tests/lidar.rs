//! Two lidar scans, whose points crowd around the sensor: scene must be aligned with scene, not sensor with sensor.

mod support;

use glam::Vec3;
use host_train::dataset::Point;
use host_train::dataset::cloud_file::{CloudFile, write_cloud};
use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use support::{folder, read_json, succeed};

/// Farthest return, in metres.
const RANGE: f32 = 40.0;

/// Corners of boxes that stand on the ground beside a road along x: buildings, cars and poles.
fn street(rng: &mut Rng) -> Vec<[Vec3; 2]> {
    let kinds = [
        (4, 12.0, Vec3::new(7.0, 4.0, 9.0)),
        (6, 5.0, Vec3::new(2.1, 0.9, 1.5)),
        (8, 6.0, Vec3::new(0.2, 0.2, 5.0)),
    ];
    let mut boxes = Vec::new();
    for (count, beside, size) in kinds {
        for _ in 0..count {
            let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            let x = rng.random_range(-30.0..30.0);
            let y = side * rng.random_range(beside..beside + 15.0);
            let half = Vec3::new(size.x, size.y, 0.0) * rng.random_range(0.8..1.2);
            let foot = Vec3::new(x, y, 0.0);
            boxes.push([foot - half, foot + half + Vec3::Z * size.z]);
        }
    }
    boxes
}

/// What 32 beams see in one turn, relative to the sensor, with 2 cm of noise.
fn scan(boxes: &[[Vec3; 2]], sensor: Vec3, rng: &mut Rng) -> Vec<Point> {
    let mut points = Vec::new();
    for beam in 0..32 {
        let (up, level) = (-25.0 + beam as f32 * 40.0 / 31.0).to_radians().sin_cos();
        for half_degree in 0..720 {
            let (y, x) = (half_degree as f32 / 2.0).to_radians().sin_cos();
            let ray = Vec3::new(x * level, y * level, up);
            let ground = if up < 0.0 { -sensor.z / up } else { RANGE };
            let hit = boxes.iter().fold(ground, |nearest, [low, high]| {
                let (a, b) = ((low - sensor) / ray, (high - sensor) / ray);
                let (enters, leaves) = (a.min(b).max_element(), a.max(b).min_element());
                match 0.0 < enters && enters <= leaves {
                    true => nearest.min(enters),
                    false => nearest,
                }
            });
            if hit < RANGE {
                let noise = rng.random_range(-0.035..0.035);
                points.push((ray * (hit + noise)).to_array());
            }
        }
    }
    points
}

#[test]
fn the_scene_is_laid_on_the_scene_and_not_the_sensor_on_the_sensor() {
    let folder = folder();
    let at = folder.path();
    // In these scenes, points spread as all points are align sensor with sensor.
    for seed in 2..6 {
        let rng = &mut stream(seed, Purpose::Scene, 0);
        let boxes = street(rng);
        let sensors = [Vec3::new(-3.0, 0.0, 1.8), Vec3::new(4.0, 1.0, 1.8)];
        for (name, sensor) in ["s.ply", "t.ply"].into_iter().zip(sensors) {
            let points = scan(&boxes, sensor, rng);
            write_cloud(&at.join(name), &CloudFile::of(&points)).expect("written");
        }
        let apart = sensors[0] - sensors[1];
        let init = format!("1,0,0,{},0,1,0,{},0,0,1,0", apart.x, apart.y);
        succeed(
            at,
            &format!("register s.ply t.ply --init={init} --json p.json"),
        );
        let pose = &read_json(&at.join("p.json"))["target_from_source"];
        let found = [0, 1, 2].map(|row| pose[row][3].as_f64().expect("a number") as f32);
        let off = Vec3::from(found).distance(apart);
        assert!(off < 0.3, "scene {seed}: {off} m off");
    }
}
