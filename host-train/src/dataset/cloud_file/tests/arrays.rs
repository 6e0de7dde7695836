//! NumPy arrays.

use super::*;

/// The rounding of map coordinates to float32 is noted if it is visible in the shape.
#[test]
fn steps_of_float32_far_from_the_origin_are_told() {
    for (size, is_told) in [(1.0, true), (100.0, true), (10_000.0, false)] {
        let point = |i: u32| {
            let at = [i % 7, i % 11, i % 13].map(|k| size * f64::from(k) / 13.1);
            [483_221.0 + at[0], 5_456_871.0 + at[1], 310.0 + at[2]]
        };
        let points: Vec<Position> = (0..500).map(point).collect();
        let coordinates = points.iter().flatten();
        let narrow: Vec<u8> = coordinates
            .clone()
            .flat_map(|&x| (x as f32).to_le_bytes())
            .collect();
        let file = read(".npy", &npy("<f4", "False", "500, 3", &narrow)).expect("a cloud");
        let coarse = [Note::Coarse { step: 0.5 }];
        assert_eq!(file.notes == coarse, is_told, "{size}: {:?}", file.notes);
        let wide: Vec<u8> = coordinates.flat_map(|x| x.to_le_bytes()).collect();
        let file = read(".npy", &npy("<f8", "False", "500, 3", &wide)).expect("a cloud");
        assert_eq!(file.notes, []);
    }
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
    // A batch of one cloud is read as that cloud; in other arrays of three axes, the coordinates' place would be a guess.
    let numbers: Vec<u8> = (0..60i32).flat_map(i32::to_le_bytes).collect();
    let batch = npy("<i4", "False", "1, 3, 20", &numbers);
    let file = read(".npy", &batch).expect("npy");
    assert_eq!((file.points.len(), file.points[1]), (20, [1.0, 21.0, 41.0]));
    for shape in ["3, 1, 20", "1, 60, 1", "3, 20, 1", "2, 1, 30"] {
        let said = refused(".npy", &npy("<i4", "False", shape, &numbers));
        assert!(said.contains(&format!("its shape is ({shape})")), "{said}");
    }
    // Columns four to six are not unit vectors, and so not normals.
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

    let complex = refused(".npy", &npy("<c8", "False", "2, 3", &bytes));
    let words = "\"<c8\", expected floats of 16, 32 or 64 bits or integers of 8 to 64";
    assert!(complex.contains(words), "{complex}");
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
fn every_width_that_an_error_names_is_read() {
    // 1, -2.5 and 65504, the largest; then the smallest above 0, infinity and NaN.
    let halves = [0x3c00u16, 0xc100, 0x7bff, 0x0001, 0x7c00, 0x7e00];
    let little = halves.map(u16::to_le_bytes).concat();
    let big = halves.map(u16::to_be_bytes).concat();
    for (kind, bytes) in [("<f2", little), (">f2", big)] {
        let file = read(".npy", &npy(kind, "False", "2, 3", &bytes)).expect("npy");
        assert_eq!(file.points, [[1.0, -2.5, 65504.0]], "{kind}");
        let points = 1;
        assert_eq!(file.notes, [Note::Dropped { points, faces: 0 }], "{kind}");
    }
    let smallest = npy("<f2", "False", "1, 3", &[1, 0, 0, 0, 0, 0x80]);
    let file = read(".npy", &smallest).expect("npy");
    assert_eq!(file.points, [[2f64.powi(-24), 0.0, 0.0]]);
    for (kind, width) in [
        ("i2", 2),
        ("u2", 2),
        ("i4", 4),
        ("u4", 4),
        ("i8", 8),
        ("u8", 8),
    ] {
        let number = |value: u8, is_big: bool| {
            let mut bytes = vec![0; width];
            bytes[if is_big { width - 1 } else { 0 }] = value;
            bytes
        };
        for (order, is_big) in [("<", false), (">", true)] {
            let bytes = [3, 4, 5].map(|value| number(value, is_big)).concat();
            let kind = format!("{order}{kind}");
            let file = read(".npy", &npy(&kind, "False", "1, 3", &bytes)).expect("npy");
            assert_eq!(file.points, [[3.0, 4.0, 5.0]], "{kind}");
        }
    }
}

#[test]
fn booleans_and_records_are_refused_with_what_to_do() {
    let said = refused(".npy", &npy("|b1", "False", "2, 3", &[1; 6]));
    assert!(said.contains("its elements are booleans"), "{said}");
    let fields = "[('x', '<f4'), ('y', '<f4'), ('z', '<f4', (1,))]";
    let header = format!("{{'descr': {fields}, 'fortran_order': False, 'shape': (1,), }}\n");
    let length = (header.len() as u16).to_le_bytes();
    let magic = b"\x93NUMPY\x01\x00";
    let said = refused(
        ".npy",
        &[magic, &length[..], header.as_bytes(), &[0; 12]].concat(),
    );
    let words = format!("its elements are records, {fields}: stack the fields, as in numpy.stack(");
    assert!(said.contains(&words), "{said}");
}

#[test]
fn a_batch_of_clouds_is_told() {
    let bytes: Vec<u8> = (0..120).flat_map(|i| (i as f32).to_le_bytes()).collect();
    let notes = |shape: &str| {
        read(".npy", &npy("<f4", "False", shape, &bytes))
            .expect("npy")
            .notes
    };
    assert_eq!(notes("2, 20, 3"), [Note::Stacked { clouds: 2, of: 20 }]);
    assert_eq!(notes("8, 5, 3"), []);
    assert_eq!(notes("20, 2, 3"), []);
}

/// Integers are exact, wherever they are.
#[test]
fn whole_numbers_are_no_rounded_ones() {
    let point = |i: u32| [5_456_871 + i % 7, i % 11, i % 13].map(f64::from);
    let text: String = (0..300)
        .map(|i| point(i).map(|x| x.to_string()).join(" ") + "\n")
        .collect();
    assert_eq!(read(".xyz", text.as_bytes()).expect("xyz").notes, []);
}
