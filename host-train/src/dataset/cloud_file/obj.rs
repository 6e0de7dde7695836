//! Wavefront `.obj`: all objects of the file as one mesh, or its bare vertices where it has no faces.
//!
//! Read here rather than by a crate: a surface needs two of the format's keywords, and a refusal should name
//! the line.

use super::{CloudFile, fan, text};

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    // Names and comments may be in any encoding.
    let mut whole = String::from_utf8_lossy(bytes);
    if whole.contains('\\') {
        // A backslash continues a line.
        whole = whole.replace("\\\r\n", " ").replace("\\\n", " ").into();
    }
    let mut file = CloudFile::default();
    let mut triangles = Vec::new();
    let mut polygon = Vec::new();
    for (line, content) in text::numbered(&whole) {
        let (keyword, rest) = content
            .split_once(char::is_whitespace)
            .unwrap_or((content, ""));
        match keyword {
            "v" => file.points.push(text::point(rest, line)?),
            "f" => {
                polygon.clear();
                for corner in rest.split_whitespace() {
                    let index = corner.split('/').next().and_then(|word| word.parse().ok());
                    let vertex = index.and_then(|index| resolve(index, file.points.len()));
                    polygon.push(vertex.ok_or_else(|| {
                        format!("line {line}: \"{corner}\" names no vertex before it")
                    })?);
                }
                triangles.extend(fan(&polygon));
            }
            _ => {}
        }
    }
    file.faces = Some(triangles).filter(|triangles| !triangles.is_empty());
    Ok(file)
}

/// The vertex of an index: they count from 1, negative ones back from the last.
fn resolve(index: i64, vertices: usize) -> Option<u32> {
    let count = i64::try_from(vertices).ok()?;
    let at = if index < 0 {
        count.checked_add(index)?
    } else {
        index.checked_sub(1)?
    };
    if (0..count).contains(&at) {
        u32::try_from(at).ok()
    } else {
        None
    }
}
