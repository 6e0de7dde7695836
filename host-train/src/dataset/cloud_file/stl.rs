//! Stereolithography `.stl`, ASCII and binary: a mesh of loose triangles.
//!
//! It is read here rather than by a crate: the crate takes binary files whose header begins with "solid" for text,
//! and stops at the first of several solids.

use super::lines::{decode, numbered, numbers, position};
use super::{CloudFile, Note, Position};
use nalgebra::Vector3;

/// Bytes before the triangles of a binary file; the last four are the number of triangles.
const HEADER: usize = 84;
/// Normal, three corners and two bytes of attributes.
const TRIANGLE: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut file = CloudFile::default();
    file.points = if is_text(bytes) {
        ascii(&decode(bytes, &mut file.notes)?)?
    } else {
        binary(bytes, &mut file.notes)?
    };
    let faces: Vec<[u32; 3]> = (0..file.points.len() as u32 / 3)
        .map(|face| [0, 1, 2].map(|corner| 3 * face + corner))
        .collect();
    file.faces = Some(faces).filter(|faces| !faces.is_empty());
    Ok(file)
}

/// Whether a file is text. Binary files may begin with "solid", too, but contain zero bytes.
fn is_text(bytes: &[u8]) -> bool {
    let start = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let start = start.trim_ascii_start();
    let solid = start
        .get(..5)
        .is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let wide = matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..]);
    wide || solid && !bytes[..bytes.len().min(1024)].contains(&0)
}

fn binary(bytes: &[u8], notes: &mut Vec<Note>) -> Result<Vec<Position>, String> {
    let claimed = bytes
        .get(HEADER - 4..HEADER)
        .and_then(|count| count.try_into().ok())
        .map(u32::from_le_bytes)
        .ok_or("it ends inside its header")?;
    let (triangles, rest) = bytes[HEADER..].as_chunks::<TRIANGLE>();
    let read = if claimed as usize > triangles.len() {
        return Err(format!(
            "it claims {claimed} triangles and holds {}; it is cut off or corrupt",
            triangles.len()
        ));
    } else if rest.is_empty() {
        triangles
    } else {
        &triangles[..claimed as usize]
    };
    if read.len() != claimed as usize {
        notes.push(Note::Count {
            what: "triangles",
            claimed: claimed.into(),
            read: read.len(),
        });
    } else if read.len() < triangles.len() || !rest.is_empty() {
        let what = "what follows the triangles".into();
        notes.push(Note::Ignored { what });
    }
    let corners = read.iter().flat_map(|triangle| {
        let (numbers, _) = triangle[12..].as_chunks::<4>();
        let (corners, _) = numbers.as_chunks::<3>();
        let wide = |x| f64::from(f32::from_le_bytes(x));
        corners.iter().map(move |corner| corner.map(wide))
    });
    Ok(corners.collect())
}

fn ascii(text: &str) -> Result<Vec<Position>, String> {
    let mut corners: Vec<Position> = Vec::new();
    let mut facets = 0;
    let mut open = false;
    for (line, content) in numbered(text) {
        let (keyword, rest) = content
            .split_once(char::is_whitespace)
            .unwrap_or((content, ""));
        match keyword.to_ascii_lowercase().as_str() {
            "solid" => open = true,
            "facet" | "outer" | "endloop" => {}
            "vertex" => corners.push(position(numbers(rest).as_deref(), rest, line)?),
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
                    "line {line}: \"{}\" is no keyword of the format",
                    super::lines::excerpt(keyword)
                ));
            }
        }
    }
    if open || corners.len() != 3 * facets {
        return Err("it ends before endsolid".into());
    }
    Ok(corners)
}

/// Writes the mesh as a binary file. The format has only float32, which suffices near the origin.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let faces = file.faces.as_deref().unwrap_or_default();
    let mut bytes = vec![b' '; HEADER - 4];
    bytes.extend((faces.len() as u32).to_le_bytes());
    for face in faces {
        let [a, b, c] = face.map(|i| Vector3::from(file.points[i as usize]));
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
        for vector in [normal.unwrap_or_default(), a, b, c] {
            bytes.extend(vector.iter().flat_map(|&x| (x as f32).to_le_bytes()));
        }
        bytes.extend([0, 0]);
    }
    bytes
}
