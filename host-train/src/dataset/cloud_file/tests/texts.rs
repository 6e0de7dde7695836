//! Points in text, as various programs and countries write it.

use super::*;

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
        ("1.5 -2.25 3\r4 5.5 6 # a comment\r7 8 9.5\r", vec![]),
        // NaN as programs on Windows write it.
        (
            "1.5 -2.25 3\n1.#QNAN 2 3\n-1.#IND -1.#IND 1.#R\n4 5.5 6\n-nan(ind) 0 0\n7 8 9.5#end\n2 NaN(snan) 1.#INF00\n",
            vec![Note::Dropped {
                points: 4,
                faces: 0,
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
            "of which three are x, y and z (or easting, northing, elevation); found \"a b c\"",
        ),
        ("x y z\n1 2 3\nx y z\n", "line 3"),
        ("x y z nx\n1 2\n", "line 2"),
        (
            "x y z nx\n1 2 3\n",
            "line 2: 3 columns, where the first line names 4",
        ),
        ("x,y,z\n83,50,25,32,11,00\n", "if these are decimal commas"),
        (
            "x y z\n7 1.5 2 3\n7 4 5 6\n7 7 8 9\n",
            "does not number the lines",
        ),
        ("points in mm\n1 2 3\n", "or the names of the columns"),
        ("1 2 abc\n", "line 1"),
        ("\u{7}\u{1b}[31m 2 3\n", "found \"??[31m 2 3\""),
    ] {
        let said = refused(".txt", text.as_bytes());
        assert!(said.contains(words), "{text:?}: {said}");
    }
    // Whole numbers are unambiguous with names or in three columns.
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

/// Names that belong together are those of the coordinates, even if other columns have similar names.
#[test]
fn columns_are_the_coordinates_whose_names_go_together() {
    let expected = [[1.0, 2.0, 3.0]];
    for text in [
        "height,x,y,z\n9,1,2,3\n",
        "\"Elevation\",\"Points:0\",\"Points:1\",\"Points:2\"\n9,1,2,3\n",
        "Easting,Northing,X,Y,Z\n8,9,1,2,3\n",
        "northing,easting,height,elevation\n2,1,9,3\n",
        "easting,northing,height\n1,2,3\n",
        "z,x,y\n3,1,2\n",
        "name;x;y;z;when\nP 1;1;2;3;12:30\n",
    ] {
        let file = read(".csv", text.as_bytes()).expect("named");
        assert_eq!(file.points, expected, "{text:?}");
    }
    let said = refused(".csv", b"name,x,y,z\nP1,1,two,3\n");
    assert!(said.contains("line 2: expected three"), "{said}");
    let said = refused(".csv", b"x,y,height,elevation\n1,2,3,4\n");
    assert!(said.contains("line 1: expected three"), "{said}");
}

/// A first column without a name, or with numbers that tell only which line it is, is no coordinate.
#[test]
fn what_numbers_or_names_the_lines_is_left_out() {
    let expected = [[1.5, -2.25, 3.0], [4.0, 5.5, 6.0], [7.0, 8.0, 9.5]];
    for text in [
        // R, pandas, and spreadsheets.
        "\"x\" \"y\" \"z\"\n\"1\" 1.5 -2.25 3\n\"2\" 4 5.5 6\n\"3\" 7 8 9.5\n",
        "     x     y    z\n0  1.5 -2.25  3\n1  4.0  5.5  6\n2  7.0  8.0 9.5\n",
        "x,y,z\nP 1,1.5,-2.25,3\nP 2,4,5.5,6\nP 3,7,8,9.5\n",
        // Numbers of points that begin anywhere, and are in any order.
        "1001 1.5 -2.25 3\n1002 4 5.5 6\n1005 7 8 9.5\n",
        "30;1.5;-2.25;3\n20;4;5.5;6\n10;7;8;9.5\n",
    ] {
        let file = read(".txt", text.as_bytes()).expect("a table");
        assert_eq!(file.points, expected, "{text:?}");
        assert_eq!(file.notes, [Note::IndexColumn], "{text:?}");
    }
    for text in [
        // Text with blanks between tabs, empty fields, and separators in quotes.
        "Name\tX\tY\tZ\nPoint 1\t1.5\t-2.25\t3\nPoint 2\t4\t5.5\t6\nPoint 3\t7\t8\t9.5\n",
        "id\tx\ty\tz\tname\n\t1.5\t-2.25\t3\ta\n\t4\t5.5\t6\t\n\t7\t8\t9.5\tc\n",
        "Name\tX\tY\tZ\nPunkt 1\t1,5\t-2,25\t3\nPunkt 2\t4\t5,5\t6\nPunkt 3\t7\t8\t9,5\n",
        "name,x,y,z\n\"hole, 1\",1.5,-2.25,3\n\"hole, 2\",4,5.5,6\n\"hole \"\"3\"\"\",7,8,9.5\n",
        "name;x;y;z;what\n\"a;b\";1,5;-2,25;3;\nb;4;5,5;6;\nc;7;8;9,5;\n",
        "# made on: x y z\n1.5 -2.25 3 4\n4 5.5 6 4\n7 8 9.5 5\n",
    ] {
        let file = read(".txt", text.as_bytes()).expect("a table");
        assert_eq!(file.points, expected, "{text:?}");
    }
    // A single value twice is no number of a line.
    let file = read(".xyz", b"5 1.5 2 3\n5 4 5 6\n6 7 8 9\n").expect("xyz");
    assert_eq!(file.points[0], [5.0, 1.5, 2.0]);
}
