//! Points of a depth image.

use super::*;

const CAMERA: ReagentCamera = ReagentCamera {
    fx: 2.0,
    fy: 4.0,
    cx: 1.0,
    cy: 0.5,
};
const WIDTH: usize = 3;
const DEPTH: [f32; 6] = [10.0, 0.0, 8.0, f32::NAN, 6.0, -1.0];

/// The points of an image, or why there are none.
fn points(
    camera: ReagentCamera,
    mask: Option<[u8; 6]>,
    inside: u32,
    capacity: usize,
) -> Result<Vec<[f32; 3]>, ReagentStatus> {
    let (mut room, mut count) = (vec![[9.0; 3]; capacity + 1], usize::MAX);
    let mask = mask.as_ref().map_or(null(), |mask| mask.as_ptr());
    let (xyz, height) = (room.as_mut_ptr().cast(), DEPTH.len() / WIDTH);
    // SAFETY: an image of this size, room for as many points, and a count.
    let status = unsafe {
        let depth = DEPTH.as_ptr();
        reagent_points_of_depth(
            depth, WIDTH, height, &camera, mask, inside, xyz, capacity, &mut count,
        )
    };
    match status {
        ReagentStatus::Ok => {
            assert_eq!(room[count], [9.0; 3]);
            room.truncate(count);
            Ok(room)
        }
        refused => {
            assert_eq!(count, usize::MAX);
            Err(refused)
        }
    }
}

#[test]
fn pixels_with_a_depth_are_points_in_the_cameras_frame() {
    let all = [[-5.0, -1.25, 10.0], [4.0, -1.0, 8.0], [0.0, 0.75, 6.0]];
    assert_eq!(points(CAMERA, None, 1, 10), Ok(all.to_vec()));
    let mask = Some([255, 1, 0, 1, 0, 0]);
    assert_eq!(points(CAMERA, mask, 1, 10), Ok(all[..1].to_vec()));
    assert_eq!(points(CAMERA, mask, 0, 10), Ok(all[1..].to_vec()));
    // No more than there is room for, evenly.
    assert_eq!(points(CAMERA, None, 1, 1), Ok(all[2..].to_vec()));
    assert_eq!(points(CAMERA, None, 1, 2), Ok(all[1..].to_vec()));
    assert_eq!(points(CAMERA, None, 1, 0), Ok(Vec::new()));
}

#[test]
fn a_camera_that_cannot_be_one_is_refused() {
    for camera in [
        ReagentCamera { fx: 0.0, ..CAMERA },
        ReagentCamera { fy: -4.0, ..CAMERA },
        ReagentCamera {
            cx: f32::NAN,
            ..CAMERA
        },
        ReagentCamera {
            fx: f32::INFINITY,
            ..CAMERA
        },
    ] {
        assert_eq!(points(camera, None, 1, 10), Err(ReagentStatus::BadCamera));
    }
    let mut count = 0;
    let (mut room, depth) = ([0.0f32; 3], [1.0f32]);
    // SAFETY: refused before anything is read.
    let refused = |width, height, depth: *const f32, room: *mut f32, count: *mut usize| unsafe {
        reagent_points_of_depth(depth, width, height, &CAMERA, null(), 1, room, 1, count)
    };
    let (depth, xyz) = (depth.as_ptr(), room.as_mut_ptr());
    assert_eq!(
        refused(0, 1, depth, xyz, &mut count),
        ReagentStatus::BadCamera
    );
    assert_eq!(
        refused(usize::MAX, 2, depth, xyz, &mut count),
        ReagentStatus::BadCamera
    );
    assert_eq!(
        refused(1, 1, null(), xyz, &mut count),
        ReagentStatus::Pointer
    );
    assert_eq!(
        refused(1, 1, depth, null_mut(), &mut count),
        ReagentStatus::Pointer
    );
    assert_eq!(
        refused(1, 1, depth, xyz, null_mut()),
        ReagentStatus::Pointer
    );
}
