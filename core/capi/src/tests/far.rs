//! Clouds far from the origin.

use super::*;

#[test]
fn clouds_far_from_the_origin_keep_their_digits() {
    let there = [
        [483_221.0, 5_456_871.0, 310.0],
        [483_250.0, 5_456_840.0, 300.0],
    ];
    let clouds = there.map(|at: [f64; 3]| -> Vec<[f64; 3]> {
        let near = bracket(0.0).into_iter();
        near.map(|p| core::array::from_fn(|k| f64::from(p[k]) + at[k]))
            .collect()
    });
    let mut origins = [[0.0f64; 3]; 2];
    let mut near = clouds
        .each_ref()
        .map(|cloud| vec![[0.0f32; 3]; cloud.len()]);
    for ((cloud, origin), near) in clouds.iter().zip(&mut origins).zip(&mut near) {
        let [xyz, origin, near] = [cloud.as_ptr().cast(), origin.as_ptr(), near.as_ptr().cast()];
        // SAFETY: as many doubles and floats as stated.
        let told = unsafe {
            reagent_take_origin_off(xyz, cloud.len(), origin.cast_mut(), near.cast_mut().cast())
        };
        assert_eq!(told, ReagentStatus::Ok);
    }
    // For one cloud in two places, the origins differ as the places do, and the relative points are the same.
    for k in 0..3 {
        let apart = there[1][k] - there[0][k];
        assert!((origins[1][k] - origins[0][k] - apart).abs() < 1e-6);
    }
    let turned = Pose {
        rotation: reagent_core::pose::rotation_from_euler([0.3, -0.2, 0.5].into()),
        translation: [1.0, 2.0, 3.0].into(),
    };
    let given = ReagentPose::from(turned);
    let (mut rows, mut back) = ([[0.0f64; 4]; 3], ReagentPose::default());
    let [from, to] = origins.each_ref().map(|origin| origin.as_ptr());
    // SAFETY: twelve doubles, and three for each origin.
    let told = unsafe { reagent_far_pose(&given, from, to, rows.as_mut_ptr().cast()) };
    assert_eq!(told, ReagentStatus::Ok);
    // SAFETY: as above.
    let told = unsafe { reagent_near_pose(rows.as_ptr().cast(), from, to, &mut back) };
    assert_eq!(told, ReagentStatus::Ok);
    for (a, b) in given
        .rows
        .as_flattened()
        .iter()
        .zip(back.rows.as_flattened())
    {
        assert!((a - b).abs() < 1e-6, "{given:?} {back:?}");
    }
    // A point's coordinates agree to a tenth of a millimetre, and the rotation is orthonormal to all digits.
    let p = clouds[0][17];
    let [x, y, z] = turned.apply(near[0][17].into()).to_array().map(f64::from);
    for (k, [row, near]) in rows
        .iter()
        .zip([x, y, z])
        .map(|(r, n)| [r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3], n])
        .enumerate()
    {
        assert!((row - near - origins[1][k]).abs() < 1e-4);
        let [a, b, c, _] = rows[k];
        assert!((a * a + b * b + c * c - 1.0).abs() < 1e-12);
    }
    // SAFETY: null is refused.
    let told = unsafe { reagent_far_pose(&given, core::ptr::null(), to, rows.as_mut_ptr().cast()) };
    assert_eq!(told, ReagentStatus::Pointer);
}

#[test]
fn what_is_no_pose_and_no_place_is_refused() {
    let here = [0.0f64; 3];
    let none = [0.0, f64::NAN, 0.0];
    let far = [0.0, 0.0, 1e13];
    let unit = ReagentPose::from(Pose::IDENTITY);
    let bent = ReagentPose {
        rows: [[2.0; 4]; 3],
    };
    let rows = unit.rows.map(|row| row.map(f64::from));
    let bent_rows = bent.rows.map(|row| row.map(f64::from));
    let mut away = rows;
    away[0][3] = 1e300;
    let (mut pose, mut into) = (ReagentPose::default(), [[0.0f64; 4]; 3]);
    let (mut origin, mut near) = ([0.0f64; 3], [0.0f32; 6]);
    let clouds = [[1.0, 2.0, 3.0, 4.0, 5.0, 1e300], [f64::NAN; 6]];
    use ReagentStatus::*;
    // SAFETY: pointers to live values.
    let found = unsafe {
        let far_pose = |pose: &ReagentPose, from: &[f64; 3], into: &mut [[f64; 4]; 3]| {
            reagent_far_pose(pose, from.as_ptr(), here.as_ptr(), into.as_mut_ptr().cast())
        };
        let near_pose = |rows: &[[f64; 4]; 3], to: &[f64; 3], into: &mut ReagentPose| {
            reagent_near_pose(rows.as_ptr().cast(), here.as_ptr(), to.as_ptr(), into)
        };
        let mut take_off = |cloud: &[f64; 6]| {
            reagent_take_origin_off(cloud.as_ptr(), 2, origin.as_mut_ptr(), near.as_mut_ptr())
        };
        [
            (far_pose(&unit, &none, &mut into), NotFinite),
            (far_pose(&unit, &far, &mut into), NotFinite),
            (far_pose(&bent, &here, &mut into), BadPose),
            (near_pose(&rows, &none, &mut pose), NotFinite),
            (near_pose(&bent_rows, &here, &mut pose), BadPose),
            (near_pose(&away, &here, &mut pose), BadPose),
            (take_off(&clouds[0]), NotFinite),
            (take_off(&clouds[1]), NotFinite),
        ]
    };
    for (index, (found, expected)) in found.into_iter().enumerate() {
        assert_eq!(found, expected, "call {index}");
    }
    assert_eq!((pose, into), (ReagentPose::default(), [[0.0; 4]; 3]));
    assert_eq!((origin, near), ([0.0; 3], [0.0; 6]));
}
