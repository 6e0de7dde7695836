//! Meshes as programs write them.

use super::super::polygon::NOTCHED;
use super::*;

#[test]
fn meshes_as_programs_write_them() {
    let relative = read(".obj", b"# M\xfcller\nv 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//1 \\\n -2//1 -1//1\nv 0 0 2\nf 1 2 4\n");
    let relative = relative.expect("obj");
    assert_eq!(
        (relative.points.as_slice(), relative.faces),
        (&TETRAHEDRON[..], Some(vec![[0, 1, 2], [0, 1, 3]]))
    );
    let unknown = b"v 0 0 0\nv 1 0 0\nv 0 1 1.#QNAN\nv 0 1 0 # here\nf 1 2 4\nf 1 2 3\n";
    let file = read(".obj", unknown).expect("obj");
    assert_eq!(
        (file.points.as_slice(), file.faces),
        (&TETRAHEDRON[..3], Some(vec![[0, 1, 2]]))
    );
    // A cloud with a triangle beside it is a mesh; a note names what is not used.
    let beside = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nv 6 6 6\nv 7 7 7\nv 8 8 8\nf 1 2 3\n";
    let file = read(".obj", beside).expect("obj");
    let loose = Note::LooseVertices { vertices: 4, of: 7 };
    assert_eq!(file.notes, [loose]);
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

/// The outline of a U of area 7, as one polygon in each format that has polygons.
#[test]
fn polygons_with_a_notch_keep_it_open() {
    let rows = |prefix: &str| {
        NOTCHED
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
fn of_a_broken_ply_the_line_is_named_and_no_grammar() {
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (text, said) in [
        (
            "ply\nformat".to_owned(),
            "Line 2: Couldn't parse line: 'format'",
        ),
        (format!("{header}1 2 3\n4 x 6\n"), "element line: '4 x 6'"),
        (
            header.replace("float x", "flot x"),
            "Line 4: Couldn't parse line: 'property flot x'",
        ),
        (format!("{header}1 2 3\n"), "expected 2, got 1"),
    ] {
        let reason = refused(".ply", text.as_bytes());
        assert!(
            reason.contains(said) && !reason.contains("Error"),
            "{reason}"
        );
    }
}

#[test]
fn names_of_properties_may_be_capitals() {
    let capitals = PLY
        .replace("float x", "float X")
        .replace("double y", "double Y");
    let capitals = capitals.replace("float z", "float Z");
    let file = read(".ply", capitals.as_bytes()).expect("ply");
    assert_eq!(file, read(".ply", PLY.as_bytes()).expect("ply"));
    let both = PLY.replace("uchar red", "uchar X");
    let said = refused(".ply", both.as_bytes());
    assert!(said.contains("in small letters and in capitals"), "{said}");
}

#[test]
fn homogeneous_coordinates_are_divided_by_their_weight() {
    let file = read(".obj", b"v 2 4 6 2\nv 1 2 3 1\nv 4 5 6\nv 1 1 1 0\n").expect("obj");
    assert_eq!(
        file.points,
        [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    );
    // The vertex at infinity is left out.
    let weighted = Note::Weighted { vertices: 2 };
    let points = 1;
    assert_eq!(file.notes, [weighted, Note::Dropped { points, faces: 0 }]);
}

/// Numbers without a zero beside their point, empty lines, old line ends and a byte order mark, as people and programs write them.
#[test]
fn ascii_ply_is_read_as_it_comes() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n.5 -.5 5.\n\n0. 1e1 -2.5e-1\n-nan 1 2\n";
    for text in [
        text.to_owned(),
        text.replace('\n', "\r\n"),
        text.replace('\n', "\r"),
        format!("\u{feff}{text}\n"),
    ] {
        let file = read(".ply", text.as_bytes()).expect("ply");
        assert_eq!(file.points, [[0.5, -0.5, 5.0], [0.0, 10.0, -0.25]]);
        let dropped = Note::Dropped {
            points: 1,
            faces: 0,
        };
        assert_eq!(file.notes, [dropped]);
    }
}
