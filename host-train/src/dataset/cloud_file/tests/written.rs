//! Clouds that are moved and written.

use super::*;

#[test]
fn what_is_written_reads_back() {
    let dir = tempfile::tempdir().expect("temporary directory");
    let mut full = CloudFile {
        points: TETRAHEDRON.into(),
        normals: Some(vec![[0.0, 0.6, -0.8]; 4]),
        colours: Some(vec![[255, 0, 7], [1, 2, 3], [0, 0, 0], [9, 9, 200]]),
        intensities: Some(vec![0.5, 1e6, -3.0, 0.0]),
        ..CloudFile::default()
    };
    let faces = Some(vec![[0, 1, 2], [0, 1, 3]]);
    for far in [0.0, 5_456_871.123_4] {
        for point in &mut full.points {
            point[1] += far;
        }
        let stl = (far == 0.0).then_some("c.stl");
        let others = ["c.ply", "c.pcd", "c.npy", "c.XYZ", "c.obj", "c.off"];
        for name in others.into_iter().chain(stl) {
            let path = dir.path().join(name);
            let mesh = ["c.ply", "c.obj", "c.off", "c.stl"].contains(&name);
            let written = CloudFile {
                faces: faces.clone().filter(|_| mesh),
                ..full.clone()
            };
            let mut expected = written.clone();
            match name {
                "c.npy" => (expected.colours, expected.intensities) = (None, None),
                "c.obj" | "c.off" => expected.intensities = None,
                // Loose triangles, of float32.
                "c.stl" => {
                    let corners = expected.faces.iter().flatten().flatten();
                    let corner =
                        |&i: &u32| expected.points[i as usize].map(|x| f64::from(x as f32));
                    expected = CloudFile {
                        points: corners.map(corner).collect(),
                        faces: Some(vec![[0, 1, 2], [3, 4, 5]]),
                        ..CloudFile::default()
                    };
                }
                _ => {}
            }
            write_cloud(&path, &written).expect("write");
            assert_eq!(read_file(&path).expect("read"), expected, "{name}");
            let bare = CloudFile {
                points: written.points.clone(),
                faces: written.faces.clone(),
                ..CloudFile::default()
            };
            write_cloud(&path, &bare).expect("write");
            let back = read_file(&path).expect("read");
            assert_eq!(
                (back.normals, back.colours, back.notes),
                (None, None, vec![]),
                "{name}"
            );
            assert_eq!(back.points, expected.points, "{name}");
        }
    }
    let refused = |name: &str| {
        let path = dir.path().join(name);
        write_cloud(&path, &CloudFile::of(&[[1.0; 3]]))
            .expect_err("not written")
            .to_string()
    };
    assert!(refused("d.stl").contains("no mesh; write it as .ply"));
    assert!(refused("d.doc").contains("written as .ply"));
    // In float32 a tetrahedron of 1 would be flat there.
    let far = CloudFile {
        points: TETRAHEDRON.map(|[x, y, z]| [x, y + 5e7, z]).into(),
        faces: Some(vec![[0, 1, 2]]),
        ..CloudFile::default()
    };
    let path = dir.path().join("far.stl");
    let said = write_cloud(&path, &far).expect_err("rounded").to_string();
    assert!(said.contains("so far from the origin; write"), "{said}");
    assert!(!path.exists() && write_cloud(&dir.path().join("far.off"), &far).is_ok());
}

#[test]
fn a_moved_cloud_turns_its_normals_and_keeps_the_rest() {
    let cloud = CloudFile {
        points: vec![[1.0, 0.0, 0.0]],
        normals: Some(vec![[0.0, 1.0, 0.0]]),
        colours: Some(vec![[1, 2, 3]]),
        intensities: Some(vec![4.0]),
        faces: Some(vec![[0, 0, 0]]),
        ..CloudFile::default()
    };
    let quarter = [
        [0.0, -1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 5.0],
    ];
    let moved = cloud.moved(&Pose64::from_rows(quarter));
    assert_eq!(moved.points, [[0.0, 1.0, 5.0]]);
    assert_eq!(moved.normals, Some(vec![[-1.0, 0.0, 0.0]]));
    assert_eq!(
        (moved.colours, moved.intensities, moved.faces),
        (cloud.colours, cloud.intensities, cloud.faces)
    );
}

#[test]
fn far_clouds_are_taken_relative_to_their_middle() {
    let mut cloud = CloudFile::of(&[[0.0; 3], [1.0, 0.0, 0.0]]);
    assert_eq!(cloud.origin(), [0.0; 3]);
    for point in &mut cloud.points {
        point[1] += 5_456_871.0;
    }
    assert_eq!(cloud.origin(), [1.0, 5_456_871.0, 0.0]);
    assert_eq!(
        cloud.relative_to(cloud.origin()),
        [[-1.0, 0.0, 0.0], [0.0; 3]]
    );
    let mesh = CloudFile {
        points: TETRAHEDRON.map(|[x, y, z]| [x, y + 5e6, z]).into(),
        faces: Some(vec![[0, 1, 2]]),
        ..CloudFile::default()
    };
    let drawn = mesh
        .sampled(200, &mut stream(1, Purpose::Surface, 0))
        .expect("area");
    let inside = |p: &&Position| p[2] == 0.0 && p[0] + (p[1] - 5e6) < 1.0 + 1e-6 && p[1] >= 5e6;
    assert_eq!(drawn.points.iter().filter(inside).count(), 200);
}
