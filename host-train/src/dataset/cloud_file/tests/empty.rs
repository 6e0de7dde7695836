//! Files without points, of every kind.

use super::*;

#[test]
fn files_without_bytes_have_no_points() {
    for extension in EXTENSIONS {
        for blank in ["", " \n"] {
            // For a bag's file, blanks are contents.
            if *extension == "mcap" && !blank.is_empty() {
                continue;
            }
            let suffix = format!(".{extension}");
            let said = refused(&suffix, blank.as_bytes());
            let words = format!("{suffix}: no points");
            assert!(said.contains(&words), "{extension}, {blank:?}: {said}");
        }
    }
}

#[test]
fn files_that_count_no_points_have_none() {
    let none = |text: &str| {
        let text = text.split("DATA").next().unwrap_or_default();
        text.replace("POINTS 3", "POINTS 0")
            .replace("WIDTH 3", "WIDTH 0")
    };
    let pcd = |kind: &str| (".pcd", format!("{}DATA {kind}\n", none(PCD)).into_bytes());
    let ply = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let array = |shape: &str| (".npy", npy("<f4", "False", shape, &[]));
    let text = |extension, text: &str| (extension, text.as_bytes().to_vec());
    for (extension, bytes) in [
        pcd("ascii"),
        pcd("binary"),
        pcd("binary_compressed"),
        text(".ply", ply),
        text(".off", "OFF\n0 0 0\n"),
        text(".obj", "# none\n"),
        text(".stl", "solid none\nendsolid none\n"),
        (".stl", vec![0; 84]),
        text(".csv", "x,y,z\n"),
        text(".xyz", "# x y z\n"),
        text(".pts", "0\n"),
        array("0, 3"),
        array("3, 0"),
        array("0, 0"),
        array("0,"),
    ] {
        let said = refused(extension, &bytes);
        let words = format!("{extension}: no points");
        assert!(
            said.ends_with(&words),
            "{:?}: {said}",
            String::from_utf8_lossy(&bytes)
        );
    }
}
