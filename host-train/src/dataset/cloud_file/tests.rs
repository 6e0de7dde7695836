//! Small files of each kind, whole and broken.

use super::*;
use proptest::prelude::*;
use std::io::Write;

const TETRAHEDRON: [Point; 4] = [
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
    let xyz = read(
        ".xyz",
        b"# made by hand\n0 0 0\n1,0,0,255\n\n0\t1e0\t0 7 7\n",
    )
    .expect("xyz");
    assert_eq!(
        (xyz.points.as_slice(), xyz.faces),
        (&TETRAHEDRON[..3], None)
    );

    let pcd = read(".pcd", PCD.as_bytes()).expect("pcd");
    assert_eq!(
        (pcd.points.as_slice(), pcd.dropped),
        (&[[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]][..], 1)
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
    let mut cloud = Cloud {
        points: TETRAHEDRON.into(),
        normals: Some(vec![[0.0, 0.6, -0.8]; 4]),
    };
    cloud.points[2][0] = 0.1;
    for name in ["c.ply", "c.pcd", "c.npy", "c.XYZ"] {
        let path = dir.path().join(name);
        let bare = Cloud {
            normals: None,
            ..cloud.clone()
        };
        write_cloud(&path, &bare).expect("write");
        assert_eq!(read_cloud(&path, 0).expect("read"), bare, "{name}");
        write_cloud(&path, &cloud).expect("write");
        let back = read_cloud(&path, 0).expect("read");
        assert_eq!(back.points, cloud.points, "{name}");
        assert_eq!(back.normals.is_some(), name != "c.XYZ", "{name}");
        assert!(
            back.normals
                .is_none_or(|normals| normals == [[0.0, 0.6, -0.8]; 4]),
            "{name}"
        );
    }
    let error = write_cloud(&dir.path().join("c.stl"), &cloud).expect_err("not written");
    assert!(error.to_string().contains("written as .ply"), "{error}");
}

#[test]
fn a_moved_cloud_turns_its_normals() {
    let cloud = Cloud {
        points: vec![[1.0, 0.0, 0.0]],
        normals: Some(vec![[0.0, 1.0, 0.0]]),
    };
    let rotation = glam::Mat3::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let moved = cloud.moved(&Pose {
        rotation,
        translation: Vec3::new(0.0, 0.0, 5.0),
    });
    let near = |a: Point, b: Point| Vec3::from(a).distance(b.into()) < 1e-6;
    assert!(near(moved.points[0], [0.0, 1.0, 5.0]));
    assert!(near(moved.normals.expect("kept")[0], [-1.0, 0.0, 0.0]));
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

    let mesh = Mesh {
        vertices: TETRAHEDRON.map(Vec3::from).to_vec(),
        faces: vec![[0, 1, 2], [0, 3, 1]],
    };
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

    assert!(refused(".npy", &npy("<i4", "False", "2, 3", &bytes)).contains("expected float32"));
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
            .flat_map(|x| x.to_le_bytes())
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
        |&[x, y, z]: &Point| x >= 0.0 && y >= 0.0 && z >= 0.0 && x + y + z / 2.0 < 1.0 + 1e-5;
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
    assert!(refused(".doc", b"").contains(".ply .pcd .xyz .npy .off .obj or .stl"));
    assert!(matches!(
        read_file(Path::new("no/such.ply")),
        Err(CloudError::Io { .. })
    ));
    assert!(refused(".xyz", b"").contains("no points"));
    assert!(
        refused(".xyz", b"0 0 0\n1 2\n")
            .contains("line 2: expected three coordinates, found \"1 2\"")
    );
    assert!(refused(".xyz", b"0 0 0\nnan 0 0\n").contains("point 1 has a NaN"));
    assert!(refused(".xyz", b"\xff\xfe").contains("byte 0 is not text"));
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
            (".ply", ply::emit(&[0; 48], 4, 3)),
        ];
        let (name, bytes) = &whole[kind];
        let mut flipped = bytes.clone();
        flipped[at.index(bytes.len())] = value;
        let _ = read(name, &flipped);
        let _ = read(name, &bytes[..cut.index(bytes.len())]);
    }
}
