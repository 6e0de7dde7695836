//! Small files of each kind, whole and broken.

use super::*;
use proptest::prelude::*;
use std::io::Write;

const TETRAHEDRON: [Position; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 2.0],
];
const OFF: &str =
    "OFF # a tetrahedron\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 2\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\nproperty uchar red\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0 9\n1 0 0 9\n0 1 0 9\n0 0 2 9\n3 0 1 2\n4 0 1 2 3\n";
const OBJ: &str =
    "mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\no a\nf 1 2 3\nf 1/1 2/2 3/3 4/4\n";
const STL: &str = "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid t\n";
const PCD: &str = "VERSION .7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA ascii\n0 0 0 1\nnan nan nan 1\n1 2 3 1\n";

fn pcd_binary(kind: &str, payload: &[u8]) -> Vec<u8> {
    let header = PCD.split("DATA").next().unwrap_or_default();
    [header.as_bytes(), b"DATA ", kind.as_bytes(), b"\n", payload].concat()
}

fn read(name: &str, bytes: &[u8]) -> Result<CloudFile, CloudError> {
    let mut file = tempfile::Builder::new()
        .suffix(name)
        .tempfile()
        .expect("temporary file");
    file.write_all(bytes).expect("write");
    read_file(file.path())
}

fn refused(name: &str, bytes: &[u8]) -> String {
    read(name, bytes).expect_err("must be refused").to_string()
}

#[test]
fn meshes_of_every_kind() {
    let off = read(".off", OFF.as_bytes()).expect("off");
    assert_eq!(off.points, TETRAHEDRON);
    assert_eq!(
        off.faces,
        Some(vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    );
    let glued = OFF.replace("OFF # a tetrahedron\n", "OFF");
    assert_eq!(read(".OFF", glued.as_bytes()).expect("off"), off);

    let ply = read(".ply", PLY.as_bytes()).expect("ply");
    assert_eq!(ply.points, TETRAHEDRON);
    assert_eq!(ply.faces, Some(vec![[0, 1, 2], [0, 1, 2], [0, 2, 3]]));

    let obj = read(".obj", OBJ.as_bytes()).expect("obj");
    assert_eq!(obj.points, TETRAHEDRON);
    assert_eq!(obj.faces, Some(vec![[0, 1, 2], [0, 1, 2], [0, 2, 3]]));

    let stl = read(".stl", STL.as_bytes()).expect("stl");
    assert_eq!(
        (stl.points.as_slice(), stl.faces),
        (&TETRAHEDRON[..3], Some(vec![[0, 1, 2]]))
    );
}

#[test]
fn clouds_of_every_kind() {
    let xyz = read(".xyz", b"# made by hand\n0 0 0\n1,0,0\n\n0\t1e0\t0\n").expect("xyz");
    assert_eq!(
        (xyz.points.as_slice(), xyz.faces),
        (&TETRAHEDRON[..3], None)
    );

    let pcd = read(".pcd", PCD.as_bytes()).expect("pcd");
    assert_eq!(
        (pcd.points.as_slice(), pcd.notes.last()),
        (
            &[[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]][..],
            Some(&Note::Dropped {
                points: 1,
                faces: 0
            })
        )
    );
    let numbers = [
        0.0f32,
        0.0,
        0.0,
        1.0,
        f32::NAN,
        0.0,
        0.0,
        1.0,
        1.0,
        2.0,
        3.0,
        1.0,
    ];
    let payload: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(
        read(".pcd", &pcd_binary("binary", &payload)).expect("pcd"),
        pcd
    );

    let bare = read(".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n").expect("obj");
    assert_eq!(
        (bare.points.as_slice(), bare.faces),
        (&TETRAHEDRON[..3], None)
    );
}

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
        for name in [
            "c.ply", "c.pcd", "c.npy", "c.XYZ", "c.obj", "c.off", "c.stl",
        ] {
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

#[test]
fn normals_are_kept_where_all_are_defined() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float nx\nproperty float x\nproperty float y\nproperty float z\nproperty float ny\nproperty float nz\nend_header\n0 1 2 3 0 2\n1 4 5 6 0 0\n";
    let file = read(".ply", ply.as_bytes()).expect("ply");
    assert_eq!(file.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(file.normals, Some(vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]));
    assert_eq!(
        read(".ply", ply.replace("0 1 2 3 0 2", "0 1 2 3 0 0").as_bytes())
            .expect("ply")
            .normals,
        None
    );

    // Padding lies between the fields as the point cloud library writes them.
    let pcd = "VERSION .7\nFIELDS x y z _ normal_x normal_y normal_z _\nSIZE 4 4 4 1 4 4 4 1\nTYPE F F F U F F F U\nCOUNT 1 1 1 4 1 1 1 4\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n";
    let mut bytes = pcd.as_bytes().to_vec();
    for row in [[1.0f32, 2.0, 3.0], [0.0, 1.0, 0.0]] {
        bytes.extend(row.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([9; 4]);
    }
    let file = read(".pcd", &bytes).expect("pcd");
    assert_eq!(
        (file.points, file.normals),
        (vec![[1.0, 2.0, 3.0]], Some(vec![[0.0, 1.0, 0.0]]))
    );

    let mesh = CloudFile {
        points: TETRAHEDRON.into(),
        faces: Some(vec![[0, 1, 2], [0, 3, 1]]),
        ..CloudFile::default()
    }
    .mesh();
    for (point, normal) in mesh.sample_with_normals(100, &mut stream(1, Purpose::Surface, 0)) {
        assert_eq!(
            normal,
            if point[2] == 0.0 {
                [0.0, 0.0, 1.0]
            } else {
                [0.0, 1.0, 0.0]
            }
        );
    }
}

fn npy(descr: &str, order: &str, shape: &str, payload: &[u8]) -> Vec<u8> {
    let dictionary =
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({shape}), }}\n");
    let length = (dictionary.len() as u16).to_le_bytes();
    [
        b"\x93NUMPY\x01\x00",
        &length[..],
        dictionary.as_bytes(),
        payload,
    ]
    .concat()
}

#[test]
fn arrays_of_both_orders_and_widths() {
    let expected = [[0.0, 1.0, 2.0], [4.0, 5.0, 6.0]];
    let rows: Vec<u8> = (0..8).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    assert_eq!(
        read(".npy", &npy("<f8", "False", "2, 4", &rows))
            .expect("npy")
            .points,
        expected
    );
    let columns = [0.0f32, 4.0, 1.0, 5.0, 2.0, 6.0];
    let bytes: Vec<u8> = columns.iter().flat_map(|x| x.to_be_bytes()).collect();
    assert_eq!(
        read(".npy", &npy(">f4", "True", "2, 3", &bytes))
            .expect("npy")
            .points,
        expected
    );
    // The longer axis holds the points.
    let long = npy(
        "<f4",
        "False",
        "3, 4",
        &[
            [0.0f32, 1.0, 2.0, 3.0],
            [4.0, 5.0, 6.0, 7.0],
            [8.0, 9.0, 10.0, 11.0],
        ]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect::<Vec<u8>>(),
    );
    let file = read(".npy", &long).expect("npy");
    assert_eq!((file.points.len(), file.points[1]), (4, [1.0, 5.0, 9.0]));
    assert_eq!(
        file.notes,
        [Note::LongerAxis {
            rows: 3,
            columns: 4
        }]
    );
    let image = npy(
        "<i4",
        "False",
        "2, 2, 3",
        &(0..12i32).flat_map(i32::to_le_bytes).collect::<Vec<u8>>(),
    );
    assert_eq!(
        read(".npy", &image).expect("npy").points[3],
        [9.0, 10.0, 11.0]
    );
    // Six columns that are no unit vectors are something else than normals.
    let colours: Vec<u8> = [1.0f32, 2.0, 3.0, 255.0, 0.0, 7.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    assert_eq!(
        read(".npy", &npy("<f4", "False", "1, 6", &colours))
            .expect("npy")
            .normals,
        None
    );

    assert!(refused(".npy", &npy("<c8", "False", "2, 3", &bytes)).contains("expected float32"));
    assert!(refused(".npy", &npy("<f4", "False", "3, 2", &bytes)).contains("its shape is (3, 2)"));
    assert!(
        refused(".npy", &npy("<f4", "False", "6,", &bytes))
            .contains("its shape is (6,), expected (N, 3)")
    );
    assert!(
        refused(".npy", &npy("<f4", "False", "1099511627776, 3", &bytes))
            .contains("but 6 numbers follow")
    );
    assert!(
        refused(
            ".npy",
            &npy(
                "<f4",
                "False",
                "9223372036854775807, 9223372036854775807",
                &bytes
            )
        )
        .contains("6 numbers")
    );
    assert!(refused(".npy", b"\x93NUMPY\x02\x00\xff\xff\xff\xff{").contains("inside its header"));
}

#[test]
fn meshes_as_programs_write_them() {
    let relative = read(".obj", b"# M\xfcller\nv 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//1 \\\n -2//1 -1//1\nv 0 0 2\nf 1 2 4\n");
    let relative = relative.expect("obj");
    assert_eq!(
        (relative.points.as_slice(), relative.faces),
        (&TETRAHEDRON[..], Some(vec![[0, 1, 2], [0, 1, 3]]))
    );
    for (bad, line) in [
        ("f 1 2 9", "line 4"),
        ("f 0 1 2", "line 4"),
        ("f -4 1 2", "line 4"),
        ("f 1 2 x", "line 4"),
        ("v 1 2", "line 4"),
    ] {
        let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{bad}\n");
        assert!(refused(".obj", text.as_bytes()).contains(line), "{bad}");
    }

    let two = STL.replace("solid t\n", "solid\n");
    assert_eq!(
        read(".stl", format!("{two}{STL}").as_bytes())
            .expect("two solids")
            .faces
            .map(|f| f.len()),
        Some(2)
    );
    let mut binary = [
        &b"solid made by a program"[..],
        &[b' '; 57],
        &1u32.to_le_bytes(),
        &[0; 12],
    ]
    .concat();
    binary.extend(
        TETRAHEDRON[..3]
            .iter()
            .flatten()
            .flat_map(|&x| (x as f32).to_le_bytes())
            .chain([0, 0]),
    );
    assert_eq!(
        read(".stl", &binary).expect("binary").points,
        TETRAHEDRON[..3]
    );
    assert!(
        refused(".stl", STL.replace("vertex 1 0 0\n", "").as_bytes())
            .contains("line 7: the facet does not have three corners")
    );
    assert!(
        refused(".stl", STL.replace("endsolid t\n", "").as_bytes()).contains("before endsolid")
    );

    let big_endian = "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let numbers: Vec<u8> = [1.0f32, 2.0, 3.0]
        .iter()
        .flat_map(|x| x.to_be_bytes())
        .collect();
    assert_eq!(
        read(".ply", &[big_endian.as_bytes(), &numbers].concat())
            .expect("ply")
            .points,
        [[1.0, 2.0, 3.0]]
    );
}

#[test]
fn meshes_are_sampled_and_clouds_taken_as_they_are() {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("t.off");
    std::fs::write(&path, OFF).expect("write");
    let cloud = read_cloud(&path, 1).expect("points");
    assert_eq!(cloud.points.len(), MESH_POINTS);
    assert_eq!(cloud, read_cloud(&path, 1).expect("points"));
    assert_ne!(cloud, read_cloud(&path, 2).expect("points"));
    let inside =
        |&[x, y, z]: &Position| x >= 0.0 && y >= 0.0 && z >= 0.0 && x + y + z / 2.0 < 1.0 + 1e-5;
    assert!(cloud.points.iter().all(inside));
    std::fs::write(
        &path,
        OFF.replace("1 0 0", "0 0 0").replace("0 1 0", "0 0 0"),
    )
    .expect("write");
    assert!(matches!(
        read_cloud(&path, 1),
        Err(CloudError::NoArea { .. })
    ));

    let path = dir.path().join("t.xyz");
    std::fs::write(&path, "1 2 3\n4 5 6\n").expect("write");
    assert_eq!(
        read_cloud(&path, 1).expect("points").points,
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    );
}

#[test]
fn refusals_say_what_and_where() {
    assert!(
        refused(".doc", b"").contains(".ply .pcd .xyz .txt .asc .csv .pts .npy .off .obj or .stl")
    );
    assert!(matches!(
        read_file(Path::new("no/such.ply")),
        Err(CloudError::Io { .. })
    ));
    assert!(refused(".xyz", b"").contains("no points"));
    assert!(
        refused(".xyz", b"0 0 0\n1 2\n")
            .contains("line 2: expected three coordinates, found \"1 2\"")
    );
    assert!(refused(".xyz", b"inf 0 0\nnan 0 0\n").contains("no points (2 invalid"));
    assert!(refused(".xyz", b"\xff\xfe1").contains("like UTF-16"));
    assert!(refused(".xyz", b"1\0 \x002\0").contains("not text"));
    assert!(refused(".off", &OFF.as_bytes()[..38]).contains("it ends after"));
    assert!(
        refused(".off", OFF.replace("3 1 2 3", "3 1 2 9").as_bytes())
            .contains("face 3 names vertex 9 of 4")
    );
    assert!(refused(".off", OFF.replace("3 1 2 3", "4 1 2 3").as_bytes()).contains("line 10"));
    assert!(refused(".off", b"OFF\n99999999999 0 0\n").contains("it ends after 0"));
    assert!(
        refused(".ply", PLY.replace("float z", "float w").as_bytes()).contains("lack x, y or z")
    );
    assert!(
        refused(
            ".ply",
            PLY.replace("vertex 4", "vertex 4000000000").as_bytes()
        )
        .contains("do not fit")
    );
    assert!(
        refused(".ply", PLY.replace("3 0 1 2", "3 0 1 -2").as_bytes())
            .contains("names vertex 4294967295")
    );
    assert!(refused(".ply", &PLY.as_bytes()[..PLY.len() - 10]).contains("end of file"));
    assert!(refused(".pcd", PCD.replace("1 2 3 1\n", "").as_bytes()).contains("point 2"));
    assert!(refused(".pcd", &pcd_binary("binary", &[0; 47])).contains("do not fit"));
    assert!(
        refused(
            ".pcd",
            &pcd_binary(
                "binary_compressed",
                &[255, 255, 255, 255, 255, 255, 255, 255, 1]
            )
        )
        .contains("do not fit")
    );
    assert!(
        refused(
            ".pcd",
            PCD.replace("0 0 0 1\n", "nan 0 0 1\n")
                .replace("1 2 3 1\n", "inf 0 0 1\n")
                .as_bytes()
        )
        .contains("3 invalid")
    );
    let binary = [&[b' '; 80][..], &2u32.to_le_bytes(), &[0; 50]].concat();
    assert!(refused(".stl", &binary).contains("claims 2 triangles and holds 1"));
}

proptest! {
    #[test]
    fn flips_and_cuts_never_panic(kind in 0usize..7, at: prop::sample::Index, value: u8, cut: prop::sample::Index) {
        let payload: Vec<u8> = (0..12).flat_map(|i| (i as f32).to_le_bytes()).collect();
        let whole = [
            (".off", OFF.as_bytes().to_vec()), (".ply", PLY.as_bytes().to_vec()), (".obj", OBJ.as_bytes().to_vec()),
            (".stl", STL.as_bytes().to_vec()), (".pcd", PCD.as_bytes().to_vec()), (".pcd", pcd_binary("binary", &payload)),
            (".ply", ply::emit(&CloudFile { points: TETRAHEDRON.into(), ..CloudFile::default() })),
        ];
        let (name, bytes) = &whole[kind];
        let mut flipped = bytes.clone();
        flipped[at.index(bytes.len())] = value;
        let _ = read(name, &flipped);
        let _ = read(name, &bytes[..cut.index(bytes.len())]);
    }
}

#[test]
fn text_as_programs_and_countries_write_it() {
    let expected: Vec<Position> = vec![[1.5, -2.25, 3.0], [4.0, 5.5, 6.0], [7.0, 8.0, 9.5]];
    for (text, notes) in [
        ("1.5 -2.25 3\n4 5.5 6\n7 8 9.5\n", vec![]),
        ("3\r\n1.5 -2.25 3\r\n4 5.5 6\r\n7 8 9.5\r\n", vec![]),
        ("\u{feff}X Y Z\n1.5 -2.25 3\n4 5.5 6\n7 8 9.5\n", vec![]),
        ("//X Y Z\n3\n1.5 -2.25 3\n4 5.5 6\n7 8 9.5\n", vec![]),
        (
            "\"x\",\"y\",\"z\"\n1.5, -2.25, 3\n4,5.5,6,\n7,8,9.5\n",
            vec![],
        ),
        ("z;x [m];y\n3;1.5;-2.25\n6;4;5.5\n9.5;7;8\n", vec![]),
        (
            "Northing\tEasting\tElevation\n-2.25\t1.5\t3\n5.5\t4\t6\n8\t7\t9.5\n",
            vec![],
        ),
        ("1,5;-2,25;3\n4;5,5;6\n7;8;9,5\n", vec![Note::DecimalComma]),
        (
            "1,5 -2,25 3\n4 5,5 6\n7\t8\t9,5\n",
            vec![Note::DecimalComma],
        ),
        (
            "0 1.5 -2.25 3\n1 4 5.5 6\n2 7 8 9.5\n",
            vec![Note::IndexColumn],
        ),
        (",x,y,z\n0,1.5,-2.25,3\n1,4,5.5,6\n2,7,8,9.5\n", vec![]),
        (
            "x,y,z,time\n1.5,-2.25,3,0\n,,,1\n4,5.5,6,2\nnan,1,1,3\n7,8,9.5,4\n",
            vec![
                Note::Ignored {
                    what: "columns time".into(),
                },
                Note::Dropped {
                    points: 2,
                    faces: 0,
                },
            ],
        ),
        (
            "9\n1.5 -2.25 3\n4 5.5 6\n7 8 9.5\n",
            vec![Note::Count {
                what: "points",
                claimed: 9,
                read: 3,
            }],
        ),
    ] {
        let file = read(".csv", text.as_bytes()).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        assert_eq!(
            (file.points, file.notes),
            (expected.clone(), notes),
            "{text:?}"
        );
        for order in [u16::to_le_bytes, u16::to_be_bytes] {
            let marked = format!("\u{feff}{}", text.trim_start_matches('\u{feff}'));
            let wide: Vec<u8> = marked.encode_utf16().flat_map(order).collect();
            let file = read(".asc", &wide).expect("utf-16");
            assert_eq!(
                (file.points, file.notes.first()),
                (expected.clone(), Some(&Note::Utf16))
            );
        }
    }
}

#[test]
fn what_could_be_read_in_two_ways_is_refused() {
    for (text, words) in [
        ("9,525,7,458,3,950\n", "could be decimal commas"),
        ("1,234.5 2,345.6 3,456.7\n", "expected three coordinates"),
        ("1.234,5;2.345,6;3.456,7\n", "expected three coordinates"),
        ("1,5 2,5 3,5\n1.5 2.5 3.5\n", "line 2: a decimal point"),
        ("1.5 2.5 3.5\n1,5 2,5 3,5\n", "line 2: a decimal comma"),
        (
            "1,5;2,5;3,5\n1,2,3\n",
            "line 2: expected numbers with a decimal comma",
        ),
        (
            "1 2 3\n1 2 3 4\n",
            "line 2: 4 columns, where the lines before have 3",
        ),
        (
            "a b c\n1 2 3\n",
            "line 1: expected three coordinates, found \"a b c\"",
        ),
        ("x y z\n1 2 3\nx y z\n", "line 3"),
        ("x y z nx\n1 2\n", "line 2"),
        ("1 2 abc\n", "line 1"),
        ("\u{7}\u{1b}[31m 2 3\n", "found \"??[31m 2 3\""),
    ] {
        let said = refused(".txt", text.as_bytes());
        assert!(said.contains(words), "{text:?}: {said}");
    }
    // Whole numbers with names, or of three columns, are unambiguous.
    assert!(read(".csv", b"x,y,z,r,g,b\n1,2,3,4,5,6\n").is_ok());
    assert_eq!(
        read(".csv", b"1,2,3\n").expect("csv").points,
        [[1.0, 2.0, 3.0]]
    );
}

#[test]
fn columns_beyond_the_coordinates_are_what_they_look_like() {
    let read = |text: &str| read(".pts", text.as_bytes()).expect("pts");
    let file = read("2\n1 2 3 -800 120 121 122\n4 5 6 9 0 0 255\n");
    assert_eq!(file.intensities, Some(vec![-800.0, 9.0]));
    assert_eq!(file.colours, Some(vec![[120, 121, 122], [0, 0, 255]]));
    let file = read("1 2 3 0 0.6 0.8\n");
    assert_eq!(
        (file.normals, file.colours),
        (Some(vec![[0.0, 0.6, 0.8]]), None)
    );
    let file = read("1 2 3 200 100 0\n");
    assert_eq!(file.colours, Some(vec![[200, 100, 0]]));
    let file = read("1 2 3 0.5 0.5 7\n");
    assert_eq!((&file.normals, &file.colours), (&None, &None));
    assert!(file.notes[0].to_string().contains("last three columns"));
    let file = read("#x y z Scalar_Intensity R G B\n1 2 3 5 6 7 8\n");
    assert_eq!(
        (file.intensities, file.colours),
        (Some(vec![5.0]), Some(vec![[6, 7, 8]]))
    );
}

#[test]
fn invalid_points_go_with_their_faces() {
    let ply = PLY.replace("1 0 0 9", "3.4e38 0 0 9");
    let file = read(".ply", ply.as_bytes()).expect("ply");
    assert_eq!(
        file.points,
        [TETRAHEDRON[0], TETRAHEDRON[2], TETRAHEDRON[3]]
    );
    // Of the triangle and the polygon cut in two, one triangle has no invalid corner.
    assert_eq!(file.faces, Some(vec![[0, 1, 2]]));
    assert!(file.notes.contains(&Note::Dropped {
        points: 1,
        faces: 2
    }));
    let off = OFF.replace("1 0 0", "nan 0 0");
    let file = read(".off", off.as_bytes()).expect("off");
    assert_eq!(file.faces, Some(vec![[0, 1, 2]]));
    let stl = STL.replace("1 0 0", "inf 0 0");
    assert!(
        read(".stl", stl.as_bytes())
            .expect("stl")
            .faces
            .is_some_and(|f| f.is_empty())
    );
}

#[test]
fn strips_of_triangles() {
    let strips = "element tristrips 1\nproperty list int int vertex_indices";
    let ply = PLY
        .replace(
            "element face 2\nproperty list uchar int vertex_indices",
            strips,
        )
        .replace("3 0 1 2\n4 0 1 2 3\n", "8 0 1 2 3 -1 3 2 1\n");
    let file = read(".ply", ply.as_bytes()).expect("ply");
    assert_eq!(file.faces, Some(vec![[0, 1, 2], [2, 1, 3], [3, 2, 1]]));
    let bad = ply.replace("3 -1", "9 -1");
    assert!(refused(".ply", bad.as_bytes()).contains("names vertex 9 of 4"));
}

/// The outline of a U of area 7, once as a polygon in each format that has them.
#[test]
fn polygons_with_a_notch_keep_it_open() {
    let outline = [
        [0, 0],
        [3, 0],
        [3, 3],
        [2, 3],
        [2, 1],
        [1, 1],
        [1, 3],
        [0, 3],
    ];
    let rows = |prefix: &str| {
        outline
            .map(|[x, y]| format!("{prefix}{x} {y} 0\n"))
            .concat()
    };
    let face = |first: u32| {
        (first..first + 8)
            .map(|i| format!(" {i}"))
            .collect::<String>()
    };
    let header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for (name, text) in [
        (".off", format!("OFF\n8 1 0\n{}8{}\n", rows(""), face(0))),
        (".obj", format!("{}f{}\n", rows("v "), face(1))),
        (".ply", format!("{header}{}8{}\n", rows(""), face(0))),
    ] {
        let area = read(name, text.as_bytes()).expect("mesh").mesh().area();
        assert!((area - 7.0).abs() < 1e-5, "{name}: {area}");
    }
}

#[test]
fn stereolithography_with_wrong_counts_and_shouting_names() {
    let upper = STL.to_uppercase().replace("SOLID T", "SOLID T\u{e4}");
    assert_eq!(
        read(".stl", upper.as_bytes()).expect("stl").points,
        TETRAHEDRON[..3]
    );
    let latin: Vec<u8> = upper.chars().map(|c| c as u8).collect();
    assert_eq!(read(".stl", &latin).expect("stl").points, TETRAHEDRON[..3]);
    let triangle: Vec<u8> = [[0.0f32; 3], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .chain([0, 0])
        .collect();
    let binary = |claimed: u32, rest: &[u8]| {
        let header = [b"solid but binary".to_vec(), vec![b' '; 64]].concat();
        [
            &header[..],
            &claimed.to_le_bytes(),
            &triangle,
            &triangle,
            rest,
        ]
        .concat()
    };
    for (claimed, rest, triangles, note) in [
        (2, &[][..], 2, None),
        (
            0,
            &[],
            2,
            Some(Note::Count {
                what: "triangles",
                claimed: 0,
                read: 2,
            }),
        ),
        (
            1,
            &[],
            2,
            Some(Note::Count {
                what: "triangles",
                claimed: 1,
                read: 2,
            }),
        ),
        (
            2,
            &[7; 9],
            2,
            Some(Note::Ignored {
                what: "what follows the triangles".into(),
            }),
        ),
    ] {
        let file = read(".stl", &binary(claimed, rest)).expect("stl");
        assert_eq!(
            (file.points.len(), file.notes.first()),
            (3 * triangles, note.as_ref())
        );
    }
    assert!(refused(".stl", &binary(3, &[0; 20])).contains("claims 3 triangles and holds 2"));
}

#[test]
fn contents_tell_what_standard_input_is() {
    let texts = [
        (OFF, "off"),
        (PLY, "ply"),
        (OBJ, "obj"),
        (STL, "stl"),
        (PCD, "pcd"),
        ("1 2 3\n", "xyz"),
    ];
    for (text, kind) in texts {
        assert_eq!(kind_of(text.as_bytes()), kind);
    }
    assert_eq!(kind_of(&npy("<f4", "False", "0, 3", b"")), "npy");
    assert_eq!(kind_of(&[[0; 84].as_slice(), &[1; 50]].concat()), "stl");
    assert_eq!(kind_of(b"\xff\xfe1\0 \0"), "xyz");
}
