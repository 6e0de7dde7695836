//! NumPy arrays.

use super::*;

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
    // One cloud in a batch is read as that cloud; where the coordinates are in other arrays of three axes is a guess.
    let numbers: Vec<u8> = (0..60i32).flat_map(i32::to_le_bytes).collect();
    let batch = npy("<i4", "False", "1, 3, 20", &numbers);
    let file = read(".npy", &batch).expect("npy");
    assert_eq!((file.points.len(), file.points[1]), (20, [1.0, 21.0, 41.0]));
    for shape in ["3, 1, 20", "1, 60, 1", "3, 20, 1", "2, 1, 30"] {
        let said = refused(".npy", &npy("<i4", "False", shape, &numbers));
        assert!(said.contains(&format!("its shape is ({shape})")), "{said}");
    }
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
