//! A control loop that follows a part in front of a depth camera:
//! `cargo run --release -p reagent-core --features pretrained-compact --example depth_camera`.
//!
//! Every frame is an image of depths in millimetres, back-projected to points. Its registration starts from the pose of the
//! frame before, and takes as many steps as the frame has time for. It is sliced, so that the loop's other work never waits for
//! more than 16 points. As in firmware, the policy is the small one in 8-bit integers, read in place, and all memory is static;
//! only `println!` and the camera need an operating system.

use reagent_core::net::Scratch;
use reagent_core::pose::rotation_from_euler;
use reagent_core::{Cloud, Error, Frame, Policy, Pose, Registrar, Registration};
use std::sync::Mutex;

const WIDTH: usize = 96;
const HEIGHT: usize = 72;
/// Focal length in pixels.
const FOCAL: f32 = 200.0;
/// Points of the model.
const MODEL: usize = 40 * 30;
/// Steps for which one frame has time.
const STEPS_A_FRAME: usize = 4;
/// Points in one slice: they take less than the loop's period.
const SLICE: usize = 16;

/// Memory of the whole loop.
struct Memory {
    scratch: Scratch,
    model: [[f32; 3]; MODEL],
    depths: [[u16; WIDTH]; HEIGHT],
    cloud: [[f32; 3]; MODEL],
}

/// The lock stands in for a microcontroller's `StaticCell`.
static MEMORY: Mutex<Memory> = Mutex::new(Memory {
    scratch: Scratch::new(),
    model: [[0.0; 3]; MODEL],
    depths: [[0; WIDTH]; HEIGHT],
    cloud: [[0.0; 3]; MODEL],
});

/// The part as designed, 80 x 60 mm: a step with a ramp beside it.
fn design(model: &mut [[f32; 3]; MODEL]) {
    for (i, point) in model.iter_mut().enumerate() {
        let (x, y) = ((i % 40) as f32 * 2.0 - 39.0, (i / 40) as f32 * 2.0 - 29.0);
        let z = match (x < -10.0, y < 0.0) {
            (true, _) => -25.0,
            (false, true) => -0.4 * (x + 10.0),
            (false, false) => 0.0,
        };
        *point = [x, y, z];
    }
}

/// Pose of the part in the camera's frame: half a metre away, drifting and turning.
fn camera_from_model(frame: usize) -> Pose {
    let t = frame as f32 * 0.1;
    Pose {
        rotation: rotation_from_euler([0.25 * t, -0.15 * t, 0.4 * t].map(f32::sin).into()),
        translation: [12.0 * t.sin(), 8.0 * t, 500.0 + 10.0 * t].into(),
    }
}

/// What the camera sees: the nearest surface at each pixel in whole millimetres, 0 where there is none.
fn picture(model: &[[f32; 3]], pose: Pose, depths: &mut [[u16; WIDTH]; HEIGHT]) {
    depths.fill([0; WIDTH]);
    for &point in model {
        let [x, y, z] = pose.apply(point.into()).to_array();
        let column = (FOCAL * x / z + WIDTH as f32 / 2.0) as usize;
        let row = (FOCAL * y / z + HEIGHT as f32 / 2.0) as usize;
        if let Some(depth) = depths.get_mut(row).and_then(|row| row.get_mut(column)) {
            let seen = z.round() as u16;
            *depth = if *depth == 0 { seen } else { seen.min(*depth) };
        }
    }
}

/// Back-projects an image to points; returns their number.
fn points(depths: &[[u16; WIDTH]; HEIGHT], cloud: &mut [[f32; 3]; MODEL]) -> usize {
    let pixels = depths.iter().enumerate().flat_map(|(row, depths)| {
        let columns = depths.iter().enumerate();
        columns.map(move |(column, &depth)| (row, column, f32::from(depth)))
    });
    let seen = pixels.filter(|&(_, _, z)| z > 0.0);
    let mut count = 0;
    for (place, (row, column, z)) in cloud.iter_mut().zip(seen) {
        let x = (column as f32 + 0.5 - WIDTH as f32 / 2.0) * z / FOCAL;
        let y = (row as f32 + 0.5 - HEIGHT as f32 / 2.0) * z / FOCAL;
        *place = [x, y, z];
        count += 1;
    }
    count
}

/// Whatever cannot wait for a step: motors, limits, the watchdog.
fn control(turns: &mut usize) {
    *turns += 1;
}

fn main() -> Result<(), Error> {
    let mut memory = MEMORY.lock().expect("nobody else uses it");
    let Memory {
        scratch,
        model,
        depths,
        cloud,
    } = &mut *memory;
    let mut registrar = Registrar::new(Policy::pretrained_compact()?, scratch);
    design(model);
    let frame_of_model = Frame::of(model)?;

    // The first guess is the place where parts are fed in.
    let mut model_from_camera = camera_from_model(0).inverse();
    println!("frame  points  steps  verdict     turns  off by mm  deg");
    for frame in 0..20 {
        let truth = camera_from_model(frame);
        picture(model, truth, depths);
        let seen = points(depths, cloud);

        let mut registration = Registration::new();
        registrar.begin(
            &mut registration,
            Cloud::F32(&cloud[..seen]),
            Cloud::F32(model),
            frame_of_model,
            model_from_camera,
        )?;
        let mut turns = 0;
        while registration.steps() < STEPS_A_FRAME && !registration.is_settled() {
            registrar.advance(&mut registration, SLICE)?;
            control(&mut turns);
        }
        model_from_camera = registration.target_from_source();

        let error = model_from_camera.after(truth);
        let cosine = (error.rotation.to_cols_array_2d().iter().enumerate())
            .map(|(i, column)| column[i])
            .sum::<f32>();
        println!(
            "{frame:>5}  {seen:>6}  {:>5}  {:<10}  {turns:>5}  {:>9.1}  {:>3.1}",
            registration.steps(),
            registration.verdict(),
            error.translation.length(),
            ((cosine - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees(),
        );
    }
    Ok(())
}
