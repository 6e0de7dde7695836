//! Small files of each kind, whole and broken.

mod arrays;
mod empty;
mod meshes;
mod texts;
mod written;

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
    for capital in [
        PCD.replace("x y z", "X Y Z"),
        PCD.replace("DATA ascii", "DATA ASCII"),
        PCD.replace("DATA ascii", "data Ascii"),
    ] {
        let same = read(".pcd", capital.as_bytes()).expect("pcd");
        assert_eq!(same, pcd, "{capital}");
    }
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
fn an_image_of_another_size_than_its_points_is_told() {
    let claims = |width: &str| {
        let text = PCD
            .replace("WIDTH 3", width)
            .replace("HEIGHT 1", "HEIGHT 2");
        let file = read(".pcd", text.as_bytes()).expect("pcd");
        let notes = file.notes.iter().map(Note::to_string);
        let mut claims = notes.filter(|said| said.contains("claims"));
        claims.next()
    };
    let words = "it claims 4 points by WIDTH and HEIGHT and holds 3; what it holds is read";
    assert_eq!(claims("WIDTH 2").as_deref(), Some(words));
    let organised = PCD
        .replace("WIDTH 3", "WIDTH 1")
        .replace("HEIGHT 1", "HEIGHT 3");
    let (rows, row) = (
        read(".pcd", organised.as_bytes()),
        read(".pcd", PCD.as_bytes()),
    );
    assert_eq!(rows.expect("pcd"), row.expect("pcd"));
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

    // Padding between the fields, as the Point Cloud Library writes it.
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
        refused(".doc", b"")
            .contains(".ply .pcd .xyz .txt .asc .csv .pts .npy .off .obj .stl .mcap")
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
    assert!(refused(".xyz", b"inf 0 0\nnan 0 0\n").contains("no points but 2 invalid ones"));
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
fn invalid_points_go_with_their_faces() {
    for number in ["3.4e38", "nan", "-nan(ind)", "1.#QNAN", "-1.#INF00"] {
        let ply = PLY.replace("1 0 0 9", &format!("{number} 0 0 9"));
        let file = read(".ply", ply.as_bytes()).expect(number);
        assert_eq!(
            file.points,
            [TETRAHEDRON[0], TETRAHEDRON[2], TETRAHEDRON[3]]
        );
        // The file has a triangle and a polygon that is divided in two; only one triangle has no invalid corner.
        assert_eq!(file.faces, Some(vec![[0, 1, 2]]));
        assert!(file.notes.contains(&Note::Dropped {
            points: 1,
            faces: 2
        }));
    }
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

#[test]
fn what_follows_all_that_a_header_counts_is_told() {
    let records = |points: usize| vec![0x3f; 16 * points];
    let more = b"1 2 3 4\n";
    for (name, file, filling) in [
        (".off", OFF.as_bytes().to_vec(), b"\n  "),
        (".ply", PLY.as_bytes().to_vec(), b"\n  "),
        (".pcd", PCD.as_bytes().to_vec(), b"\n  "),
        (".pcd", pcd_binary("binary", &records(3)), b"\0\0\n"),
    ] {
        let beyond = |file: &[u8]| {
            let notes = read(name, file).expect("it is read").notes;
            notes.iter().any(|note| matches!(note, Note::Beyond { .. }))
        };
        assert!(!beyond(&file), "{name}");
        assert!(!beyond(&[file.as_slice(), filling].concat()), "{name}");
        assert!(beyond(&[file.as_slice(), more].concat()), "{name}");
    }
}

#[test]
fn what_is_of_another_format_is_told() {
    let noise: Vec<u8> = (0..500u32).map(|i| (i * 167 % 251) as u8).collect();
    for format in [".ply", ".pcd"] {
        let refused = read(format, &noise).expect_err("no cloud");
        let said = refused.to_string();
        assert!(said.ends_with("is it of another format?"), "{said}");
    }
}
