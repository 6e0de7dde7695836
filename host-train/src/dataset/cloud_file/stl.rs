//! Stereolithography `.stl`, ASCII and binary: a mesh of loose triangles.
//!
//! Read here rather than by a crate, which takes binary files whose header begins with "solid" for text, and
//! stops at the first of several solids.

use super::{CloudFile, text};
use crate::dataset::Point;

/// Bytes before the triangles of a binary file; the last four are their number.
const HEADER: usize = 84;
/// Normal, three corners and two bytes of attributes.
const TRIANGLE: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let claimed = bytes
        .get(HEADER - 4..HEADER)
        .and_then(|count| count.try_into().ok())
        .map(u32::from_le_bytes);
    let whole = claimed.map(|count| HEADER as u64 + TRIANGLE as u64 * u64::from(count));
    let points =
        if whole != Some(bytes.len() as u64) && bytes.trim_ascii_start().starts_with(b"solid") {
            ascii(bytes)?
        } else {
            binary(bytes, claimed.ok_or("it ends inside its header")?)?
        };
    let faces: Vec<[u32; 3]> = (0..points.len() as u32 / 3)
        .map(|face| [0, 1, 2].map(|corner| 3 * face + corner))
        .collect();
    Ok(CloudFile {
        points,
        faces: Some(faces).filter(|faces| !faces.is_empty()),
        ..CloudFile::default()
    })
}

fn binary(bytes: &[u8], claimed: u32) -> Result<Vec<Point>, String> {
    let (triangles, _) = bytes[HEADER..].as_chunks::<TRIANGLE>();
    let triangles = triangles.get(..claimed as usize).ok_or_else(|| {
        format!(
            "it claims {claimed} triangles and holds {}; it is cut off or corrupt",
            triangles.len()
        )
    })?;
    let corners = triangles.iter().flat_map(|triangle| {
        let (numbers, _) = triangle[12..].as_chunks::<4>();
        let (corners, _) = numbers.as_chunks::<3>();
        corners.iter().map(|corner| corner.map(f32::from_le_bytes))
    });
    Ok(corners.collect())
}

fn ascii(bytes: &[u8]) -> Result<Vec<Point>, String> {
    let mut corners: Vec<Point> = Vec::new();
    let mut facets = 0;
    let mut open = false;
    for (line, content) in text::lines(bytes)? {
        let (keyword, rest) = content
            .split_once(char::is_whitespace)
            .unwrap_or((content, ""));
        match keyword.to_ascii_lowercase().as_str() {
            "solid" => open = true,
            "facet" | "outer" | "endloop" => {}
            "vertex" => corners.push(text::point(rest, line)?),
            "endfacet" => {
                facets += 1;
                if corners.len() != 3 * facets {
                    return Err(format!(
                        "line {line}: the facet does not have three corners"
                    ));
                }
            }
            "endsolid" => open = false,
            _ => {
                return Err(format!(
                    "line {line}: \"{keyword}\" is no keyword of the format"
                ));
            }
        }
    }
    if open || corners.len() != 3 * facets {
        return Err("it ends before endsolid".into());
    }
    Ok(corners)
}
